"""Child processes of a benchmark: modules of this folder, and `cogrip` commands."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

from cogrip.cli.terminal.problem import Problem

ROOT = Path(__file__).resolve().parents[2]


def start_python(*arguments: str, stdin: int | IO[bytes] = subprocess.PIPE) -> subprocess.Popen[bytes]:
    """Start `python ARGUMENTS` with this checkout's `tests` on its path, whatever the folder and the environment are."""
    return subprocess.Popen(
        [sys.executable, "-P", *arguments], stdin=stdin, stdout=subprocess.PIPE, env=with_tests_on_path()
    )  # fmt: skip


def with_tests_on_path() -> dict[str, str]:
    """Return this process's environment, with which a Python started with -P can import `tests`."""
    path = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}


def start_cogrip(*arguments: str, **options: Any) -> subprocess.Popen[str]:
    """Start `cogrip ARGUMENTS`; its messages, errors included, are its standard output."""
    return subprocess.Popen(
        [sys.executable, "-P", "-u", "-m", "cogrip.cli", *arguments],
        **{
            "stdin": subprocess.DEVNULL,
            "stdout": subprocess.PIPE,
            "stderr": subprocess.STDOUT,
            "text": True,
            **options,
        },
    )


def wait_for_line(process: subprocess.Popen[str], pattern: str) -> re.Match[str]:
    """Wait until the process has printed a match. Raises Problem where it ends without."""
    assert process.stdout is not None
    printed = ""
    while not (found := re.search(pattern, printed)):
        line = process.stdout.readline()
        if not line:
            raise Problem(f"a process ended with code {process.wait()} before {pattern!r}:\n{printed.strip()}")
        printed += line
    return found


def output_at_end(process: subprocess.Popen[str], limit_s: float) -> tuple[str, bool]:
    """Wait for the end, and kill the process after `limit_s`. Return what it printed, and whether it ended with code 0."""
    try:
        printed, _ = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        process.kill()
        printed, _ = process.communicate()
        return f"did not end in {limit_s:g} s: {printed.strip()}", False
    return printed.strip(), process.returncode == 0
