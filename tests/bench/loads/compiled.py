"""Programs in C and C++ beside benchmarks, compiled where there is a compiler."""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from cogrip.cli.terminal.problem import Problem

COMPILERS = {".c": ("cc", "gcc", "clang"), ".cpp": ("c++", "g++", "clang++")}
STANDARDS = {".c": "gnu99", ".cpp": "gnu++17"}


def compiler_of(suffix: str) -> str | None:
    """Return the compiler for sources that end so, where there is one."""
    return next(filter(None, map(shutil.which, COMPILERS[suffix])), None)


@cache
def compiled(name: str, options: Sequence[str] = ()) -> Path:
    """Return the program made of this source file of this folder. Raises Problem where it cannot be compiled."""
    source = Path(__file__).with_name(name)
    compiler = compiler_of(source.suffix)
    if compiler is None:
        names = ", ".join(COMPILERS[source.suffix])
        raise Problem(f"this benchmark has a part in C: {name} needs a compiler, and none ({names}) is installed")
    built = Path(_folder().name) / source.stem
    done = subprocess.run(
        [compiler, f"-std={STANDARDS[source.suffix]}", "-O2", "-o", built, source, *options],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise Problem(f"{source.name} cannot be compiled here (it is for Linux):\n{done.stderr.strip()}")
    return built


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    return tempfile.TemporaryDirectory(prefix="cogrip-bench-")  # removed when this process ends
