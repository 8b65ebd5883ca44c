"""Gravity of a scene and effects, set while a session runs: what is felt, energy, replay, restart, refusals."""

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from cogrip.cli.settings.settings_file import load
from cogrip.client.inputs import CloseLedger
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.settable import RoomChange, room_change
from cogrip.protocol.settings.table import SettingsError
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.checkpoint import decode, encode
from cogrip.server.inputs import Mark
from cogrip.sim.laboratory import Laboratory

from tests.sim.felt_forces import Felt
from tests.sim.session_measures import run_frames
from tests.sim.set_sessions import assert_passive, set_room, two, wall

LIFT = Path(__file__).resolve().parents[2] / "configs" / "lift.toml"


def lifted(**more: Any) -> Laboratory:
    """Two hold the box of `lift` between them, by the scene that comes with cogrip."""
    return Laboratory(replace(load(LIFT), **({"seconds": 60.0} | more)))


def test_gravity_is_set_of_a_scene() -> None:
    laboratory, untouched = lifted(), lifted()
    world = laboratory.room.world
    before = world.gravity_mps2
    for each in (laboratory, untouched):
        run_frames(each, 2 * 128)
    assert set_room(laboratory, "scene.gravity_mps2=4") == 1
    fell_j, at = [], before
    felt, beside = Felt(laboratory), Felt(untouched)
    for _ in range(3 * 128):
        felt.run(1)
        beside.run(1)
        fell_j.append(sum_of_falls(world, at - world.gravity_mps2))
        at = world.gravity_mps2
    assert before == pytest.approx(9.81)
    assert world.gravity_mps2 == 4.0
    assert felt.step_n < beside.step_n + 0.02, "it comes within a second, and not as a step"
    told = of_laboratory(laboratory)["server"]["scene"]["gravity_j"]
    assert told == pytest.approx(sum(fell_j), rel=0.02), "the energy by place of all bodies that do not float"
    assert abs(told) > 1e-3
    assert_passive(laboratory)
    saved = world.save()
    set_room(laboratory, "scene.gravity_mps2=12")
    run_frames(laboratory, 3 * 128)
    assert world.gravity_mps2 == 12.0
    world.restore(saved)
    assert world.gravity_mps2 == 4.0


def sum_of_falls(world: Any, less_mps2: float) -> float:
    """Return the energy that bodies lose by place as gravity becomes less: m h times what it is less, as they are now [J]."""
    model, data = world.scene.model, world.data
    carried = 1.0 - model.body_gravcomp
    return -less_mps2 * float((model.body_mass * carried * data.xipos[:, 2]).sum())


@pytest.mark.parametrize(
    ("table", "why"), [(two(), "there is no scene"), (wall(), "there is no scene")], ids=["cube", "wall"]
)
def test_there_is_no_gravity_without_a_scene(table: dict[str, Any], why: str) -> None:
    laboratory = Laboratory(resolve(table))
    assert why in laboratory.room.unfit_change(RoomChange(scene_gravity_mps2=3.0))
    assert set_room(laboratory, "scene.gravity_mps2=3") == 0


PUSH = {
    "kind": "constant",
    "name": "push",
    "force_n": 0.5,
    "direction": [1.0, 0.0, 0.0],
    "marker": "go",
    "start_s": 0.5,
}


def effects_at(laboratory: Laboratory) -> list[int]:
    return [len(laboratory.room.effects.of(user)) for user in range(len(laboratory.people))]


