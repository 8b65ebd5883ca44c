"""The C twin of a server (`twin.c`), compiled where there is a compiler."""

import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from cogrip.cli.terminal.problem import Problem

SOURCE = Path(__file__).with_name("twin.c")
COMPILERS = ("cc", "gcc", "clang")


def start_twin(core: int | None) -> subprocess.Popen[bytes]:
    """Start it on this processor. Raises Problem where it cannot be compiled."""
    place = [] if core is None else [str(core)]
    return subprocess.Popen([str(_compiled()), *place], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


@cache
def _compiled() -> Path:
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise Problem(f"bench peers compares with a server in C: no compiler ({', '.join(COMPILERS)}) is installed")
    built = Path(_folder().name) / "twin"
    done = subprocess.run(
        [compiler, "-std=c99", "-O2", "-o", built, SOURCE], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise Problem(f"bench peers: {SOURCE.name} cannot be compiled here (it is for Linux):\n{done.stderr.strip()}")
    return built


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    return tempfile.TemporaryDirectory(prefix="cogrip-bench-")  # removed when this process ends
