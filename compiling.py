"""Compile the modules that have types for a compiler (docs/decisions/0028-typed-classes.md).

Types for a compiler stand in a tree of their own, `compiled/`, in the places of their modules. A module `x.py` with an `x.pxd`
there is compiled as it is, its classes as structs; `x.pyx` is there only compiled, or in place of an `x.py` with the same
functions. The results lie in `.built` (of a wheel in `compiled/built`); a process has all of them from its start on, or none
(`cogrip.machine.compiled_files`). They are no part of the project, and nothing needs them.
In a wheel this file is `cogrip.cli.compiling`, for `cogrip compile`; what it makes is entered in the list of what pip has
installed, so that pip removes it with the version that it is of.
What is compiled is a copy in which functions have the values of numeric constants in place of their names (`with_values`): a
name of a module is an object in C as well, and each use of it in arithmetic makes another one.
What a tick never does is out of its way, as a processor forgets pages and lines of code between two ticks: the paths to a
traceback are put together at the end of a module (`COLD`), loops are not aligned. On Linux many modules are one library, in
which functions are sorted by name: the typed ones, which a tick runs through, stand together (`link_together`).
What Python alone calls, and no C function, is compiled with `-O1`, all else with `-O2` (`with_plain_wrappers`); all with `-O2`
takes a third longer. What many modules need of Cython's own is one module of its own (`SHARED`).
`-ffp-contract=off`: no product and sum are rounded together, so that every number is the interpreted one, bit for bit;
`-fwrapv`: whole numbers wrap.
"""

from __future__ import annotations  # as in dev.py

import ast
import contextlib
import csv
import importlib
import importlib.util
import json
import math
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
INSTALLED = not (HERE / "pyproject.toml").exists()  # whether this file is cogrip/cli/compiling.py of a wheel
ROOT = HERE.parents[1] if INSTALLED else HERE
COMMAND = "cogrip compile" if INSTALLED else "python3 dev.py compile"
TYPES = ROOT / ("cogrip/machine/compiled" if INSTALLED else "compiled")  # tree of what a compiler alone reads
PARTS = ("machine", "protocol", "devices", "client", "server")
BUILT = TYPES / "built" if INSTALLED else ROOT / ".built"
SUFFIX = str(sysconfig.get_config_var("EXT_SUFFIX"))
ARITHMETIC = ["-ffp-contract=off", "-fwrapv", "-fno-strict-aliasing", "-falign-loops=1", "-falign-jumps=1"]
FLAGS = ["-O2", *ARITHMETIC, "-ffunction-sections", "-fdata-sections", "-w", "-g0"]
_AGAIN = ", ".join(f'"{each[2:]}"' for each in ARITHMETIC)
PLAIN = f'__attribute__((optimize("O1", {_AGAIN})))'
"""Attribute of gcc. What is no level of optimization is named again: it may be set anew with the level."""
SHARED = "cogrip.machine.shared_by_compiled_modules"  # there only compiled
COLD = "static void __Pyx_AddTraceback(const char *, int, int, const char *) __attribute__((cold));\n"
"""Declaration ahead of each module's C code: the compiler takes every path to this function for one that is not taken."""
LINKER_FLAGS = ["-Wl,-z,noseparate-code,-z,norelro,-z,now", "-Wl,--sort-section=name"]  # flags of the linker on Linux
LINUX_ONLY = ("datagram_batch", "large_pages")
DIRECTIVES = {
    "language_level": 3,
    "annotation_typing": False,  # a float in an annotation would turn 2 into 2.0; types stand in .pxd files alone
    "binding": False,
    "auto_pickle": False,  # nobody pickles them
    "emit_code_comments": False,
    "show_performance_hints": False,
    "nonecheck": True,  # an attribute of None raises, as it does interpreted, and does not end the process
}


