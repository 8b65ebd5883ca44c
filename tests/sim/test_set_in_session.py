"""Line, spring and object changed while a session runs: what is felt, energy, steps of force, replay, restart, refusals."""

from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace as replace_fields

from cogrip.protocol.settings.hand import UNCHANGED, parsed
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.settable import RoomChange
from cogrip.protocol.wire.messages import Farewell, encode
from cogrip.protocol.wire.messages import SetHand as Report
from cogrip.results.reading.records import open_run
from cogrip.results.reading.traces import load_run
from cogrip.results.replay.verify import verify
from cogrip.results.report.page import render
from cogrip.results.verdict.verdict import judgements
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_client, of_laboratory
from cogrip.server.checkpoint import decode as decode_checkpoint
from cogrip.server.checkpoint import encode as encode_checkpoint
from cogrip.server.inputs import SetHand
from cogrip.sim.laboratory import Laboratory

from tests.sim.felt_forces import Felt
from tests.sim.session_measures import run_frames
from tests.sim.set_sessions import account_of, assert_passive, set_of, set_room, two, wall

LOAN_J = 1e-9  # rounding of an energy that is not to grow


@pytest.mark.parametrize("delay_ms", [0.0, 20.0])
@pytest.mark.parametrize("compensate", [False, True])
def test_a_hand_feels_the_stiffness_that_was_set(delay_ms: float, compensate: bool) -> None:
    table = wall(link={"delay_ms": delay_ms})
    table["coupling"]["compensate"] = compensate
    table["coupling"]["stiffness_npm"] = 200.0
    laboratory = Laboratory(resolve(table))
    felt = Felt(laboratory)
    felt.run(3 * 128)
    before, felt.step_n = account_of(laboratory), 0.0
    set_of(laboratory, "anna", "stiffness_npm=300")
    felt.run(8 * 128)
    after = account_of(laboratory)
    assert before.felt_stiffness_npm == pytest.approx(before.predicted_stiffness_npm, rel=0.03)
    assert after.felt_stiffness_npm == pytest.approx(after.predicted_stiffness_npm, rel=0.03)
    if compensate:
        assert after.felt_stiffness_npm == pytest.approx(300.0, rel=0.03)
    assert after.felt_stiffness_npm > 1.15 * before.felt_stiffness_npm
    assert felt.step_n < 0.05, "it comes within some seconds, and not as a step"
    assert_passive(laboratory)
    summary = of_laboratory(laboratory)
    assert summary["users"][0]["asked_stiffness_npm"] == 300.0
    assert summary["users"][0]["hand"]["stiffness_npm"] == 300.0
    set_of(laboratory, "anna", "stiffness_npm=100", "damping_nspm=2")
    felt.step_n = 0.0
    felt.run(8 * 128)
    softer = account_of(laboratory)
    assert softer.felt_stiffness_npm == pytest.approx(softer.predicted_stiffness_npm, rel=0.03)
    assert felt.step_n < 0.05
    assert laboratory.room.world.damping[0, 0] == 2.0
    assert_passive(laboratory)


@pytest.mark.parametrize("compensate", [True, False])
def test_a_spring_of_the_settings_that_could_not_grow_is_not_said_to_be_felt(compensate: bool) -> None:
    table = two()
    table["coupling"] |= {"stiffness_npm": 400.0, "compensate": compensate}
    for user, amplitude_m in zip(table["users"], (0.06, -0.06), strict=True):
        user |= {"device": "sim:ideal", "hand": f"approach&amplitude_m={amplitude_m}&lag_s=0.05"}
    laboratory = Laboratory(resolve(table))
    run_frames(laboratory, 12 * 128)
    anna = of_laboratory(laboratory)["users"][0]
    goal_npm = laboratory.room.world.goal_npm(0)
    if not compensate:  # such a spring is there from the first moment on
        assert goal_npm is None
        assert anna["rendered_npm"] == 400.0
        assert anna["not_predicted"] is None
        return
    assert 0.0 < anna["rendered_npm"] < 0.9 * goal_npm, "both press from the first moment on, and stand still"
    assert anna["predicted_stiffness_npm"] is None
    assert anna["not_predicted"].startswith(f"its spring has come to {anna['rendered_npm']:.0f} of {goal_npm:.0f} N/m")
    told = Farewell(1, "goodbye", laboratory.room.seat_account(0), None)
    client = of_client(laboratory.room.seats[0].settings, account_of(laboratory), told, 12.0, {})["users"][0]
    softer = anna["rendered_npm"] < 0.95 * 400.0
    assert (client["predicted_stiffness_npm"] is None) is softer, "no line in series makes a spring stiffer"


