"""Commands that only look at something begin at once: they import nothing that they do not need.

What a command imports takes most of its time; the modules are counted, as a time would be one of the machine.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.server.admission.roster import RosterEntry
from cogrip.server.io.state_folder import ServerRecord, StateFolder, make_folder, write_server

from tests.cli.answering_server import answering
from tests.cli.command import Cogrip

HEAVY = {
    "OpenSSL", "asyncio", "cogrip.analysis", "cogrip.client.seat", "cogrip.experiments", "cogrip.server.room", "cogrip.sim",
    "cogrip.view", "cryptography", "hid", "jinja2", "loky", "markdown_it", "matplotlib", "mujoco", "multiprocessing", "numpy",
    "prometheus_client", "psutil", "pygments", "ray", "scipy", "segno", "ssl",
}  # fmt: skip
"""Modules of which no such command may import any. Each takes 10 ms or more, or belongs to what runs a session."""
READERS = {"mcap", "msgspec", "zstandard"}
"""Modules that read what others have written: settings, messages, recordings."""
PROGRAM = """
import json, sys
from cogrip.cli.start import main
try:
    code = main()
except SystemExit as end:
    code = end.code
with open({into!r}, "w") as file:
    json.dump([*sys.modules], file)
sys.exit(code)
"""


def imported(tmp_path: Path, *arguments: object) -> tuple[str, set[str]]:
    """Return what a command prints, and the modules of its process at the end, without those of the compiled form itself."""
    into = tmp_path / "modules.json"
    ran = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM.format(into=str(into)), *map(str, arguments)], capture_output=True, text=True,
        timeout=100,
    )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (0, "")
    modules = {
        name for name in json.loads(into.read_text()) if "cython" not in name and "shared_by_compiled" not in name
    }
    return ran.stdout, modules


def heavy(modules: set[str], *names: str) -> set[str]:
    """Return which of HEAVY and `names` are among the modules."""
    return {name for name in {*HEAVY, *names} if name in modules}


@pytest.fixture
def state(tmp_path: Path) -> StateFolder:
    folder = make_folder(tmp_path / "state")
    write_server(folder, ServerRecord("lab.example", 47811, "ab" * 32, {"lab": ["anna"]}, 1))
    return folder


@pytest.mark.parametrize(
    ("arguments", "most", "shows"),
    [
        (("--version",), 300, "."),
        (("--help",), 270, "two simulated people"),
        (("configs",), 285, "demo"),
    ],
)
def test_what_is_known_without_reading_anything(
    tmp_path: Path, arguments: tuple[str, ...], most: int, shows: str
) -> None:
    said, modules = imported(tmp_path, *arguments)
    assert shows in said.lower()
    assert heavy(modules, *READERS, "rich.markdown", "subprocess") == set()
    assert len(modules) <= most


def test_recorded_runs(recorded: Path, tmp_path: Path) -> None:
    said, modules = imported(tmp_path, "runs", recorded)
    assert recorded.name in said
    assert heavy(modules) == set()
    assert len(modules) <= 410


def test_who_is_seated(tmp_path: Path, state: StateFolder) -> None:
    anna = RosterEntry("anna", "lab", "10.0.0.7:5", 3723.4, 0, "sim:phantom", 41.25, 20.0, 21.25, 7, True)
    with answering(state, lambda order: {"text": "1 in 1 room", "people": (anna,)}):
        said, modules = imported(tmp_path, "who", "--state", state.path)
    assert "anna" in said
    assert heavy(modules, "mcap", "importlib.metadata") == set()
    assert len(modules) <= 330  # with the HTTP of the administration interface


def test_the_tokens_of_a_server(tmp_path: Path, cogrip: Cogrip, state: StateFolder) -> None:
    cogrip.out(f"token new --note guest --state {state.path}")
    said, modules = imported(tmp_path, "token", "list", "--state", state.path)
    assert "guest" in said
    assert heavy(modules, "mcap", "importlib.metadata") == set()
    assert len(modules) <= 350


def test_the_devices_there_are(tmp_path: Path) -> None:
    said, modules = imported(tmp_path, "devices", "list")
    assert "sim:phantom" in said
    assert heavy(modules, "mcap", "serial", "websockets", "cogrip.devices.simulated.recorded_motion") == set()
    assert len(modules) <= 435
