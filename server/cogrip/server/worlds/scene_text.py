"""Text of a scene and its mesh files: read, bounded and looked through before MuJoCo sees them. MuJoCo itself opens no file.

Meshes are OBJ and STL files in the scene's own folder or below it; MuJoCo gets their bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.parsers import expat

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.texts import shown

MOST_BYTES = 8_000_000  # of a scene's text, and of its meshes together
MOST_ELEMENTS = 5000  # of XML: more take minutes to load
MOST_NAMED = 5  # of a list of names in an error
MESH_ENDINGS = (".obj", ".stl")


class SceneError(ForeignFileError, ValueError):
    """A scene that cannot be used. The text says why, in one line."""


@dataclass(slots=True)
class Scan:
    """Finding of `scan`: attributes of <option> and of <compiler>, mesh files, other files, as the text has them."""

    options: set[str] = field(default_factory=set)
    compiler: dict[str, str] = field(default_factory=dict)
    meshes: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)


def read_text(path: Path) -> str:
    """Return the text of a file. Raises SceneError."""
    data = _read(path, MOST_BYTES, str(path), "; give MJCF or URDF")
    if len(data) > MOST_BYTES:
        raise SceneError(f"{path}: has more than {MOST_BYTES / 1e6:g} MB; make it smaller")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: cannot be read: {error}") from None


def _read(path: Path, most_bytes: int, name: str, cure: str) -> bytes:
    """Return a regular file's bytes, at most one more than `most_bytes`. Raises SceneError."""
    try:
        if not path.is_file():
            raise SceneError(f"{name}: {'is no regular file' if path.exists() else 'there is no such file'}{cure}")
        with path.open("rb") as file:
            return file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        if isinstance(error, SceneError):
            raise
        raise SceneError(f"{name}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def scan(text: str, name: str) -> Scan:
    """Return what a scene refers to. Raises SceneError for other files than meshes, too many elements, and no XML."""
    found = Scan()
    elements = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal elements
        for key, value in attributes.items():
            if key.lower().startswith("file"):
                mesh = tag == "mesh" and key == "file" and value.lower().endswith(MESH_ENDINGS)
                (found.meshes if mesh else found.others).append(value)
        if tag == "option":
            found.options.update(attributes)
        if tag == "compiler":
            found.compiler.update(attributes)
        elements += 1

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    try:
        parser.Parse(text.encode("utf-8"), True)
    except expat.ExpatError as error:
        raise SceneError(f"{name}: does not load: {error}") from None
    if elements > MOST_ELEMENTS:
        raise SceneError(f"{name}: has {elements} elements, more than {MOST_ELEMENTS}; leave some out")
    if found.others:
        raise SceneError(
            f"{name}: refers to other files ({_named(found.others)}), which are not read; build it of boxes, spheres, "
            "capsules, cylinders, planes, and meshes of MJCF in OBJ or STL files"
        )
    return found


def read_meshes(found: Scan, folder: Path | None, name: str) -> dict[str, bytes]:
    """Return the contents of a scene's mesh files by their names without folders, as MuJoCo looks for them.

    folder: of the scene, which no file may be outside of; None: it has none. Raises SceneError.
    """
    if not found.meshes:
        return {}
    if folder is None:
        raise SceneError(f"{name}: has mesh files ({_named(found.meshes)}), and no folder that they are in")
    inside = found.compiler.get("meshdir") or found.compiler.get("assetdir") or ""
    strips = found.compiler.get("strippath") == "true"
    read: dict[str, bytes] = {}
    places: dict[str, Path] = {}
    left = MOST_BYTES
    for mesh in found.meshes:
        base = PurePosixPath(mesh).name
        place = (folder / inside / (base if strips else mesh)).resolve()
        if not place.is_relative_to(folder.resolve()):
            raise SceneError(
                f"{name}: mesh {mesh!r} is outside of the scene's folder; put it beside the scene, or below"
            )
        if places.setdefault(base, place) != place:
            raise SceneError(f"{name}: two mesh files are called {base!r}; give them different names")
        if base in read:
            continue
        read[base] = _read(place, left, f"{name}: mesh {mesh!r}", "; put it beside the scene, or below")
        left -= len(read[base])
        if left < 0:
            raise SceneError(f"{name}: its meshes have more than {MOST_BYTES / 1e6:g} MB together; make them coarser")
    return read


def _named(files: Sequence[str]) -> str:
    more = f" and {len(files) - MOST_NAMED} more" if len(files) > MOST_NAMED else ""
    return ", ".join(map(shown, files[:MOST_NAMED])) + more
