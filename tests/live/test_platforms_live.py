"""Live sessions of the stand-in for Windows (tests/windows.py): clocks, sockets, recorder and children over its substitutes."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cogrip.protocol.recording.reader import open_recording
from cogrip.results.replay.verify import verify

from tests.stalls import MACHINE_STALLED
from tests.test_layout import ROOT

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the stand-in for Windows runs on Linux")
LIMIT_S = 200.0
MANY_TICKS = 200  # a clock of 15.6 ms would let 64 run in a second


def on_windows(*arguments: str, cwd: Path) -> tuple[int, str]:
    """Return exit code and output of a command in the stand-in. The test is skipped where the machine stalled."""
    command = [sys.executable, "-P", str(ROOT / "tests" / "windows.py"), "cogrip.cli", *arguments]
    done = subprocess.run(
        command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=LIMIT_S, check=False,
        env={**os.environ, "NO_COLOR": "1", "COLUMNS": "200"},
    )  # fmt: skip
    if "watchdog: the loop was away" in done.stdout:
        pytest.skip(f"{MACHINE_STALLED} from a loop for 100 ms: no live session can be judged on it now")
    return done.returncode, done.stdout


@pytest.mark.long
def test_a_client_joins_an_ordinary_server_and_records(serve: Callable[..., tuple], tmp_path: Path) -> None:
    _, port = serve(ROOT / "configs" / "demo.toml")
    code, said = on_windows(
        "join", f"127.0.0.1:{port}", "--seconds", "1", "--device", "sim:phantom?hand=hold", "--no-report", cwd=tmp_path
    )
    assert "anna holds cube" in said, said
    assert "session is over" in said or code == 0, said
    (folder,) = (tmp_path / "runs").iterdir()
    (recording,) = folder.glob("*.mcap")
    verdict = verify(open_recording(recording))
    assert verdict.exact, said
    assert verdict.ticks > MANY_TICKS


@pytest.mark.long
def test_a_demo_of_server_and_clients_ends_in_order(tmp_path: Path) -> None:
    """The server ends by CTRL_BREAK_EVENT, and leaves its summary."""
    code, said = on_windows("demo", "--seconds", "2", cwd=tmp_path)
    assert code in (0, 1), said  # 1 where a busy machine skipped ticks
    (folder,) = (tmp_path / "runs").iterdir()
    assert "server:" not in said, said
    assert {"summary.json", "report.html", "server.mcap", "client-anna.mcap", "client-ben.mcap"} <= {
        path.name for path in folder.iterdir()
    }
    assert all(verify(open_recording(path)).exact for path in folder.glob("*.mcap"))
