"""Compile the modules that have types for a compiler beside them (docs/decisions/0028-typed-classes.md).

A module `x.py` with an `x.pxd` is compiled as it is, its classes as structs; `x.pyx` is there only compiled, or in place of an
`x.py` with the same functions. The results lie beside their sources and take the place of these when they are imported. They
are no part of the project, and nothing needs them; `dev.py` removes what is of sources that were changed meanwhile.
`-ffp-contract=off`: no product and sum are rounded together, so that every number is the interpreted one, bit for bit;
`-fwrapv`: whole numbers wrap.
"""

from __future__ import annotations  # as in dev.py

import hashlib
import json
import shutil
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent
PARTS = ("protocol", "devices", "client", "server")
SUFFIX = str(sysconfig.get_config_var("EXT_SUFFIX"))
FLAGS = ["-O2", "-ffp-contract=off", "-fwrapv", "-fno-strict-aliasing", "-w", "-g0"]
STAMP = ROOT / ".venv" / "cogrip-compiled.json"  # digest of the sources of what is compiled
LINUX_ONLY = ("datagram_batch",)
DIRECTIVES = {
    "language_level": 3,
    "annotation_typing": False,  # a float in an annotation would turn 2 into 2.0; types stand in .pxd files alone
    "binding": False,
    "nonecheck": True,  # an attribute of None raises, as it does interpreted, and does not end the process
}


def sources() -> list[tuple[str, Path]]:
    """Return the modules to compile: name and source."""
    found = []
    for part in PARTS:
        for path in sorted((ROOT / part / "cogrip").rglob("*.p[xy][dx]")):
            source = path.with_suffix(".py") if path.suffix == ".pxd" else path
            if path.suffix == ".pxd" and path.with_suffix(".pyx").exists():
                continue
            if path.stem in LINUX_ONLY and sys.platform != "linux":
                continue
            found.append((".".join(source.relative_to(ROOT / part).with_suffix("").parts), source))
    return found


def digest() -> str:
    """Return the digest of all sources."""
    found = hashlib.sha256()
    for _, source in sources():
        for path in (source, source.with_suffix(".pxd")):
            found.update(path.read_bytes() if path.exists() else b"")
    return found.hexdigest()


def stale() -> bool:
    """Return whether something is compiled of sources that have been changed since."""
    return STAMP.exists() and json.loads(STAMP.read_text()) != digest()


def remove() -> int:
    """Remove what was compiled, and return the number of modules."""
    count = 0
    for _, source in sources():
        found = [*source.parent.glob(f"{source.stem}.*.so"), *source.parent.glob(f"{source.stem}.*.pyd")]
        for each in found:
            each.unlink()
        count += bool(found)
    STAMP.unlink(missing_ok=True)
    return count


def has_compiler() -> bool:
    """Return whether there is the C compiler that this Python asks for."""
    return sys.platform == "win32" or shutil.which(str(sysconfig.get_config_var("CC") or "cc").split()[0]) is not None


def compile_all(folder: Path, checkout: Path = ROOT) -> None:
    """Compile everything in a folder, then put it beside the sources of a checkout: an error leaves what was there."""
    from Cython.Build import cythonize
    from setuptools import Distribution, Extension  # type: ignore[import-untyped]

    flags = [] if sys.platform == "win32" else FLAGS
    modules = [Extension(name, [str(source)], extra_compile_args=flags) for name, source in sources()]
    generated = cythonize(  # type: ignore[no-untyped-call]
        modules, include_path=[str(ROOT / part) for part in PARTS], build_dir=str(folder / "c"), force=True, quiet=True,
        compiler_directives=DIRECTIVES,
    )  # fmt: skip
    command = Distribution({"ext_modules": generated}).get_command_obj("build_ext")
    command.build_lib, command.build_temp = str(folder / "lib"), str(folder / "objects")
    command.parallel = True
    command.ensure_finalized()
    command.run()
    for name, source in sources():
        made = Path(*name.split(".")).with_name(name.rpartition(".")[2] + SUFFIX)
        shutil.copy(folder / "lib" / made, checkout / source.relative_to(ROOT).with_name(made.name))


def main(arguments: list[str]) -> int:
    removed = remove()
    if arguments == ["--remove"]:
        what = f"removed {removed} compiled module{'' if removed == 1 else 's'}" if removed else "nothing was compiled"
        print(f"{what}; cogrip runs interpreted")
        return 0
    if not has_compiler():
        print(
            "dev.py compile: there is no C compiler (Debian, Ubuntu: `apt install gcc python3-dev`); cogrip runs without"
        )
        return 1
    with tempfile.TemporaryDirectory() as folder:
        try:
            wanted = digest()
            compile_all(Path(folder))
            STAMP.write_text(json.dumps(wanted))
        except Exception as error:  # noqa: BLE001 - whatever a compiler or its set-up lacks
            print(f"dev.py compile: {type(error).__name__}: {error}; cogrip runs interpreted, as before")
            return 1
    print(f"compiled {len(sources())} modules; `python3 dev.py compile --remove` removes them")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