def files() -> Any:
    """Return the module `cogrip.machine.compiled_files` of this checkout or wheel, which needs no other one."""
    source = folder_of("machine") / ("" if INSTALLED else "machine") / "compiled_files.py"
    spec = importlib.util.spec_from_file_location("compiled_files", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def base_of(part: str) -> Path:
    """Return the folder from which a part's modules are imported."""
    return ROOT if INSTALLED else ROOT / part


def folder_of(part: str) -> Path:
    """Return the folder of a part's modules."""
    return base_of(part) / "cogrip" / part if INSTALLED else base_of(part) / "cogrip"


def sources() -> list[tuple[str, Path]]:
    """Return the modules to compile: name and source."""
    found = []
    for types in sorted(TYPES.rglob("*.p[xy][dx]")):
        within = types.relative_to(TYPES)
        if types.suffix == ".pxd" and types.with_suffix(".pyx").exists():
            continue
        if types.stem in LINUX_ONLY and sys.platform != "linux":
            continue
        source = types if types.suffix == ".pyx" else base_of(within.parts[1]) / within.with_suffix(".py")
        found.append((".".join(within.with_suffix("").parts), source))
    return found


def stale() -> bool:
    """Return whether nothing was compiled of the sources as they are."""
    known = files()
    return bool(known.why_interpreted())


def remove(built: Path = BUILT) -> int:
    """Remove what was compiled, and return the number of modules."""
    number = 0
    for told in built.glob("form*.json"):
        with contextlib.suppress(ValueError, KeyError):
            number += len(json.loads(told.read_text("utf-8"))["libraries"])
        told.unlink()  # first: no process may choose what is being removed
    if built.exists():
        shutil.rmtree(built)
    enter([])
    return number


def enter(made: Iterable[Path]) -> None:
    """Have pip's list of the files of an installed cogrip, RECORD, name these of all that was compiled, and no others."""
    if not INSTALLED:
        return
    for record in ROOT.glob("cogrip-*.dist-info/RECORD"):
        rows = list(csv.reader(record.read_text("utf-8").splitlines()))
        ours = [row for row in rows if "/compiled/built/" not in row[0]]
        ours += [[each.relative_to(ROOT).as_posix(), "", ""] for each in made]
        if ours != rows:
            with record.open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(ours)


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
    """Return a module's source with these values in place of their names, in bodies of all functions but constructors.

    A constructor, which runs once, keeps the names. No line is moved.
    """
    lines, tree = source.encode().split(b"\n"), ast.parse(source)
    changing = {name for each in ast.walk(tree) if isinstance(each, ast.Global) for name in each.names}
    named = {(each.lineno, each.col_offset, each.id) for each in _names(tree, None) if each.id not in changing}
    for line, column, name in sorted(named, reverse=True):
        if name in values:
            text = lines[line - 1]
            lines[line - 1] = text[:column] + b"(%r)" % values[name] + text[column + len(name) :]
    return b"\n".join(lines).decode()


def _names(node: ast.AST, bound: set[str] | None) -> Iterator[ast.Name]:
    """Yield the names that functions read and do not bind. bound: by the functions around; None outside of any."""
    if isinstance(node, ast.JoinedStr) or getattr(node, "name", "") == "__init__":
        return  # the places of names in a formatted text are not known before Python 3.12
    parts = ast.iter_child_nodes(node)
    if isinstance(
        node, (ast.FunctionDef, ast.Lambda)
    ):  # not its default values and decorators: they are of the scope around
        bound = {*(bound or ()), *_bound(node)}
        parts = iter(node.body if isinstance(node.body, list) else [node.body])
    elif bound is not None and isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id not in bound:
        yield node
    for part in parts:
        yield from _names(part, bound)


def _bound(function: ast.AST) -> Iterator[str]:
    """Yield the names that a function, or something in it, binds."""
    for each in ast.walk(function):
        if isinstance(each, ast.Name) and not isinstance(each.ctx, ast.Load):
            yield each.id
        for field in (
            "arg",
            "name",
            "asname",
            "rest",
        ):  # of arguments, patterns, imports, handlers, functions and classes
            if isinstance(name := getattr(each, field, None), str):
                yield name


def copy_sources(folder: Path) -> list[tuple[str, Path]]:
    """Write what is compiled of each source into a folder. Return the modules: name, and path in the folder."""
    found = []
    for name, source in sources():
        place = base_of(name.split(".")[1]) / Path(*name.split("."))
        path = place.relative_to(ROOT).with_name(_last(name) + source.suffix)
        text = source.read_text("utf-8")
        if path.suffix == ".py":
            module = importlib.import_module(name)
            found_at = Path(str(module.__file__)).resolve()
            if found_at != source.resolve():
                raise ImportError(f"{name} is imported from {found_at} and not from {source}; look at PYTHONPATH")
            text = with_values(text, constants(module))
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, "utf-8")
        found.append((name, path))
    return found


