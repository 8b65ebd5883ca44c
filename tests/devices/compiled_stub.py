"""Stand-ins for the vendors' C libraries, compiled where the tests run."""

import shutil
import subprocess
from pathlib import Path

import pytest

STUBS = Path(__file__).parent / "stubs"


def compile_stub(source: Path, target: Path, *flags: str) -> Path:
    """A shared object; a session without a compiler goes on without it."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip(f"no C compiler (gcc, cc): {target.name} cannot be made of {source.name}")
    common = ["-O1", "-Wall", "-Wextra", "-shared", "-fPIC", "-pthread"]
    subprocess.run([compiler, *common, "-o", str(target), str(source), *flags], check=True)
    return target
