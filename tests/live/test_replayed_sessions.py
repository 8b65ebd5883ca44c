"""A recorded person takes part in a new live session: real processes, UDP on loopback, a real hand."""

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.cli.main import main
from cogrip.results.reading.folder import CLOCKS
from cogrip.results.reading.records import open_run

from tests.live.test_live_sessions import FEW_FRAMES, FEW_TICKS

DATA = Path(__file__).parents[3] / "shared" / "data"
HAND = DATA / "tue_1dof_PP_kp8.csv"
SECONDS = 1.5
RESOLUTION_M = 3e-5  # of the phantom's encoders
MS = 1_000_000
FRAME_NS = 1_000_000_000 // 128  # by which a tick may have been held up, and the next is not late
CONFIG = """
name = "replayed"
seconds = 60.0
[link]
delay_ms = 10.0
[playout]
frames = 2
[[users]]
name = "anna"
[[users]]
name = "ben"
"""

Numbers = np.ndarray[Any, np.dtype[np.float64]]


def only(folder: Path) -> Path:
    """The one run below a folder."""
    (run,) = folder.iterdir()
    return run


def hand_trace(run: Path) -> tuple[Numbers, Numbers]:
    """Tick numbers and anna's positions [m]."""
    columns = open_run(run).clients["anna"].columns("tick", "tick", "position_m")
    return columns["tick"], columns["position_m"][:, 0]


def session(
    run: Callable[..., Any], serve: Callable[..., Any], config: Path, runs: Path, anna: str, ben: str
) -> dict[str, Path]:
    """A moment of two people, each with a device; their run folders and the server's."""
    before = set((runs.parent / "server").glob("*"))
    server, port = serve(config)
    people = {
        name: run(
            "join", f"127.0.0.1:{port}", "--config", config, "--name", name, "--device", device,
            "--seconds", SECONDS, "--runs", runs / name, "--no-report",
        )
        for name, device in (("anna", anna), ("ben", ben))
    }  # fmt: skip
    for person in people.values():
        assert person.end() == 0, person.said
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    folders = {name: only(runs / name) for name in people}
    (served,) = set((runs.parent / "server").iterdir()) - before
    return {**folders, "server": served}


@pytest.fixture
def config(tmp_path: Path) -> Path:
    if not HAND.exists():
        pytest.skip(f"../shared/data/{HAND.name} is not here")
    path = tmp_path / "replayed.toml"
    path.write_text(CONFIG)
    return path


@pytest.mark.long
def test_a_recorded_hand_moves_again_as_it_moved_with_a_new_partner(
    run: Callable[..., Any], serve: Callable[..., Any], config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tue = f"sim:phantom?hand=csv:{HAND}&time=t_s&x=theta_m_rad&scale=0.075&where=run:spring"
    first = session(run, serve, config, tmp_path / "first", tue, "sim:phantom?hand=reach")
    again = session(
        run, serve, config, tmp_path / "again", f"replay:{first['anna']}#user=anna", "sim:ideal?hand=tremor&seed=5"
    )
    told, then = hand_trace(first["anna"])
    told = told - told[0]  # where the replay begins: a loop may have missed its first ticks
    ticks, now = hand_trace(again["anna"])
    both = np.intersect1d(told, ticks)  # but for ticks that a loop skipped
    assert len(both) > FEW_TICKS
    deviation = np.abs(then[np.isin(told, both)] - now[np.isin(ticks, both)])
    assert deviation.max() < 0.5 * RESOLUTION_M
    assert np.ptp(now) > 0.005, "the hand moved"

    summary = json.loads((again["server"] / "summary.json").read_text())
    assert summary["passive"]
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
    assert summary["users"][0]["link"]["applied"] > FEW_FRAMES
    for name, folder in again.items():
        capsys.readouterr()
        assert main(["replay", str(folder), "--verify"]) == 0, (name, capsys.readouterr().out)
        assert "equal, bit for bit" in capsys.readouterr().out

    merged = tmp_path / "merged"  # on one machine all clocks are one
    assert main(["merge", *map(str, again.values()), "--out", str(merged)]) == 0
    stalled_ns = 1000 * max(part["ticks"]["late_us"]["max"] for part in (summary["server"], *summary["users"]))
    for file, clock in json.loads((merged / CLOCKS).read_text()).items():
        out_ns = max(clock["least_ns"], -clock["most_ns"])
        # a loop that is held up after it has looked at its clock gives what it then reads too early a time
        assert out_ns < stalled_ns + FRAME_NS, file
        if out_ns <= 0:
            assert clock["by"] == "clock anchors", file
            assert abs(clock["add_ns"]) < MS, file
    assert open_run(merged).names() == ["anna", "ben"]
