"""Text of a scene and the files that it names: read, bounded and looked through before MuJoCo sees them.

MuJoCo opens no file of a scene itself. It gets the bytes of each under the name by which it will ask for it, in a virtual
folder that no disk has: what it asks for beyond that is not there. All of them are in the scene's folder, out of which no path
and no link leads.

Where MuJoCo looks for a file F, of a model in folder M that is included from folder I:

    include, model           M/F, else I/F          mesh, skin, hfield, flexcomp      M/meshdir/F, else I/F
    texture                  M/texturedir/F, else I/F         strippath: F without its folders
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from os.path import commonpath, normpath
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.texts import shown

MOST_BYTES = 8_000_000  # longest text of XML
MOST_FILE_BYTES = 32_000_000  # longest file of a scene that is not XML
MOST_FILES_BYTES = 128_000_000  # most bytes of all files of a scene together
MOST_ELEMENTS = 20_000  # most elements of XML in all texts of a scene: more take minutes to load
MOST_TEXTS = 500  # most texts that a scene includes, itself among them
MOST_NAMED = 5  # most names that an error lists
_INSIDE = "put it beside the scene, or below, or name a folder above both as object.folder"
_TEXT_ENDINGS = (".xml", ".urdf")  # endings of texts that MuJoCo takes for a scene
_SEPARATORS = re.compile(r"[/\\]")
_ABSOLUTE = re.compile(r"[/\\]|.*:[/\\]")


class SceneError(ForeignFileError, ValueError):
    """A scene that cannot be used. The text says why, in one line."""


class OutsideError(SceneError):
    """A scene that names files outside of its folder. folder: the least one that has all of them, "" where that is the root."""

    def __init__(self, text: str, folder: str) -> None:
        super().__init__(text)
        self.folder = folder


@dataclass(frozen=True, slots=True)
class SceneFiles:
    """Texts and other files of a scene.

    name       of the scene, for errors
    main       path of its text from its folder
    files      bytes of each file, by the path from the scene's folder at which MuJoCo looks for it
    options    attributes of <option> that its texts set
    discarded  files that are named and that MuJoCo does not read: of what a URDF shows
    """

    name: str
    main: str
    files: Mapping[str, bytes]
    options: frozenset[str]
    discarded: tuple[str, ...]

    @property
    def root(self) -> str:
        """Return the virtual folder: of its own for each content, as MuJoCo keeps what it has read once by its path."""
        digest = sha256()
        for path, data in sorted(self.files.items()):
            digest.update(f"{path}\0{len(data)}\0".encode() + data)
        return f"/{digest.hexdigest()}/"


def read_scene(path: Path, folder: Path | None = None) -> SceneFiles:
    """Return the files of a scene. folder: of which no file may be outside; None: the scene's own. Raises SceneError."""
    main = path.name
    if folder is not None:
        try:
            main = path.resolve().relative_to(folder.resolve()).as_posix()
        except ValueError:
            raise SceneError(f"{path}: is not in {folder}; name a folder above it as object.folder") from None
    data = _read(path, MOST_BYTES, str(path), "; give MJCF or URDF")
    return _Reader(path.name, (folder or path.parent).resolve()).read(_decoded(data, str(path)), main)


def scene_of(text: str, name: str) -> SceneFiles:
    """Return the scene of a text without a folder. Raises SceneError, also where it names files."""
    return _Reader(name, None).read(text, name)


def _decoded(data: bytes, name: str) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{name}: cannot be read: {error}") from None


