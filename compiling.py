"""Compile the modules that have types for a compiler beside them (docs/decisions/0028-typed-classes.md).

A module `x.py` with an `x.pxd` is compiled as it is, its classes as structs; `x.pyx` is there only compiled, or in place of an
`x.py` with the same functions. The results lie beside their sources and take the place of these when they are imported. They
are no part of the project, and nothing needs them; `dev.py` removes what is of sources that were changed meanwhile.
What is compiled is a copy in which functions have the values of numeric constants in place of their names (`with_values`): a
name of a module is an object in C as well, and each use of it in arithmetic makes another one.
`-ffp-contract=off`: no product and sum are rounded together, so that every number is the interpreted one, bit for bit;
`-fwrapv`: whole numbers wrap.
"""

from __future__ import annotations  # as in dev.py

import ast
import contextlib
import hashlib
import importlib
import json
import math
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Iterator, Mapping
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
    """Return the digest of all sources: of interpreted modules too, whose constants compiled ones have."""
    found = hashlib.sha256(Path(__file__).read_bytes())
    for part in PARTS:
        for path in sorted((ROOT / part / "cogrip").rglob("*.p*")):
            found.update(path.read_bytes() if path.suffix in (".py", ".pyx", ".pxd") else b"")
    return found.hexdigest()


def stale() -> bool:
    """Return whether something is compiled of sources that have been changed since."""
    return STAMP.exists() and json.loads(STAMP.read_text()) != digest()


def remove() -> int:
    """Remove what was compiled, of sources that are gone too, and return the number of modules."""
    modules = set()
    for part in PARTS:
        for suffix in (".so", ".pyd"):
            for each in (ROOT / part / "cogrip").rglob(f"*{suffix}"):
                modules.add(each.with_name(each.name.partition(".")[0]))
                each.unlink()
    STAMP.unlink(missing_ok=True)
    return len(modules)


def has_compiler() -> bool:
    """Return whether there is the C compiler that this Python asks for."""
    return sys.platform == "win32" or shutil.which(str(sysconfig.get_config_var("CC") or "cc").split()[0]) is not None


def constants(module: object) -> dict[str, float]:
    """Return the numeric constants that a module has, its own and imported ones: those that fit into 64 bits."""
    return {
        name: value
        for name, value in vars(module).items()
        if name.isupper() and type(value) in (int, float) and math.isfinite(value) and abs(value) < 2**63
    }


def with_values(source: str, values: Mapping[str, float]) -> str:
    """Return a module's source with these values in place of their names, in all functions but constructors.

    A constructor, which runs once, keeps the names. No line is moved.
    """
    lines = source.encode().split(b"\n")
    named = sorted({(each.lineno, each.col_offset, each.id) for each in _names(ast.parse(source), False)}, reverse=True)
    for line, column, name in named:
        if name in values:
            text = lines[line - 1]
            lines[line - 1] = text[:column] + b"(%r)" % values[name] + text[column + len(name) :]
    return b"\n".join(lines).decode()


def _names(node: ast.AST, inside: bool) -> Iterator[ast.Name]:
    """Yield the names that functions read and do not bind. inside: whether this is a part of one."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.JoinedStr) or getattr(child, "name", "") == "__init__":
            continue  # the places of names in a formatted text are not known before Python 3.12
        function = isinstance(child, (ast.FunctionDef, ast.Lambda))
        bound = set(_bound(child)) if function else set()
        yield from (each for each in _names(child, inside or function) if each.id not in bound)
        if inside and isinstance(child, ast.Name) and isinstance(child.ctx, ast.Load):
            yield child


def _bound(function: ast.AST) -> Iterator[str]:
    """Yield the names that a function binds."""
    for each in ast.walk(function):
        if isinstance(each, ast.arg):
            yield each.arg
        elif isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
            yield each.id


def copy_sources(folder: Path) -> list[tuple[str, Path]]:
    """Write what is compiled of each source into a folder. Return the modules: name, and path in the folder."""
    found = []
    for name, source in sources():
        path = source.relative_to(ROOT)
        text = source.read_text("utf-8")
        if path.suffix == ".py":
            text = with_values(text, constants(importlib.import_module(name)))
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, "utf-8")
        found.append((name, path))
    return found


def compile_all(folder: Path, checkout: Path = ROOT) -> None:
    """Compile everything in a folder, then put it beside the sources of a checkout: an error leaves what was there."""
    from Cython.Build import cythonize
    from setuptools import Distribution, Extension  # type: ignore[import-untyped]

    flags = [] if sys.platform == "win32" else FLAGS
    copies = copy_sources(folder / "source")
    modules = [Extension(name, [str(path)], extra_compile_args=flags) for name, path in copies]
    with contextlib.chdir(folder / "source"):  # tracebacks name the sources as they lie in a checkout
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
