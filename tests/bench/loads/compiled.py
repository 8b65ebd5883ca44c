"""Programs in C beside benchmarks, compiled where there is a compiler."""

import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from cogrip.cli.terminal.problem import Problem

COMPILERS = ("cc", "gcc", "clang")


@cache
def compiled(name: str) -> Path:
    """Return the program made of NAME.c in this folder. Raises Problem where it cannot be compiled."""
    source = Path(__file__).with_name(f"{name}.c")
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise Problem(f"this benchmark has a part in C: no compiler ({', '.join(COMPILERS)}) is installed")
    built = Path(_folder().name) / name
    done = subprocess.run(
        [compiler, "-std=gnu99", "-O2", "-o", built, source], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise Problem(f"{source.name} cannot be compiled here (it is for Linux):\n{done.stderr.strip()}")
    return built


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    return tempfile.TemporaryDirectory(prefix="cogrip-bench-")  # removed when this process ends
