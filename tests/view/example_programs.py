"""The example clients of `docs/examples`, as programs."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
LIMIT_S = 60.0


def example(name: str) -> list[str]:
    """Return how to start an example."""
    begin = [sys.executable] if name.endswith(".py") else node()
    return [*begin, str(EXAMPLES / name)]


def node() -> list[str]:
    """Return how to start Node with a global WebSocket: as it is from 22 on, behind a flag in 20."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("Node is not here")
    asks = ["--eval", "process.exit(globalThis.WebSocket ? 0 : 1)"]
    for flags in ([], ["--no-warnings", "--experimental-websocket"]):
        if subprocess.run([program, *flags, *asks], capture_output=True, timeout=LIMIT_S, check=False).returncode == 0:
            return [program, *flags]
    pytest.skip("Node is here, but has no WebSocket: it is older than 20.10")


@contextmanager
def started(command: list[str], *arguments: str) -> Iterator[subprocess.Popen[str]]:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*command, *arguments], **pipes, text=True) as client:  # type: ignore[call-overload]
        try:
            yield client
        finally:
            client.kill()
