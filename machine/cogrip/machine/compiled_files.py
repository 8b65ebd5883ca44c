"""Choice of the form that a process runs, compiled or interpreted, for all of its modules at once (docs/decisions/0028).

What `dev.py compile` makes, or a wheel of one platform brings, lies in `built_folder`: libraries in a folder of their own for
each time, and `NAME`, which tells their modules and the sources that these are of. It is used where nothing of those sources
has changed since, whatever becomes of it while the process runs; so no process ever has modules of both forms, or of two times.
A process started by one that has chosen has the same form.
"""

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec
from importlib.util import find_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

SUFFIX = EXTENSION_SUFFIXES[0]
NAME = f"form{SUFFIX.removesuffix('.so').removesuffix('.pyd')}.json"  # file that tells what was built for this kind of Python
SOURCES = (".py", ".pyx", ".pxd")
PARTS = ("machine", "protocol", "devices", "client", "server")  # packages in which modules are compiled
LINUX_ONLY = ("datagram_batch", "large_pages")
CHOSEN = "COGRIP_FORM"  # environment variable: "interpreted", or the file that tells what was built

NEVER = "nothing was compiled"
OTHERS = "what was compiled is of other sources"


class Fingerprint(NamedTuple):
    """Number of sources, bytes of them, and when the newest was changed [ns]: where it is the same, none has changed."""

    sources: int
    size: int
    newest_ns: int


def compile_command() -> str:
    """Return the command that compiles this installation: a wheel has what does it, a checkout has it beside its packages."""
    return "cogrip compile" if find_spec("cogrip.cli.compiling") else "python3 dev.py compile"


def part_folders() -> dict[str, Path]:
    """Return the folder of each package in which modules are compiled, by its name. None is imported."""
    here = Path(__file__).resolve().parent  # .../cogrip/machine, of a wheel or of a checkout
    beside = here.parent if (here.parent / "protocol").exists() else None
    return {f"cogrip.{part}": beside / part if beside else here.parents[2] / part / "cogrip" / part for part in PARTS}


def types_folder() -> Path:
    """Return the folder of what a compiler alone reads: a tree with the places of the modules, in a checkout or in a wheel."""
    here = Path(__file__).resolve().parent
    installed = here / "compiled"
    return installed if installed.exists() else here.parents[2] / "compiled"


def built_folder() -> Path:
    """Return the folder of what was compiled, which in a checkout is no part of it."""
    types = types_folder()
    return types / "built" if types.parent.name == "machine" else types.parent / ".built"


def _sources(folders: Iterable[Path] | None) -> Iterator[os.DirEntry[str]]:
    """Yield the sources in some folders in one order; for None all that there are.

    All count, as a compiled module has the values of constants of others in it.
    """
    types = str(types_folder())  # in a wheel within a part
    for folder in folders or (*part_folders().values(), types_folder() / "cogrip"):
        waiting = [str(folder)]
        while waiting:
            with os.scandir(waiting.pop()) as entries:
                for each in sorted(entries, key=lambda entry: entry.name):
                    if each.name.endswith(SOURCES):
                        yield each
                    elif each.is_dir() and each.name != "__pycache__" and each.path != types:
                        waiting.append(each.path)


def fingerprint(folders: Iterable[Path] | None = None) -> Fingerprint:
    """Return the fingerprint of all sources, which opens none of them."""
    number = size = newest_ns = 0
    for each in _sources(folders):
        known = each.stat()
        number, size, newest_ns = number + 1, size + known.st_size, max(newest_ns, known.st_mtime_ns)
    return Fingerprint(number, size, newest_ns)


def checksum(folders: Iterable[Path] | None = None) -> int:
    """Return the CRC-32 of names and contents of all sources: the same wherever they lie, and whenever they were put there."""
    from zlib import crc32

    found = 0
    for each in _sources(folders):
        found = crc32(Path(each.path).read_bytes(), crc32(each.name.encode(), found))
    return found


class CompiledModules:
    """Finder of compiled modules, for `sys.meta_path`. sources, checksum: of what they were made of"""

    def __init__(self, folder: Path, libraries: Mapping[str, str], sources: Fingerprint, checksum: int) -> None:
        self.folder, self.libraries, self.sources, self.checksum = folder, libraries, sources, checksum

    def are_current(self) -> bool:
        """Return whether they were made of the sources that are there. Those are read only where their times differ."""
        now = fingerprint()
        return now == self.sources or (now[:2] == self.sources[:2] and checksum() == self.checksum)

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Return where the compiled form of a module is, None where there is none."""
        library = self.libraries.get(name)
        if library is None:
            return None
        place = str(self.folder / library)
        return spec_from_file_location(name, place, loader=ExtensionFileLoader(name, place))


def read_built(file: Path) -> CompiledModules | None:
    """Return what was built, by the file that tells it; None where it is not whole."""
    try:
        text = file.read_text("utf-8")
    except OSError:
        return None  # as nearly always where nothing was compiled: no reader of it is imported
    import json

    try:
        told = json.loads(text)
        folder, libraries = file.parent / told["folder"], dict(told["libraries"])
        whole = all((folder / each).is_file() for each in set(libraries.values()))
        return CompiledModules(folder, libraries, Fingerprint(*told["sources"]), told["checksum"]) if whole else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def chosen() -> CompiledModules | None:
    """Return the compiled modules that this process has, None where it runs interpreted."""
    return next((each for each in sys.meta_path if isinstance(each, CompiledModules)), None)


def choose() -> None:
    """Choose the form of this process: called as `cogrip.machine` is imported, before any module that has two."""
    if chosen() is not None:
        return
    before, modules = os.environ.get(CHOSEN, ""), None
    if before != "interpreted" and (built := read_built(built_folder() / NAME)) is not None:
        modules = built if before == str(built.folder) or built.are_current() else None
    if modules is not None:
        sys.meta_path.insert(0, modules)
    os.environ[CHOSEN] = str(modules.folder) if modules is not None else "interpreted"


def form() -> str:
    """Return "compiled" or "interpreted"."""
    return "interpreted" if chosen() is None else "compiled"


def why_interpreted() -> str:
    """Return why this process, or the next one, runs interpreted; "" where it does not."""
    built = read_built(built_folder() / NAME)
    if built is None:
        return NEVER
    return "" if built.are_current() else OTHERS
