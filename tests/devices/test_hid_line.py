"""The real package hidapi, with both its backends, on a stub of the C library beneath it.

The scenarios run in a program of their own below `LD_PRELOAD`, once for each backend; the tests ask what came of each.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.devices.compiled_stub import STUBS, compile_stub
from tests.devices.hid_program import SCENARIOS

ROOT = Path(__file__).parents[2]
PROGRAM = "tests.devices.hid_program"
BACKENDS = {"hidraw": "hidraw", "hid": "libusb"}


@pytest.fixture(scope="session")
def stub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stub, compiled."""
    if not sys.platform.startswith("linux"):
        pytest.skip("LD_PRELOAD is Linux's")
    return compile_stub(STUBS / "hidapi_stub.c", tmp_path_factory.mktemp("stub") / "hidapi_stub.so")


@pytest.fixture(scope="session")
def outcomes(stub: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """backend -> scenario -> what went wrong, "" for nothing."""

    def play(module: str) -> dict[str, str]:
        folder = tmp_path_factory.mktemp(module)
        program = [sys.executable, "-W", "error", "-m", PROGRAM, str(stub), BACKENDS[module], str(folder)]
        preloaded = {**os.environ, "LD_PRELOAD": str(stub)}
        done = subprocess.run(program, cwd=ROOT, env=preloaded, capture_output=True, timeout=120)
        assert done.returncode == 0, done.stderr.decode()
        result: dict[str, str] = json.loads(done.stdout)
        return result

    return {module: play(module) for module in BACKENDS}


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("module", BACKENDS)
def test_hidapi(outcomes: dict[str, dict[str, str]], module: str, name: str) -> None:
    assert outcomes[module][name] == ""
