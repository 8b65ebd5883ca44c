"""Hand settings changed while a session runs: energy, replay, loss, times, clutches, the limit and the weight."""

from collections.abc import Callable
from itertools import count, pairwise, starmap
from math import dist, hypot
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from cogrip.client import inputs as client_inputs
from cogrip.client.inputs import CloseLedger
from cogrip.client.safety.force_limits import SOFT_SLOPE_NPS
from cogrip.protocol.settings.coupling_kinds import Kind
from cogrip.protocol.settings.hand import UNCHANGED, parsed
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.messages import SetHand as Message
from cogrip.protocol.wire.messages import encode
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.checkpoint import decode as decode_checkpoint
from cogrip.server.checkpoint import encode as encode_checkpoint
from cogrip.server.inputs import SetHand
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.kinds import SCHEMES, object_of
from tests.sim.felt_forces import Felt
from tests.sim.session_measures import run_frames

CREDIT_J = 1e-3
NETWORKS = ("lan", "wifi", "wan", "lte", "satellite")
CALM = "sine&amplitude_m=0.0003&frequency_hz=0.7"


def session(profile: str = "", **user: Any) -> dict[str, Any]:
    return {
        "seconds": 20.0, "object": {"kind": "cube", "axes": 3}, "coupling": {"impedance_nspm": 8.0, "stiffness_npm": 300.0},
        **({"link": {"profile": profile}} if profile else {}),
        "users": [{"name": "anna", **user}],
    }  # fmt: skip


def ordered(laboratory: Laboratory, *pairs: str) -> None:
    assert laboratory.server.handle(SetHand("anna", parsed(pairs)), laboratory.now_ns) == 1


def account_of(laboratory: Laboratory) -> ClientAccount:
    return laboratory.people[0].core.handle(CloseLedger(laboratory.ticks(0)), laboratory.now_ns)


