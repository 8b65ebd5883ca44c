"""A recorded person takes part in a new live session: real processes, UDP on loopback, a real hand."""

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.cli.main import main
from cogrip.sim.records import open_run
from cogrip.sim.run_folder import CLOCKS

DATA = Path(__file__).parents[3] / "shared" / "data"
HAND = DATA / "tue_1dof_PP_kp8.csv"
SECONDS = 2
RESOLUTION_M = 3e-5  # of the phantom's encoders
MS = 1_000_000
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
    """Two seconds of two people, each with a device; their run folders and the server's."""
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
    newest = max((runs.parent / "server").iterdir(), key=lambda folder: folder.stat().st_mtime_ns)
    return {**folders, "server": newest}


@pytest.fixture
def config(tmp_path: Path) -> Path:
    if not HAND.exists():
        pytest.skip(f"../shared/data/{HAND.name} is not here")
    path = tmp_path / "replayed.toml"
    path.write_text(CONFIG)
    return path


def test_a_recorded_hand_moves_again_as_it_moved_with_a_new_partner(
    run: Callable[..., Any], serve: Callable[..., Any], config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tue = f"sim:phantom?hand=csv:{HAND}&time=t_s&x=theta_m_rad&scale=0.075&where=run:spring"
    first = session(run, serve, config, tmp_path / "first", tue, "sim:phantom?hand=reach")
    again = session(
        run, serve, config, tmp_path / "again", f"replay:{first['anna']}#user=anna", "sim:ideal?hand=tremor&seed=5"
    )
    told, then = hand_trace(first["anna"])
    ticks, now = hand_trace(again["anna"])
    both = np.intersect1d(told, ticks)  # but for ticks that a loop skipped
    assert len(both) > 0.9 * SECONDS * 1024
    assert told[0] == 0, "or the replay begins elsewhere"
    deviation = np.abs(then[np.isin(told, both)] - now[np.isin(ticks, both)])
    assert deviation.max() < 0.5 * RESOLUTION_M
    assert np.ptp(now) > 0.005, "the hand moved"

    summary = json.loads((again["server"] / "summary.json").read_text())
    assert summary["passive"]
    assert not summary["diverged"]
    assert summary["users"][0]["link"]["applied"] > 0.9 * SECONDS * 128
    for name, folder in again.items():
        capsys.readouterr()
        assert main(["replay", str(folder), "--verify"]) == 0, (name, capsys.readouterr().out)
        assert "equal, bit by bit" in capsys.readouterr().out

    merged = tmp_path / "merged"  # on one machine all clocks are one
    assert main(["merge", *map(str, again.values()), "--out", str(merged)]) == 0
    for file, clock in json.loads((merged / CLOCKS).read_text()).items():
        assert clock["least_ns"] <= 0 <= clock["most_ns"], file
        assert clock["by"] == "clock anchors", file
        assert abs(clock["add_ns"]) < MS, file
    assert open_run(merged).names() == ["anna", "ben"]
