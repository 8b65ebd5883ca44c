"""Checkpoints of a scene: the next server puts every body where it was, at rest."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.server.checkpoint import CheckpointError, RoomCheckpoint, decode, encode
from cogrip.server.room import Room
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.sim.laboratory import Laboratory

LIFT = Path("lift")
CONFIGS = Path(__file__).resolve().parents[2] / "configs"


@pytest.fixture(scope="module")
def lifted() -> tuple[Room, RoomCheckpoint]:
    """A room whose box is in the air, and what a file keeps of it."""
    laboratory = Laboratory(load(LIFT, ["seconds=4"]))
    laboratory.run()
    return laboratory.room, decode(encode(laboratory.room.checkpoint()))


def scene(room: Room) -> SceneWorld:
    assert isinstance(room.world, SceneWorld)
    return room.world


def test_every_body_is_where_it_was_at_rest_and_task_contact_and_slip_go_on(
    lifted: tuple[Room, RoomCheckpoint],
) -> None:
    before, checkpoint = lifted
    assert scene(before).position[2] > 0.03, "it is in the air"
    after = Room(load(LIFT))
    after.restore(checkpoint, 0)
    world = scene(after)
    assert world.data.qpos.tobytes() == scene(before).data.qpos.tobytes()
    assert not world.data.qvel.any()
    assert not world.holding.any()
    assert world.limiter.level_j == world.limiter.start_j
    told, account = scene(before), world.accounts.scene()
    assert account == told.accounts.scene()
    assert account["lifted_m"] > 0.04
    assert account["tools"][0]["contact_s"] > 1.0
    assert world.progress.account() == told.progress.account()
    assert world.progress.save() == told.progress.save() == checkpoint.progress
    for _ in range(128):
        world.step(np.zeros((2, 3)))
    assert world.position[2] == pytest.approx(0.0, abs=1e-3), "nobody holds it, so it falls to the floor"


@pytest.mark.long
def test_a_task_is_reached_over_the_end_of_a_server() -> None:
    """The box is lifted before, and falls back to its place after it, as everybody is let go. No time of the task is lost."""
    settings = load(LIFT, ["seconds=6", "task.place_m=[0.0, 0.0, 0.0]", "task.within_m=0.01"])
    laboratory = Laboratory(settings)
    while laboratory.room.world.progress.account()["goals"]["lifted_m"]["value"] < 0.045:
        laboratory.frame()
    begun = laboratory.room.steps
    checkpoints = [decode(encode(each)) for each in laboratory.kill()]
    for _ in range(32):
        laboratory.frame()
    laboratory.restart(checkpoints)
    laboratory.run()
    task = laboratory.room.world.progress.account()
    assert task["goals"]["lifted_m"]["value"] >= 0.045
    assert task["reached"]
    assert task["at_s"] > (begun - 64) / 128


def test_a_checkpoint_of_an_earlier_version_begins_to_measure_anew(lifted: tuple[Room, RoomCheckpoint]) -> None:
    room = Room(load(LIFT))
    room.restore(msgspec.structs.replace(lifted[1], progress=()), 0)
    assert scene(room).accounts.scene()["lifted_m"] == 0.0
    assert scene(room).position[2] > 0.03


def test_nothing_changes_for_a_checkpoint_of_another_scene(lifted: tuple[Room, RoomCheckpoint], tmp_path: Path) -> None:
    _, checkpoint = lifted
    broken = msgspec.structs.replace(checkpoint, coordinates=(float("nan"), *checkpoint.coordinates[1:]))
    short = msgspec.structs.replace(checkpoint, coordinates=checkpoint.coordinates[1:])
    less = msgspec.structs.replace(checkpoint, progress=checkpoint.progress[1:])
    endless = msgspec.structs.replace(checkpoint, progress=(float("inf"), *checkpoint.progress[1:]))
    text = (CONFIGS / "scenes" / "lift.xml").read_text().replace('mass=".2"', 'mass=".3"')
    (tmp_path / "lift.xml").write_text(text)
    heavier = load(LIFT, [f"object.file={tmp_path / 'lift.xml'}"])  # the same names and counts, and another box
    cases = [
        (load(LIFT), less, "the saved state has"),
        (load(LIFT), endless, "not all finite"),
        (heavier, checkpoint, "with other settings"),
        (load(LIFT), short, "its scene is another one"),
        (load(LIFT), broken, "not all finite"),
    ]
    for settings, wrong, words in cases:
        room = Room(settings)
        with pytest.raises(CheckpointError, match=words):
            room.restore(wrong, 0)
        assert not scene(room).position.any()
        assert room.steps == 0


def test_a_room_without_a_scene_takes_none() -> None:
    room = Room(load(Path("demo")))
    wrong = msgspec.structs.replace(room.checkpoint(), coordinates=(0.0,), scene="other")
    with pytest.raises(CheckpointError, match="a scene of rigid bodies, and this room has none"):
        room.restore(wrong, 0)


def test_progress_of_an_earlier_version_without_dwell_times_goes_on(lifted: tuple[Room, RoomCheckpoint]) -> None:
    checkpoint = lifted[1]
    room = Room(load(LIFT))
    room.restore(msgspec.structs.replace(checkpoint, progress=checkpoint.progress[:-2]), 0)
    assert room.world.progress.save()[:-2] == checkpoint.progress[:-2]
