"""Scenes that come with cogrip: each one's hands reach its task, live and passive to the end, and the limiter never acts."""

from pathlib import Path

import pytest

from cogrip.cli.session.settings_file import load
from cogrip.sim.runs.summary import of_laboratory
from cogrip.sim.runs.verdict import succeeded
from cogrip.sim.session.laboratory import Laboratory

from tests.extent import long

SECONDS = {"wall": 2.5, "pinch": 8.5, "lift": 6.5, "pile": 10.0, "peg": 9.0, "table": 10.0, "valve": 8.5, "wheel": 13.0}
"""Settings of scenes, and how much of them it takes to reach their task."""


def ends_well(name: str, *overrides: str) -> None:
    laboratory = Laboratory(load(Path(name), overrides))
    laboratory.run()
    summary = of_laboratory(laboratory)
    assert succeeded(summary)
    assert all(user["state"] == "live" for user in summary["users"])
    assert summary["server"]["energy_limiter"]["limited_frames"] == 0
    assert summary["server"]["energy_balance_error_j"] <= 1e-14
    task = summary["task"]
    assert task["reached"], task
    assert all(goal["met"] for goal in task["goals"].values())


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["wall", "pinch", long("lift"), long("valve")])
def test_a_scene_is_done_by_its_hands(name: str) -> None:
    ends_well(name, f"seconds={SECONDS[name]}")


@pytest.mark.long
@pytest.mark.parametrize("name", SECONDS)
@pytest.mark.parametrize("network", [(), ("link.jitter_ms=5", "link.loss=0.01", "playout.frames=3")])
def test_a_whole_session_is_done_by_its_hands(name: str, network: tuple[str, ...]) -> None:
    ends_well(name, *network)


@pytest.mark.long
def test_one_person_turns_the_valve_alone() -> None:
    """The second never takes hold; friction of 0.3 N m is 5 N at one handle."""
    laboratory = Laboratory(load(Path("valve"), ["seconds=9", "task.turned_rad=6.0"]))
    laboratory.leave(1)
    laboratory.run()
    task = of_laboratory(laboratory)["task"]
    assert task["reached"], task
    assert laboratory.room.world.limiter_account()["limited_frames"] == 0