def compile_all(folder: Path, built: Path) -> None:
    """Compile everything in a folder, then put it into another one, from which processes that start then take it.

    Raises RuntimeError where sources were changed meanwhile.
    """
    from Cython.Build import cythonize
    from setuptools import Distribution, Extension  # type: ignore[import-untyped]

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cold.h").write_text(COLD, "utf-8")
    flags = [] if sys.platform == "win32" else [*FLAGS, "-include", str(folder.resolve() / "cold.h")]
    linker_flags = LINKER_FLAGS if sys.platform == "linux" else []
    known, checksum = files().fingerprint(), files().checksum()
    copies = copy_sources(folder / "source")
    modules = [
        Extension(name, list(map(str, paths)), extra_compile_args=flags, extra_link_args=linker_flags)
        for name, *paths in (*copies, (SHARED,))
    ]
    with contextlib.chdir(folder / "source"):  # tracebacks name the sources as they lie in a checkout
        generated = cythonize(  # type: ignore[no-untyped-call]
            modules, include_path=[str(TYPES)], build_dir=str(folder / "c"), force=True, nthreads=os.cpu_count() or 1,
            quiet=True, compiler_directives=DIRECTIVES, shared_utility_qualified_name=SHARED,
        )  # fmt: skip
    for source in [Path(each.sources[0]) for each in generated if sys.platform == "linux"]:
        source.write_text(with_plain_wrappers(source.read_text("utf-8")), "utf-8")
    command = Distribution({"ext_modules": generated}).get_command_obj("build_ext")
    command.build_lib, command.build_temp = str(folder / "lib"), str(folder / "objects")
    command.parallel = True
    command.ensure_finalized()
    command.run()
    if sys.platform == "linux":
        with contextlib.chdir(folder / "source"):
            objects = {
                each.name: command.compiler.object_filenames(each.sources, output_dir=command.build_temp)
                for each in generated
            }
            made = link_together(command.compiler, objects, folder.resolve())
    else:
        made = {name: Path(command.get_ext_fullpath(name)) for name in (each.name for each in generated)}
    if files().checksum() != checksum:
        raise RuntimeError("sources were changed meanwhile")
    put(made, built, known, checksum)


def with_plain_wrappers(source: str) -> str:
    """Return a module's C code in which functions that Python calls, and the module's start, have the attribute `PLAIN`.

    C functions keep the level of the command line, and with it what is inlined into them: gcc inlines none of a lower level.
    """
    wrapper = re.compile(r"^static (?=[^\n;{}(=]*\b__pyx_(?:pw|pf|getprop|setprop|pymod)_\w+\()", re.MULTILINE)
    return wrapper.sub(f"static {PLAIN} ", source)