def _read(path: Path, most_bytes: int, name: str, cure: str) -> bytes:
    """Return the bytes of a regular file. Raises SceneError where it has more than `most_bytes`, or is none."""
    try:
        if not path.is_file():
            raise SceneError(f"{name}: {'is no regular file' if path.exists() else 'there is no such file'}{cure}")
        with path.open("rb") as file:
            data = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        if isinstance(error, SceneError):
            raise
        raise SceneError(f"{name}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(data) > most_bytes:
        raise SceneError(f"{name}: has more than {most_bytes / 1e6:g} MB; make it smaller")
    return data


def _reduced(path: str) -> str:
    """Return a path as MuJoCo writes it: without dots, and with plain slashes."""
    parts: list[str] = []
    *folders, last = _SEPARATORS.split(path)
    for part in folders:
        if part == ".." and parts and parts[-1] != "..":
            parts.pop()
        elif part != ".":
            parts.append(part)
    return "/".join([*parts, last])


def _joined(folder: str, path: str) -> str:
    return _reduced(path if not folder or _ABSOLUTE.match(path) else f"{folder.rstrip('/')}/{path}")


class _Named(NamedTuple):
    """A file that a text names. what: the element; folder: of the text; visual: a URDF shows it, and nothing else."""

    what: str
    file: str
    folder: str
    visual: bool


@dataclass(slots=True)
class _Model:
    """A model with directories of its own: the scene, or one that it has as an asset. folder: of its text."""

    folder: str
    urdf: bool = False
    compiler: dict[str, str] = field(default_factory=dict)
    named: list[_Named] = field(default_factory=list)
    included: set[str] = field(default_factory=set)

    def looked_for(self, what: str, file: str) -> str:
        """Return where MuJoCo looks for a file first."""
        directory = "texturedir" if what == "texture" else "meshdir"
        if self.compiler.get("strippath") == "true":
            file = _SEPARATORS.split(file)[-1]
        inside = self.compiler.get(directory) or self.compiler.get("assetdir") or ""
        return _joined(self.folder, _joined(inside, file))

    def discards(self, named: _Named) -> bool:
        """Return whether MuJoCo reads a file that is named."""
        return named.visual and self.urdf and self.compiler.get("discardvisual") != "false"


class _Reader:
    """Reads the files of a scene. folder: of which none may be outside; None: it has none."""

    def __init__(self, name: str, folder: Path | None) -> None:
        self._name, self._folder = name, folder
        self._files: dict[str, bytes] = {}
        self._sources: dict[str, Path] = {}
        self._models: set[str] = set()
        self._options: set[str] = set()
        self._discarded: list[str] = []
        self._elements, self._texts = 0, 0
        self._left = MOST_FILES_BYTES
        self._outside: dict[str, list[Path]] = {}
        """Words of an error about a file that is named and not read, and folders that the scene's would have to be above."""

    def read(self, text: str, main: str) -> SceneFiles:
        """Return the files of the scene of this text. Raises SceneError."""
        if not main.lower().endswith(_TEXT_ENDINGS):
            main += _TEXT_ENDINGS[0]
        self._files[main] = text.encode()
        self._model(text, main)
        if self._outside:
            raise self._left_folder()
        discarded = tuple(dict.fromkeys(self._discarded))
        return SceneFiles(self._name, main, self._files, frozenset(self._options), discarded)

    def _model(self, text: str, path: str) -> None:
        self._models.add(path)
        model = _Model(_folder_of(path))
        self._text(text, model, model.folder)
        for named in model.named:
            if model.discards(named):
                self._discarded.append(named.file)
            else:
                self._add(named.what, named.file, model.looked_for(named.what, named.file), named.folder)

    def _text(self, text: str, model: _Model, folder: str) -> None:
        """Take in a text of a model, which lies in this folder, and those that it includes, in their order."""
        self._texts += 1
        if self._texts > MOST_TEXTS:
            raise SceneError(f"{self._name}: includes more than {MOST_TEXTS} files; leave some out")
        for tag, attributes, visual in self._scanned(text):
            if tag == "robot":
                model.urdf = True
            elif tag == "option":
                self._options.update(attributes)
            elif tag == "compiler":
                model.compiler.update(attributes)
            if model.urdf and tag != "mesh":
                continue  # what simulators beside MuJoCo read
            for file in [value for key, value in attributes.items() if key.lower().startswith("file")]:
                if tag not in ("include", "model"):
                    model.named.append(_Named(tag, file, folder, visual))
                    continue
                path = self._add(tag, file, _joined(model.folder, file), folder)
                if path not in self._files:
                    continue  # it is outside, and told at the end
                read = self._models if tag == "model" else model.included
                if path in read:
                    continue  # MuJoCo says what is wrong with that
                read.add(path)
                inner = _decoded(self._files[path], f"{self._name}: {tag} {shown(file)!r}")
                if tag == "model":
                    self._model(inner, path)
                else:
                    assert self._folder is not None
                    self._text(inner, model, _folder_of(self._sources[path].relative_to(self._folder).as_posix()))

    def _scanned(self, text: str) -> Iterator[tuple[str, dict[str, str], bool]]:
        """Yield each element's tag and attributes, and whether it is part of what a URDF shows."""
        found: list[tuple[str, dict[str, str], bool]] = []
        inside: list[str] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            self._elements += 1
            if self._elements > MOST_ELEMENTS:
                raise SceneError(f"{self._name}: has more than {MOST_ELEMENTS} elements; leave some out")
            inside.append(tag)
            lower = tag.lower()
            found.append((lower if lower in ("include", "compiler") else tag, attributes, "visual" in inside))

        def doctype(*_: object) -> None:
            raise SceneError(f"{self._name}: has a document type, which MuJoCo does not read; take the <!DOCTYPE> out")

        parser = expat.ParserCreate("utf-8")
        parser.StartElementHandler = start
        parser.EndElementHandler = lambda tag: inside.pop()
        parser.StartDoctypeDeclHandler = doctype  # so that MuJoCo's reader finds the same elements
        try:
            parser.Parse(text.encode("utf-8"), True)
        except expat.ExpatError as error:
            raise SceneError(f"{self._name}: does not load: {error}") from None
        yield from found

    def _add(self, what: str, file: str, path: str, folder: str) -> str:
        """Read a file that MuJoCo will look for at `path`, else in `folder`. Return `path`. Raises SceneError."""
        told = f"{self._name}: {what} {shown(file)!r}"
        if self._folder is None:
            raise SceneError(f"{told} is a file, and the scene has no folder that it is in")
        source = self._folder / path
        if not source.exists() and (beside := self._folder / _joined(folder, file)).exists():
            source = beside
        source = source.resolve()
        if _ABSOLUTE.match(path):
            raise SceneError(f"{told} is an absolute path; put it beside the scene, or below, and name it from there")
        if path.startswith("../") or not source.is_relative_to(self._folder):
            self._outside.setdefault(told, [source.parent, Path(normpath(self._folder / ("../" * path.count("../"))))])
            return path
        if self._sources.setdefault(path, source) != source:
            raise SceneError(
                f"{told} is one of two files that MuJoCo would take for each other; give them different names"
            )
        if path not in self._files:
            most = MOST_BYTES if what in ("include", "model") else MOST_FILE_BYTES
            self._files[path] = _read(source, most, told, f"; {_INSIDE}")
            self._left -= len(self._files[path])
            if self._left < 0:
                most_mb = MOST_FILES_BYTES / 1e6
                raise SceneError(f"{self._name}: its files have more than {most_mb:g} MB together; make them coarser")
        return path

    def _left_folder(self) -> OutsideError:
        """Return the error of the files that are named and are outside. No more is known of what they name."""
        assert self._folder is not None
        first, count = next(iter(self._outside)), len(self._outside)
        told = f"{first} is outside of the scene's folder" + (f", and {count - 1} more" if count > 1 else "")
        above = Path(commonpath([self._folder, *[folder for folders in self._outside.values() for folder in folders]]))
        if above == Path(above.anchor):
            return OutsideError(f"{told}; put it beside the scene, or below", "")
        return OutsideError(f'{told}; put it beside the scene, or below, or set object.folder = "{above}"', str(above))


def _folder_of(path: str) -> str:
    return path.rpartition("/")[0]


def listed(names: Sequence[str]) -> str:
    """Return the first of some names, and how many more there are."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(map(shown, names[:MOST_NAMED])) + more