def test_a_spring_that_could_not_grow_is_not_said_to_be_felt() -> None:
    table = two()
    table["coupling"]["stiffness_npm"] = 300.0
    for user, amplitude_m in zip(table["users"], (0.06, -0.06), strict=True):
        user |= {"device": "sim:ideal", "hand": f"approach&amplitude_m={amplitude_m}&lag_s=0.3"}
    laboratory = Laboratory(resolve(table))
    run_frames(laboratory, 4 * 128)
    set_of(laboratory, "anna", "stiffness_npm=3000")
    run_frames(laboratory, 12 * 128)
    stiffness = laboratory.room.world.stiffness[0, 0]
    assert 0.0 < stiffness < 2000.0, "both press and stand still: only the loan pays"
    summary = of_laboratory(laboratory)
    assert summary["users"][0]["predicted_stiffness_npm"] is None
    assert summary["users"][0]["not_predicted"].startswith(f"its spring has come to {stiffness:.0f} of the 3000 N/m")
    assert judgements(summary)[2].tone != "good"


def test_an_impedance_that_was_set_holds_at_both_ends_and_is_bounded_by_the_device() -> None:
    laboratory = Laboratory(resolve(two(link={"delay_ms": 20.0})))
    felt = Felt(laboratory)
    felt.run(2 * 128)
    felt.step_n = 0.0
    set_of(laboratory, "anna", "impedance_nspm=8")
    felt.run(12 * 128)
    seat = laboratory.room.seats[0]
    assert laboratory.people[0].core._seat.coupling.b == laboratory.room.world.impedance[0, 0] == 8.0
    assert laboratory.room.world.impedance[1, 0] == 20.0
    assert seat.hand.holds.impedance_nspm == 8.0
    set_of(laboratory, "anna", "impedance_nspm=60")
    felt.run(14 * 128)
    carried = laboratory.people[0].core._seat.coupling.b
    assert 20.0 < carried < 60.0, "the device carries no more"
    assert seat.hand.holds.impedance_nspm == carried == laboratory.room.world.impedance[0, 0]
    set_of(laboratory, "anna", "impedance_nspm=auto", "prefer=light", "wave_filter_hz=2")
    felt.run(14 * 128)
    assert seat.hand.holds.text.endswith("impedance_nspm=auto wave_filter_hz=2 prefer=light")
    assert laboratory.room.world.impedance[0, 0] < carried
    assert account_of(laboratory).line.wave_filter_hz == pytest.approx(2.0)
    assert felt.step_n < 0.6
    assert_passive(laboratory)


def test_a_mass_that_was_set_adds_no_energy_and_is_what_moves() -> None:
    laboratory = Laboratory(resolve(two()))
    felt = Felt(laboratory)
    felt.run(64)
    world = laboratory.room.world
    for kg in (2.0, 0.05, 1.0):
        assert set_room(laboratory, f"object.mass_kg={kg}", "object.damping_nspm=3") == 1
        for _ in range(6 * 128):
            mass, kinetic_j = world.mass_kg, 0.5 * world.mass_kg * float(world.velocity @ world.velocity)
            for ramp, apply in laboratory.room._ramps:  # as `tick` does before its step
                if (value := ramp.update()) is not None:
                    apply(value)
            assert 0.5 * world.mass_kg * float(world.velocity @ world.velocity) <= kinetic_j + LOAN_J
            assert abs(world.mass_kg / mass - 1.0) < 0.01
            felt.run(1)
        assert world.mass_kg == kg
        assert world.object_damping == 3.0
    assert felt.step_n < 1.0
    assert_passive(laboratory)