def compile_into(folder: Path) -> None:
    """Compile this checkout in a process of its own, for a wheel that is being built, into a folder.

    Raises SystemExit where that fails; the process has said why.
    """
    paths = os.pathsep.join([*map(str, map(base_of, PARTS)), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-P", str(HERE / "compiling.py"), "--into", str(folder)]
    if subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, check=False).returncode:
        raise SystemExit(
            "a wheel with the compiled form could not be built: see above; HATCH_BUILD_HOOKS_ENABLE= leaves it out"
        )


def link_together(compiler: Any, objects: Mapping[str, list[str]], folder: Path) -> dict[str, Path]:
    """Link the object files of modules to few libraries in a folder. Return the library of each module.

    Python finds a module in a library by the last part of its name, so that each library has no two of the same.
    """
    made = {}
    for number, names in enumerate(shared_libraries(objects)):
        library = folder / f"{number}{SUFFIX}"
        linked = [each for name in names for each in objects[name]]
        compiler.link_shared_object(linked, str(library), extra_postargs=LINKER_FLAGS)
        made.update(dict.fromkeys(names, library))
    return made


def put(made: Mapping[str, Path], built: Path, sources: Iterable[int], checksum: int) -> None:
    """Copy libraries into a new folder, then tell at one blow that they are there. The ones before stay for who has them.

    made: library of each module; sources, checksum: of what they were made of
    """
    folder = built / f"{time.time_ns():x}"
    folder.mkdir(parents=True)
    names = {library: f"{number}{SUFFIX}" for number, library in enumerate(sorted(set(made.values())))}
    for library, name in names.items():
        shutil.copy(library, folder / name)
    told = built / files().NAME
    with contextlib.suppress(OSError, ValueError, KeyError):
        before = json.loads(told.read_text("utf-8"))["folder"]
        for each in built.iterdir():
            if each.is_dir() and each.name not in (before, folder.name):
                shutil.rmtree(each)
    libraries = {name: names[library] for name, library in made.items()}
    text = {"folder": folder.name, "libraries": libraries, "sources": [*sources], "checksum": checksum}
    draft = folder / "form.json"
    draft.write_text(json.dumps(text), "utf-8")
    draft.replace(told)


def shared_libraries(names: Iterable[str]) -> list[list[str]]:
    """Divide modules into those of one library each: of a server, which no client loads, and all others."""
    libraries: list[list[str]] = []
    for name in sorted(names):
        of_server = name.startswith("cogrip.server.")
        for library in libraries:
            fits = library[0].startswith("cogrip.server.") is of_server
            if fits and _last(name) not in map(_last, library):
                library.append(name)
                break
        else:
            libraries.append([name])
    return libraries


def _last(name: str) -> str:
    return name.rpartition(".")[2]


def in_background() -> bool:
    """Start compiling in a process of its own, which begins as whoever called this has ended, and takes what others leave.

    Return False where there is nothing to do, or no compiler.
    """
    if sys.platform == "win32" or not has_compiler() or not stale():
        return False
    (BUILT).mkdir(exist_ok=True)
    with (BUILT / "log").open("w", encoding="utf-8") as log:
        subprocess.Popen(
            [str(ROOT / ".venv/bin/python"), str(HERE / "compiling.py"), "--background", str(os.getpid())],
            stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
        )  # fmt: skip
    return True


def wait_in_background(starter: int) -> bool:
    """Wait until the process that started this one has ended. Return False where another one compiles already."""
    if sys.platform == "win32":
        return False
    import fcntl

    lock = os.open(BUILT / "lock", os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until this process ends
    except OSError:
        return False
    os.nice(19)
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    while os.getppid() == starter:
        time.sleep(0.5)
    return stale()


def main(arguments: list[str]) -> int:
    os.environ["COGRIP_FORM"] = "interpreted"  # what is imported below are the sources
    if arguments[:1] == ["--background"] and not wait_in_background(int(arguments[1])):
        return 0
    if arguments == ["--remove"]:
        try:
            removed = remove()
        except OSError as error:
            print(f"{COMMAND}: {error.filename}: {error.strerror}; run it as whoever installed cogrip")
            return 1
        what = f"removed {removed} compiled module{'' if removed == 1 else 's'}" if removed else "nothing was compiled"
        print(f"{what}; cogrip runs interpreted")
        return 0
    if not has_compiler():
        print(f"{COMMAND}: there is no C compiler (Debian, Ubuntu: `apt install gcc python3-dev`); cogrip runs without")
        return 1
    built = Path(arguments[1]) if arguments[:1] == ["--into"] else BUILT
    with tempfile.TemporaryDirectory() as folder:
        try:
            compile_all(Path(folder), built)
            enter(each for each in BUILT.rglob("*") if each.is_file())
        except OSError as error:
            print(f"{COMMAND}: {error.filename}: {error.strerror}; run it as whoever installed cogrip")
            return 1
        except Exception as error:  # noqa: BLE001 - whatever a compiler or its set-up lacks
            lacks = isinstance(error, ImportError) and INSTALLED
            cure = "; pip install 'cogrip[compile]' has what it needs" if lacks else ""
            print(f"{COMMAND}: {type(error).__name__}: {error}{cure}; cogrip runs as before")
            return 1
    cure = f"; `{COMMAND} --remove` removes them" if built == BUILT else ""
    print(f"compiled {len(sources())} modules{cure}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
