"""Sessions around scenes of rigid bodies: a box that two people lift, a scene that fails, those that come with cogrip."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.results.replay.verify import verify
from cogrip.results.verdict.verdict import succeeded
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.sim.laboratory import Laboratory

from tests.extent import long

Array = NDArray[np.float64]
HZ = 128
HELD = slice(round(2.9 * HZ), round(4.9 * HZ))  # pressed, lifted, carried, before it is set down


class Lift:
    """A session of `cogrip lab lift`: places of the box and of both pads in the object's frame, frame by frame."""

    def __init__(self, *overrides: str) -> None:
        self.laboratory = laboratory = Laboratory(load(Path("lift"), overrides))
        world = laboratory.room.world
        assert isinstance(world, SceneWorld)
        self.world = world
        rows: list[Array] = []
        forces: list[Array] = []

        def each_frame(_: Laboratory) -> None:
            rows.append(np.array([world.position, *(world.proxy(user) - world.offset[user] for user in (0, 1))]))
            forces.append(world.force.copy())

        laboratory.run(None, each_frame)
        self.places, self.forces_n = np.array(rows), np.array(forces)

    def slip_m(self, held: slice = HELD) -> float:
        """Return how far a pad moved along the box while it was held."""
        along = self.places[held, 1:, 1:] - self.places[held, :1, 1:]
        return float(np.abs(along - along[0]).max())


def test_two_people_lift_a_box_by_friction_and_set_it_down_elsewhere() -> None:
    """Without its last seconds, in which the hands are home."""
    lift = Lift("seconds=8")
    assert not lift.laboratory.incident
    assert lift.places[round(4.9 * HZ), 0] == pytest.approx([0.04, 0.0, 0.045], abs=2e-3), "lifted and carried"
    assert lift.places[-1, 0] == pytest.approx([0.04, 0.0, 0.0], abs=2e-3), "set down"
    assert lift.slip_m() <= 1e-4
    assert lift.forces_n[HELD, 0, 0] == pytest.approx(5.1, abs=0.2)
    assert lift.world.limiter.limited == 0
    assert lift.world.limiter.level_j >= 0.0
    assert lift.world.balance_error_j <= 1e-14


@pytest.mark.long
@pytest.mark.parametrize(
    ("network", "most_m"),
    [
        (("link.jitter_ms=10", "playout.frames=2"), 1e-4),
        (("link.loss=0.02", "link.burst_frames=4", "playout.frames=6"), 2e-4),
    ],
)
def test_the_box_slips_no_further_on_impaired_networks(network: tuple[str, ...], most_m: float) -> None:
    lift = Lift(*network)
    assert not lift.laboratory.incident
    assert lift.slip_m() <= most_m
    assert lift.world.limiter.limited == 0


@pytest.mark.long
def test_the_box_is_held_for_a_minute() -> None:
    hands = ["waypoints&times_s=0.5,1.5,2,3&z_m=0,0,0,0.05&x_m=0,0.06,0.07,0.07"]
    hands.append(hands[0].replace("0.06,0.07,0.07", "-0.06,-0.07,-0.07"))
    lift = Lift("seconds=62", *(f"users.{number}.hand={hand}" for number, hand in enumerate(hands)))
    assert lift.places[-1, 0] == pytest.approx([0.0, 0.0, 0.045], abs=1e-3)
    assert lift.slip_m(slice(round(2.4 * HZ), 62 * HZ)) <= 1e-4


@pytest.mark.parametrize("kind", ["wave", "local"])
def test_a_scene_that_fails_ends_the_session_by_name(kind: str) -> None:
    laboratory = Laboratory(load(Path("lift"), ["seconds=2", f"coupling.kind={kind}"]))
    world = laboratory.room.world
    assert isinstance(world, SceneWorld)
    for _ in range(64):
        laboratory.frame()
    world.data.qvel[:] = np.nan
    laboratory.frame()
    assert laboratory.incident.startswith("the scene left all bounds at 0.5")
    assert world.holding.all(), "everybody has taken hold anew, at the start"
    laboratory.frame()
    assert np.isfinite(world.force).all()
    assert np.isfinite(laboratory.room.world.motion()).all()


def test_a_recording_replays_with_its_own_scene_alone(tmp_path: Path) -> None:
    """Bit by bit with the file that was recorded; another one is named, and so is one that is gone."""
    settings = load(Path("lift"), ["seconds=0.5"])
    text = Path(settings.object.file).read_text()
    file = tmp_path / "box.xml"
    file.write_text(text)
    run_laboratory(load(Path("lift"), ["seconds=0.5", f"object.file={file}"]), tmp_path)
    recording = open_recording(tmp_path / SERVER_RECORDING)
    assert verify(recording).exact
    file.write_text(text.replace('mass=".2"', 'mass=".3"'))
    with pytest.raises(
        RecordingError, match=r"box\.xml is another scene \(\w{16}\) than the recorded one \(\w{16}\); put"
    ):
        verify(recording)
    file.unlink()
    with pytest.raises(RecordingError, match=r"box\.xml: there is no such file"):
        verify(recording)


# Scenes that come with cogrip: each one's hands reach its task, and the limiter never acts ----------------------------

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
    assert laboratory.room.world.accounts.limiter()["limited_frames"] == 0
