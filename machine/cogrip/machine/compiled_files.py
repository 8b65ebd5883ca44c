"""Report of what `dev.py compile` has left beside the sources of this checkout: which form runs, and is it of these sources?"""

from collections.abc import Iterable, Mapping
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path

from cogrip.machine.addition import add_integers

SUFFIX = EXTENSION_SUFFIXES[0]
SOURCES = (".py", ".pyx", ".pxd")
PARTS = ("machine", "protocol", "devices", "client", "server")  # packages in which modules are compiled
LINUX_ONLY = ("datagram_batch", "large_pages")


def compile_command() -> str:
    """Return the command that compiles this installation: a wheel has what does it, a checkout has it beside its packages."""
    return "cogrip compile" if find_spec("cogrip.cli.compiling") else "python3 dev.py compile"


def folders_of_parts() -> dict[str, Path]:
    """Return the folder of each package in which modules are compiled, by the package's name, and import none of them.

    Not every folder of the namespace `cogrip`: for a script that runs beside a folder called cogrip, such as a checkout with
    its environment, that folder belongs to the namespace too, whatever lies in it.
    """
    found = {f"cogrip.{part}": find_spec(f"cogrip.{part}") for part in PARTS}
    return {name: Path(spec.origin).parent for name, spec in found.items() if spec and spec.origin}


def types_folder() -> Path:
    """Return the folder of what a compiler alone reads: a tree with the places of the modules, in a checkout or in a wheel."""
    here = Path(__file__).resolve().parent
    installed = here / "compiled"
    return installed if installed.exists() else here.parents[2] / "compiled"


def outdated(folders: Iterable[str] = (), types: Path | None = None) -> list[str]:
    """Return the names of modules that were changed after something was compiled: Python would run what is older.

    A compiled module has the values of constants of other modules in it, so all beside compiled ones count. So does one whose
    library is gone: what is left of it is a link.
    folders: to look below, `folders_of_parts` if none is given; types: `types_folder` if none is given
    """
    looked = map(Path, folders or folders_of_parts().values())
    compiled = {folder: list(folder.rglob(f"*{SUFFIX}")) for folder in looked}
    gone = {each for made in compiled.values() for each in made if not each.exists()}
    since_ns = min(
        (each.stat().st_mtime_ns for made in compiled.values() for each in made if each not in gone), default=0
    )
    read = [folder for folder, made in compiled.items() if made] + [types_folder() if types is None else types]
    sources = (each for folder in read for each in folder.rglob("*.p*") if each.suffix in SOURCES)
    newer = {each.stem for each in sources if each.stat().st_mtime_ns > since_ns} if since_ns else set()
    return sorted(newer | {each.name.partition(".")[0] for each in gone})


def compiled_modules() -> Mapping[str, bool]:
    """Return for each module that `dev.py compile` compiles, by name, whether its compiled form is there.

    Those are the modules with a `.pxd` or `.pyx` file in `types_folder`; one with a `.pyx` has no interpreted form, but where a
    `.py` has its name. Python imports a compiled form wherever there is one. Nothing is imported here.
    """
    from cogrip.machine.platform import system  # sockets and all: no command waits for that

    found: dict[str, bool] = {}
    types, parts = types_folder(), folders_of_parts()
    for each in sorted(types.rglob("*.p[xy][dx]")):
        within = each.relative_to(types).with_suffix("")
        folder = parts.get(".".join(within.parts[:2]))
        if folder and (each.stem not in LINUX_ONLY or system.LINUX):
            place = folder.joinpath(*within.parts[2:])
            here = any(place.with_name(each.stem + suffix).exists() for suffix in EXTENSION_SUFFIXES)
            found.setdefault(".".join(within.parts), here)
    return found


def form() -> str:
    """Return "compiled" or "interpreted" where all `compiled_modules` are, else "partly compiled" with the number."""
    here = compiled_modules().values()
    if all(here):
        return "compiled"
    return f"partly compiled: {add_integers(here)} of {len(here)} modules" if any(here) else "interpreted"