def test_an_effect_begins_and_ends_by_its_name() -> None:
    laboratory = Laboratory(resolve(two(effects=[PUSH])))
    run_frames(laboratory, 64)
    assert effects_at(laboratory) == [0, 0], "its marker has not come"
    assert set_room(laboratory, "effects.push=on") == 1
    run_frames(laboratory, 1)
    assert effects_at(laboratory) == [1, 1], "it begins at once, whatever its start_s"
    refused = laboratory.room.unfit_change(room_change(["effects.push=off"]))
    assert refused == "effects.push was set, or its marker came, 0.008 s ago; wait 0.1 s from one switch to the next"
    run_frames(laboratory, 64)
    felt = laboratory.people[0].core.handle(CloseLedger(laboratory.ticks(0)), laboratory.now_ns).effects
    assert felt.drawn_j > 0.0, "the hand's client renders it"
    set_room(laboratory, "effects.push=ben")
    run_frames(laboratory, 1)
    assert effects_at(laboratory) == [0, 1]
    run_frames(laboratory, 64)
    set_room(laboratory, "effects.push=off")
    laboratory.server.handle(Mark("go", ""), laboratory.now_ns)
    run_frames(laboratory, 128)
    assert effects_at(laboratory) == [0, 0], "a marker begins nothing that was ended by hand"
    set_room(laboratory, "effects.push=on")
    run_frames(laboratory, 14)
    before = laboratory.room.effects.of(0)
    laboratory.server.handle(Mark("go", ""), laboratory.now_ns)
    run_frames(laboratory, 70)
    assert laboratory.room.effects.of(0) != (), "its marker begins it anew"
    assert laboratory.room.effects.of(0)[0] is not before[0]
    assert_passive(laboratory)
    again = decode(encode(laboratory.room.checkpoint()))
    assert again.changes.effects == {"push": "on"}
    restarted = Laboratory(resolve(two(effects=[PUSH]))).room
    restarted.restore(again, 0)
    restarted.effects.follow(restarted.steps, restarted.markers)
    assert [len(restarted.effects.of(user)) for user in (0, 1)] == [1, 1]


def test_an_effect_that_ended_before_a_restart_is_not_felt_again() -> None:
    laboratory = Laboratory(resolve(two(effects=[{**PUSH, "seconds": 0.5}])))
    set_room(laboratory, "effects.push=anna")
    run_frames(laboratory, 2 * 128)
    kept = decode(encode(laboratory.room.checkpoint()))
    restarted = Laboratory(resolve(two(effects=[{**PUSH, "seconds": 0.5}]))).room
    restarted.restore(kept, 0)
    restarted.effects.follow(restarted.steps, restarted.markers)
    assert [restarted.effects.of(user) for user in (0, 1)] == [(), ()]
    assert restarted.changes.effects == {"push": "anna"}


def test_a_marker_and_a_switch_are_no_vibration_together() -> None:
    laboratory = Laboratory(resolve(two(effects=[PUSH])))
    set_room(laboratory, "effects.push=on")
    run_frames(laboratory, 1)
    first = laboratory.room.effects.of(0)
    laboratory.server.handle(Mark("go", ""), laboratory.now_ns)
    run_frames(laboratory, 8)
    assert laboratory.room.effects.of(0)[0] is first[0], "a marker so soon begins nothing anew"
    run_frames(laboratory, 64)
    laboratory.server.handle(Mark("go", ""), laboratory.now_ns)
    run_frames(laboratory, 2)
    assert "its marker came" in laboratory.room.unfit_change(room_change(["effects.push=off"]))


@pytest.mark.parametrize(
    ("pair", "why"),
    [
        ("effects.pull=on", "there is no effect 'pull'; there is: push"),
        ("effects.push=carl", "effects.push: there is no user 'carl'; name one of anna, ben"),
    ],
)
def test_no_effect_is_switched_that_is_not_there(pair: str, why: str) -> None:
    laboratory = Laboratory(resolve(two(effects=[PUSH])))
    assert laboratory.room.unfit_change(room_change([pair])) == why
    assert set_room(laboratory, pair) == 0


@pytest.mark.parametrize(
    "pair", ["effects.push=", "effects.push=on,off", "effects.=on", "effects.push=anna,,ben", "effects=on"]
)
def test_a_switch_is_said_in_words(pair: str) -> None:
    with pytest.raises(ValueError, match="effects"):
        room_change([pair])


def test_names_of_effects_stand_once() -> None:
    with pytest.raises(SettingsError, match=r"effects\.1\.name = 'push' stands twice"):
        resolve(two(effects=[PUSH, PUSH]))


def test_switches_and_gravity_are_recorded_and_play_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Laboratory.run

    def with_changes(laboratory: Laboratory, *given: Any, **named: Any) -> None:
        def change(_: Laboratory) -> None:
            if laboratory._frame == 64:
                set_room(laboratory, "scene.gravity_mps2=4", "effects.push=anna")
            if laboratory._frame == 192:
                set_room(laboratory, "effects.push=off")

        run(laboratory, each_frame=change)

    monkeypatch.setattr(Laboratory, "run", with_changes)
    run_laboratory(lifted(effects=resolve(two(effects=[PUSH])).effects, seconds=3.0).settings, tmp_path)
    found = open_run(tmp_path)
    assert found.server is not None
    for end in (*found.clients.values(), found.server):
        assert verify(end.recording).exact