def test_a_session_that_was_changed_replays_bit_by_bit_and_says_when(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Laboratory.run
    orders = {
        64: lambda lab: set_of(lab, "anna", "stiffness_npm=900", "damping_nspm=3"),
        128: lambda lab: set_room(lab, "object.mass_kg=1.5", "object.damping_nspm=2"),
        192: lambda lab: set_of(lab, "ben", "impedance_nspm=12", "wave_filter_hz=5"),
        384: lambda lab: set_of(lab, "ben", "impedance_nspm=auto"),
    }

    def with_changes(laboratory: Laboratory, *given: Any, **named: Any) -> None:
        run(laboratory, each_frame=lambda _: orders.get(laboratory._frame, lambda _: None)(laboratory))

    monkeypatch.setattr(Laboratory, "run", with_changes)
    outcome = run_laboratory(resolve(two(link={"profile": "wifi"}) | {"seconds": 5.0}), tmp_path)
    found = open_run(tmp_path)
    assert found.server is not None
    for end in (*found.clients.values(), found.server):
        assert verify(end.recording).exact
    texts = [text for _, text in found.markers()]
    assert texts == [
        "set anna stiffness_npm=900 damping_nspm=3", "set object.mass_kg=1.5 object.damping_nspm=2",
        "set ben impedance_nspm=12 wave_filter_hz=5", "set ben impedance_nspm=auto",
    ]  # fmt: skip
    users = outcome.summary["users"]
    assert [user["asked_stiffness_npm"] for user in users] == [900.0, 600.0]
    assert judgements(outcome.summary)[0].tone == "good"


def test_a_restarted_server_goes_on_with_what_was_set() -> None:
    laboratory = Laboratory(resolve(two()))
    run_frames(laboratory, 64)
    set_of(laboratory, "anna", "stiffness_npm=300", "impedance_nspm=10")
    set_room(laboratory, "object.mass_kg=0.8")
    run_frames(laboratory, 6 * 128)
    checkpoints = [decode_checkpoint(encode_checkpoint(each)) for each in laboratory.kill()]
    assert checkpoints[0].changes == RoomChange(0.8)
    run_frames(laboratory, 32)
    laboratory.restart(checkpoints)
    run_frames(laboratory, 8 * 128)
    world, seat = laboratory.room.world, laboratory.room.seats[0]
    assert seat.state == "seated"
    assert world.mass_kg == 0.8
    assert world.stiffness[0, 0] == seat.settings.coupling.stiffness_npm == 300.0
    assert world.stiffness[1, 0] == 600.0
    assert laboratory.people[0].core._seat.coupling.b == world.impedance[0, 0] == 10.0
    assert_passive(laboratory)


def test_a_client_cannot_say_of_itself_what_spring_it_has() -> None:
    laboratory = Laboratory(resolve(two()))
    run_frames(laboratory, 64)
    seat = laboratory.room.seats[0]
    report = replace_fields(UNCHANGED, stiffness_npm=1e7, impedance_nspm=3.0)
    laboratory.server.receive(encode(Report(seat.session, 1, 0, report)), "person 0", laboratory.now_ns)
    assert seat.hand.holds.stiffness_npm is None
    run_frames(laboratory, 64)
    assert laboratory.room.world.stiffness[0, 0] == 600.0
    assert laboratory.room.world.impedance[0, 0] == 20.0, "it was not told to change it"
    assert of_laboratory(laboratory)["users"][0]["asked_stiffness_npm"] == 600.0


def test_whoever_comes_next_begins_as_the_settings_say() -> None:
    laboratory = Laboratory(resolve(two()))
    run_frames(laboratory, 64)
    set_of(laboratory, "anna", "stiffness_npm=300", "damping_nspm=1")
    run_frames(laboratory, 4 * 128)
    room = laboratory.room
    room.leave_seat(0, "leave")
    record = room.seats[0].record
    assert record is not None
    room.take_seat(0, 77, 5, laboratory.now_ns, record)
    assert room.seats[0].settings == room.seats[0].begins_with
    assert (room.world.target_stiffness[0, 0], room.world.target_damping[0, 0]) == (600.0, 10.0)


@pytest.mark.parametrize(
    ("table", "pair", "why"),
    [
        ({"coupling": {"kind": "coupling"}}, "impedance_nspm=9", "is of a line of waves"),
        ({"coupling": {"kind": "coupling"}}, "stiffness_npm=9", "is of a spring that the server integrates"),
        ({"coupling": {"kind": "wave", "server_step": "paper"}}, "stiffness_npm=9", "server_step"),
        ({"coupling": {"impedance_nspm": 100.0}}, "impedance_nspm=50", "100 N s/m, outside of the 1 to 60"),
        ({"coupling": {"compensate": True, "stiffness_npm": 100.0}}, "wave_filter_hz=9", "needs a filter that stays"),
        (
            {"object": {"kind": "wall"}, "coupling": {"kind": "local"}},
            "stiffness_npm=9",
            "there is none that can change",
        ),
    ],
)
def test_what_cannot_change_says_why(table: dict[str, Any], pair: str, why: str) -> None:
    laboratory = Laboratory(resolve({"seconds": 1.0, "users": [{"name": "anna"}], **table}))
    run_frames(laboratory, 16)
    seat = laboratory.room.seats[0]
    assert why in seat.settings.unfit_change(parsed([pair]))
    assert laboratory.server.handle(SetHand("anna", parsed([pair])), laboratory.now_ns) == 0
    assert seat.hand.number == 0


@pytest.mark.parametrize(
    ("kind", "coupling", "can"),
    [("cube", "wave", 1), ("faces", "wave", 1), ("wall", "wave", 0), ("cube", "partner", 0)],
)
def test_an_object_changes_where_its_world_alone_has_it(kind: str, coupling: str, can: int) -> None:
    table = {**two(), "coupling": {"kind": coupling}, "object": {"kind": kind, "axes": 1}}
    laboratory = Laboratory(resolve(table))
    run_frames(laboratory, 16)
    assert set_room(laboratory, "object.mass_kg=0.5") == can
    assert bool(laboratory.room.unfit_change(RoomChange(0.5))) is not bool(can)
    run_frames(laboratory, 256)
    assert (laboratory.room.world.mass_kg == 0.5) is bool(can)
    assert hypot(*laboratory.room.world.velocity) < 1.0


def test_a_report_lists_what_was_set_and_when(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Laboratory.run

    def with_changes(laboratory: Laboratory, *given: Any, **named: Any) -> None:
        def change(_: Laboratory) -> None:
            if laboratory._frame == 64:
                set_of(laboratory, "anna", "stiffness_npm=900")

        run(laboratory, each_frame=change)

    monkeypatch.setattr(Laboratory, "run", with_changes)
    run_laboratory(resolve(two() | {"seconds": 1.0}), tmp_path)
    traced = load_run(tmp_path)
    ((time_s, text),) = traced.markers
    assert (time_s, text) == (pytest.approx(0.5, abs=0.01), "set anna stiffness_npm=900")
    page = render(traced, [])
    assert "<h2>Markers, and what was set</h2>" in page
    assert "0.50" in page
    assert "set anna stiffness_npm=900" in page
    assert "Markers" not in render(replace(traced, markers=()), [])