def each_second(seconds: float, laboratory: Laboratory, act: Callable[[int], None]) -> None:
    if laboratory._frame % 128 == 0 and 0 < laboratory._frame / 128 < seconds:
        act(laboratory._frame // 128)


def back_and_forth(laboratory: Laboratory) -> None:
    each_second(
        laboratory.settings.seconds,
        laboratory,
        lambda second: ordered(laboratory, f"position_scale={10 if second % 2 else 0.1}"),
    )


def assert_passive(laboratory: Laboratory) -> ClientAccount:
    account, seat = account_of(laboratory), laboratory.room.seat_account(0)
    margins = [account.down_margin_j, seat.up_margin_j, seat.line_margin_j]
    assert min([margin for margin in margins if margin is not None], default=0.0) >= -CREDIT_J
    assert account.device.margin_j >= 0.0
    return account


@pytest.mark.parametrize("profile", ["lan", *map(long, NETWORKS[1:])])
def test_scales_that_change_each_second_leave_every_line_passive(profile: str) -> None:
    table = session(profile, hand=CALM)
    table["seconds"] = 10.0
    table["object"]["damping_nspm"] = 5.0  # a free one swings on a line whose end the hand's friction holds
    laboratory = Laboratory(resolve(table))
    laboratory.run(each_frame=back_and_forth)
    account = assert_passive(laboratory)
    assert not laboratory.incident
    assert account.state == "live"
    hand = laboratory.room.seats[0].hand
    assert (hand.taken, hand.number) == (9, 9)
    assert hand.holds.position_scale == 10.0


@pytest.mark.parametrize("profile", [long(each) for each in NETWORKS])
@pytest.mark.parametrize("kind", ["cube", "wall"])
def test_changes_under_load_are_passive_as_well(profile: str, kind: str) -> None:
    """A hand that presses with 10 times the way, then finds 100 times the force: whatever its limits let go is released."""
    table = session(profile, hand="sine&amplitude_m=0.02&frequency_hz=0.7")
    table["object"]["kind"] = kind
    felt = Felt(Laboratory(resolve(table)))
    felt.laboratory.run(each_tick=felt.tick, each_frame=back_and_forth)
    assert_passive(felt.laboratory)
    assert felt.step_n <= 1000.0 / 1024 * (1.0 + 1e-9)


@pytest.mark.long
def test_a_session_with_changes_replays_bit_by_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Laboratory.run

    def with_changes(laboratory: Laboratory, *given: Any, **named: Any) -> None:
        def change(second: int) -> None:
            ordered(laboratory, ["position_scale=3", "rotation=0,0,0.4", "clutch=on force_scale=0.5"][second % 3])
            if second == 2:
                own = parsed(["workspace_limit_m=auto", "clutch=off", "gravity_compensation=on"])
                laboratory.people[0].core.handle(client_inputs.SetHand(own), laboratory.now_ns)

        def each_frame(_: Laboratory) -> None:
            each_second(4.0, laboratory, lambda second: change(second) if second != 2 else None)

        run(laboratory, each_frame=each_frame)

    monkeypatch.setattr(Laboratory, "run", with_changes)
    device = "sim:phantom?handle_mass_kg=0.05"
    outcome = run_laboratory(resolve(session("wifi", hand=CALM, device=device) | {"seconds": 4.0}), tmp_path)
    found = open_run(tmp_path)
    assert found.server is not None
    for end in (*found.clients.values(), found.server):
        assert verify(end.recording).exact
    assert outcome.summary["users"][0]["hand"]["position_scale"] == 3.0


@pytest.mark.parametrize("delay_ms", [0.0, 40.0])
def test_a_change_holds_within_a_round_trip_and_a_frame(delay_ms: float) -> None:
    table = session(hand=CALM) | {"link": {"delay_ms": delay_ms}, "seconds": 2.0}
    laboratory = Laboratory(resolve(table))
    asked = []

    def each_frame(_: Laboratory) -> None:
        hand = laboratory.room.seats[0].hand
        if laboratory._frame == 128:
            ordered(laboratory, "position_scale=2")
            asked.append(laboratory.now_ns)
        elif asked and len(asked) == 1 and hand.taken:
            asked.append(laboratory.now_ns)

    laboratory.run(each_frame=each_frame)
    taken_ms = (asked[1] - asked[0]) * 1e-6
    frame_ms = 1e3 / 128
    assert taken_ms <= 2 * delay_ms + 2 * frame_ms + 1e-6, (
        "and the answer's way through a server that looks once a frame"
    )
    assert laboratory.room.seats[0].hand.holds.position_scale == 2.0


@pytest.mark.long
def test_no_change_is_lost_where_datagrams_are() -> None:
    """Also where one is told before the one before it was answered."""
    table = session(hand=CALM) | {"link": {"loss": 0.3, "delay_ms": 20.0}, "seconds": 12.0}
    laboratory = Laboratory(resolve(table))
    held: list[Any] = []

    def each_frame(_: Laboratory) -> None:
        if laboratory._frame % 8 == 0 and laboratory._frame < 128 * 10 and not laboratory.room.seats[0].hand.full:
            held.append(round(1.01 + 0.01 * len(held), 2))
            ordered(laboratory, f"position_scale={held[-1]}")

    seen: list[float] = []

    def watch(_: Laboratory) -> None:
        now = laboratory.people[0].core._seat.orders.holds().position_scale
        if now is not None and (not seen or now != seen[-1]):
            seen.append(now)

    laboratory.run(each_tick=watch, each_frame=each_frame)
    hand = laboratory.room.seats[0].hand
    assert len(held) > 50
    assert hand.taken == hand.number == len(held)
    assert hand.holds.position_scale == held[-1]
    assert seen == sorted(seen), "in their order"
    assert set(held) >= set(seen[1:])


def test_a_change_in_contact_is_no_step_of_force() -> None:
    table = session(hand="approach&amplitude_m=0.006")
    table["object"]["kind"] = "wall"
    laboratory = Laboratory(resolve(table | {"seconds": 4.0}))
    forces = [(0.0,) * 3]

    def change(second: int) -> None:
        ordered(laboratory, f"force_scale={0.5 + second}")

    laboratory.run(
        each_tick=lambda _: forces.append(laboratory.people[0].core.force_n),
        each_frame=lambda _: each_second(4.0, laboratory, change),
    )
    assert max(starmap(dist, pairwise(forces))) <= SOFT_SLOPE_NPS / 1024 * (1.0 + 1e-9)
    assert min(hypot(*force) for force in forces[1024 + 8 : 1024 + 60]) < 0.05, "it ramps in anew"
    assert hypot(*forces[-1]) > 1.0
    assert_passive(laboratory)
    account = account_of(laboratory)
    assert account.felt_stiffness_npm == pytest.approx(account.predicted_stiffness_npm, rel=0.2)


def test_a_hand_refuses_what_its_room_has_no_axes_for_and_says_so() -> None:
    laboratory = Laboratory(resolve({"seconds": 1.0, "object": {"axes": 1}}))
    given = SetHand("anna", parsed(["rotation=-y x z"]))
    assert laboratory.server.handle(given, 0) == 0
    seat = laboratory.people[0].core._seat
    seat.orders.receive(Message(1, 1, 0, given.change))
    laboratory.run()
    assert not seat.frame.mapped
    assert seat.orders.changes.taken == 1


def test_a_device_that_names_no_handle_mass_is_not_carried() -> None:
    laboratory = Laboratory(resolve(session(hand=CALM) | {"seconds": 1.0}))
    ordered(laboratory, "gravity_compensation=on")
    laboratory.run()
    hand = laboratory.room.seats[0].hand
    assert hand.taken == 1
    assert parsed(["gravity_compensation=on"]).refused(hand.holds) == ["gravity_compensation"]


def test_reports_repeat_until_they_are_answered_and_no_longer() -> None:
    laboratory = Laboratory(resolve(session(hand=CALM) | {"seconds": 2.0}))
    core = laboratory.people[0].core
    core.handle(client_inputs.SetHand(parsed(["position_scale=2"])), 0)
    laboratory.run()
    assert laboratory.room.seats[0].hand.holds.position_scale == 2.0
    assert not core._seat.orders.changes.pending()


def test_a_client_that_reports_without_end_fills_no_log_and_loosens_no_limit() -> None:
    laboratory = Laboratory(resolve(session(hand=CALM) | {"seconds": 2.0}))
    core, reports, limits = laboratory.people[0].core, count(1), []
    told = replace(UNCHANGED, position_scale=10.0, force_scale=0.1)  # 100 times the force at the tool

    def lie(_: Laboratory) -> None:
        if core.session.state == "seated":
            core.session.outbox.append(encode(Message(core._seat.session_id, next(reports), 0, told)))

    def each_frame(_: Laboratory) -> None:
        limits.append(laboratory.room.seats[0].limits)
        if laboratory._frame == 128:
            ordered(laboratory, "clutch=off")

    laboratory.run(each_tick=lie, each_frame=each_frame)
    lines = [event for event in laboratory.server.events if event.event == "hand"]
    assert 20 <= len(lines) <= 40, "20 at once, 10 a second"
    assert laboratory.server.dropped["too many reports"] == laboratory.room.seats[0].hand._reported - len(lines)
    assert limits[-1] == limits[64]


@pytest.mark.sample(3)
@pytest.mark.parametrize("limit", ["auto", "box -0.05 0.05 -0.05 0.05 -0.05 0.05", "sphere 0 0 0 0.05"])
@pytest.mark.parametrize("kind", SCHEMES)
def test_a_hand_is_pushed_back_softly_beyond_the_limit(limit: str, kind: Kind) -> None:
    """A hand of 40 N/m that means to go 20 mm farther: the spring of 140 N/m stops it a few millimetres beyond."""
    begins_m = 0.117 if limit == "auto" else 0.05
    hand = f"sine&amplitude_m={begins_m + 0.02}&frequency_hz=0.25&hand_stiffness_npm=40&hand_damping_nspm=3"
    table = session(hand=hand, workspace_limit_m=limit) | {"seconds": 4.0}
    table["object"] = {"kind": object_of(kind), "axes": 3, "mass_kg": 0.01}
    table["coupling"] = {"kind": kind, "stiffness_npm": 1.0, "damping_nspm": 0.2}
    laboratory = Laboratory(resolve(table))
    farthest = [0.0, 0.0]

    def watch(_: Laboratory) -> None:
        place = laboratory.people[0].core.position_m[0]
        farthest[:] = min(farthest[0], place), max(farthest[1], place)

    laboratory.run(each_tick=watch)
    account = assert_passive(laboratory)
    assert account.state == "live"
    assert begins_m + 0.001 < farthest[1] < begins_m + 0.01, "the device's end"
    assert farthest[0] > -begins_m - 0.01


@pytest.mark.long
def test_a_carried_handle_weighs_nothing_and_a_closed_path_does_no_work() -> None:
    """sim:phantom with a handle of 100 g: a hand of 30 N/m sags by 33 mm without compensation."""

    def height(carried: bool) -> tuple[float, ClientAccount]:
        table = session(hand="reach&amplitude_m=0&hand_stiffness_npm=30", device="sim:phantom?handle_mass_kg=0.1",
                        gravity_compensation=carried)  # fmt: skip
        laboratory = Laboratory(resolve(table | {"seconds": 3.0}))
        laboratory.run()
        return laboratory.people[0].core.position_m[2], account_of(laboratory)

    sunk, account = height(False)
    assert sunk == pytest.approx(-0.1 * 9.81 / 30, abs=0.002), "friction 0.04 N"
    assert account.device.margin_j >= 0.0
    floats, account = height(True)
    assert abs(floats) < 0.002
    assert account.device.margin_j >= 0.0


@pytest.mark.long
def test_lifting_a_carried_handle_uses_up_no_reserve() -> None:
    """Up and down by 60 mm for 10 s: m g h = 59 mJ each time, against a free reserve of 37 mJ."""
    hand = "sine&amplitude_m=0.03&frequency_hz=0.5&direction=0,0,1"
    table = session(hand=hand, device="sim:phantom?handle_mass_kg=0.1", gravity_compensation=True)
    laboratory = Laboratory(resolve(table | {"seconds": 10.0}))
    laboratory.run()
    account = assert_passive(laboratory)
    assert account.state == "live"
    assert account.device.controlled < 0.01


@pytest.mark.long
@pytest.mark.parametrize("restart", [True, False])
def test_a_hand_that_resumes_its_seat_keeps_the_bounds_of_its_scale(restart: bool) -> None:
    """The server is killed and begins anew from its checkpoint, or the client is silent until its seat is taken."""
    table = session(hand="sine&amplitude_m=0.004&frequency_hz=0.7")
    laboratory = Laboratory(resolve({**table, "seconds": 9.0}))
    person = laboratory.people[0]
    run_frames(laboratory, 32)
    ordered(laboratory, "position_scale=10")
    run_frames(laboratory, 96)
    wide = laboratory.room.limits(0)
    if restart:
        checkpoints = [decode_checkpoint(encode_checkpoint(each)) for each in laboratory.kill()]
        run_frames(laboratory, 32)
        laboratory.restart(checkpoints)
    else:
        laboratory.alive = False
        run_frames(laboratory, 5 * 128)
        laboratory.server.outbox.clear()
        laboratory.alive = True
    run_frames(laboratory, 256)
    seat = laboratory.room.seats[0]
    assert seat.state == "seated"
    assert person.core.safety.state == "live"
    assert seat.hand.holds.position_scale == 10.0
    assert laboratory.room.limits(0) == seat.limits == wide
    assert wide.speed_mps == 10.0 * laboratory.room.seats[0].record.speed_mps  # type: ignore[union-attr]
    assert laboratory.room.limited(0) == {}
