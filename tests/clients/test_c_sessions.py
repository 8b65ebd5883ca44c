"""The client in C in sessions with the server's core, in virtual time: energy, limits of the force, states."""

from itertools import dropwhile, islice, pairwise
from math import inf, nan
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace

from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.sections import Playout
from cogrip.protocol.texts import clipped
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Edges, Waves, decode
from cogrip.server.inputs import Kick, Stop

from tests.client.seated_client import seat, welcome
from tests.clients.compiled import CClient, build, load, needs_compiler, needs_cxx
from tests.clients.virtual_session import HZ, VirtualSession
from tests.extent import every

pytestmark = needs_compiler

ROUNDING_J = 1e-12
CREDIT_J = 1e-3 * Playout().tank_mj
SLEW_N = 1000.0 / HZ * (1.0 + 1e-9)  # the steepest force, in a tick
PEAK_N = 8.0


def loses_nothing(person: CClient, credit_j: float = CREDIT_J) -> None:
    """No line gave out more than came in, and its credit."""
    status = person.status
    assert min(status.up_margin_j, status.down_margin_j, 0.5 * status.line_margin_j) >= -credit_j - ROUNDING_J


@needs_cxx
def test_compiled_as_cxx_it_does_the_same_to_the_last_bit(library: Any, built: Path) -> None:
    switches = ("-std=c++17", "-O1", "-fPIC", "-shared", "-DCOGRIP_NO_DRIVER")
    sessions = [
        VirtualSession(each, "anna", "ben", loss=0.1, jitter_ticks=8)
        for each in (library, load(build(built, "cxx.so", *switches, "cogrip.c", cxx=True)))
    ]
    for session in sessions:
        session.leave(1.0)
    assert sessions[0].forces == sessions[1].forces
    assert sessions[0].sent == sessions[1].sent
    assert max(force[0] for force in sessions[0].forces[0]) > 0.1


NETWORKS: list[tuple[str | int, dict[str, Any]]] = [
    ("auto", {}), ("auto", {"jitter_ticks": 30, "loss": 0.1}), (2, {"jitter_ticks": 20, "loss": 0.3}), (0, {"loss": 0.5}),
    ("auto", {"jitter_ticks": 60, "loss": 0.2}), (1, {"delay_ticks": 60}),
]  # fmt: skip


@pytest.mark.sample(2)
@pytest.mark.parametrize(("frames", "network"), every(2, NETWORKS))
@pytest.mark.parametrize(("axes", "tank_mj"), every(2, [(1, 0.0), (1, 1.0), (3, 1.0), (3, 0.0)]))
def test_no_line_and_no_motor_gives_out_more_than_came_in(
    library: Any, axes: int, frames: str | int, network: dict[str, Any], tank_mj: float
) -> None:
    playout = {"frames": frames, "tank_mj": tank_mj}
    session = VirtualSession(library, "anna", "ben", seed=axes, object={"axes": axes}, playout=playout, **network)
    session.leave(3.0)
    for number, person in enumerate(session.people):
        status = person.status
        loses_nothing(person, 1e-3 * tank_mj)
        assert status.device_margin_j >= 0.0
        assert 0.1 < status.peak_force_n <= PEAK_N * (1.0 + 1e-12)
        assert session.largest_step_n(number) <= SLEW_N
        assert person.force_n == (0.0,) * 3
        down = status.down
        assert down.sent == down.applied + down.late + down.lost
        assert down.applied > 50
        assert person.reason == ""
    assert session.core.rooms[0].account().travel_m > 0.005
    assert session.core.dropped["malformed"] == session.core.dropped["unfit"] == 0
    assert session.sends_what_the_reference_would()


@pytest.mark.sample(2)
@pytest.mark.parametrize("change", [
    {"coupling": {"encoder": "velocity"}}, {"coupling": {"decimator": "lowpass"}}, {"coupling": {"wave_filter_hz": 5.0}},
    {"rates": {"network_hz": 64}}, {"playout": {"redundancy": 1}},
    {"coupling": {"impedance_nspm": "auto", "wave_filter_hz": "auto"}},
])  # fmt: skip
def test_other_settings_of_a_line_are_passive_too(library: Any, change: dict[str, Any]) -> None:
    session = VirtualSession(library, "anna", loss=0.05, jitter_ticks=8, **change)
    session.leave(2.0)
    status = session.person.status
    if "encoder" not in change.get("coupling", {}):
        assert status.up_margin_j >= -CREDIT_J - ROUNDING_J
    assert status.down_margin_j >= -CREDIT_J - ROUNDING_J
    assert session.core.dropped["unfit"] == 0
    assert session.sends_what_the_reference_would()


def test_its_account_is_what_the_server_saw(library: Any) -> None:
    session = VirtualSession(library, "anna", loss=0.1, playout={"redundancy": 1})
    account, status = session.leave(2.0), session.person.status
    assert account == session.core.rooms[0].seats[0].account
    assert account.down_margin_j == status.down_margin_j
    assert account.peak_force_n == status.peak_force_n
    assert (account.ticks.run, account.state, account.unstable) == (account.ticks.due, "idle", False)
    assert account.down.applied > 100
    assert account.down.lost > 0
    assert account.rtt_ms.p50 == pytest.approx(2e3 * 3 / HZ, abs=6.0)
    assert account.device.margin_j >= 0.0


def test_a_carried_impedance_below_that_of_the_line_is_rendered_in_series(library: Any) -> None:
    session = VirtualSession(library, "anna", config={"carried_nspm": 5.0})
    account = session.leave(2.0)
    assert account.device.controlled > 0.9
    assert account.device.margin_j >= 0.0
    loses_nothing(session.person)


@pytest.mark.parametrize("peak_n", [0.5, 2.0])
def test_what_limits_take_off_the_line_does_not_get(library: Any, peak_n: float) -> None:
    """A hand pushes a wall harder than its device can push back: the line is told of no more force than there is."""
    session = VirtualSession(library, "anna", config={"peak_force_n": peak_n}, object={"kind": "wall"})
    account = session.leave(1.45)
    assert session.person.counts["force clipped"] > 100
    assert account.device.margin_j >= 0.0
    assert account.device_leak_j > -0.02  # -0.4 J where the line is told of the law's force
    assert account.state == "idle"


def test_force_goes_to_zero_without_the_server_and_comes_back(library: Any) -> None:
    session = VirtualSession(library, "anna", "ben")
    session.run(1.2)
    session.run(0.35, silent=True)
    person = session.person
    assert (person.state, person.safety, person.force_n[0], person.status.gain) == ("seated", "stale", 0.0, 0.0)
    assert "nothing new" in person.reason
    begun = len(session.forces[0])
    session.run(0.6)
    assert (person.state, person.safety, person.reason, person.status.gain) == ("seated", "live", "", 1.0)
    back = dropwhile(lambda force_n: not force_n, [abs(force[0]) for force in session.forces[0][begun:]])
    for ticks, force_n in enumerate(islice(back, 100), 1):
        assert force_n <= PEAK_N * ticks / HZ / 0.3, "it ramps in"
    assert person.force_n[0] != 0.0
    assert session.largest_step_n() <= SLEW_N
    session.leave()
    loses_nothing(person)


def test_a_seat_is_resumed_by_its_ticket(library: Any) -> None:
    session = VirtualSession(library, "anna")
    session.run(1.0)
    session.run(1.5, silent=True)
    person = session.person
    assert person.state == "resuming"
    hello = session.messages(messages.Hello)[-1]
    assert (hello.ticket, hello.nonce, hello.name) == ("t1", 40, "anna")
    session.run(1.0)
    assert (person.state, person.safety) == ("seated", "live")
    assert person.counts["resumed"] == 1
    assert "line begun anew" not in person.counts
    session.leave()
    loses_nothing(person)


def test_all_lines_of_a_client_lend_one_credit(library: Any) -> None:
    """SPEC 5.4: a server that begins anew again and again gets no more than E0 in all."""
    session = VirtualSession(library, "anna", playout={"concealment": "tank"})
    lent = []
    for _ in range(4):
        session.run(2.5)
        lent.append(session.person.credit_w)
        session.run(0.3, silent=True)  # what fills this gap is never settled
        session.restart()
    assert session.person.counts["line begun anew"] == 3
    assert lent[0] == pytest.approx(2.0 * CREDIT_J * 128)
    assert all(0.0 <= after <= before for before, after in pairwise(lent))
    assert lent[1] < 0.99 * lent[0]


@pytest.mark.parametrize("axes", [1, 2])
def test_a_server_that_begins_anew_gets_a_new_line(library: Any, axes: int) -> None:
    session = VirtualSession(library, "anna", object={"axes": axes}, loss=0.05)
    session.run(1.0)
    session.restart()
    session.run(2.0)
    person = session.person
    assert (person.state, person.safety) == ("seated", "live")
    assert person.counts["line begun anew"] == 1
    session.leave()
    loses_nothing(person)
    assert session.largest_step_n() <= SLEW_N
    assert session.core.dropped["unfit"] == 0


@pytest.mark.parametrize(
    ("tickets", "silent_s", "reason"),
    [(False, 2.3, "the server has been silent for 2 s"), (True, 10.1, "no server for 10 s")],
)
def test_silence_ends_the_session_and_a_resumption(library: Any, tickets: bool, silent_s: float, reason: str) -> None:
    session = VirtualSession(library, "anna", tickets=tickets)
    session.run(1.0)
    session.run(silent_s, silent=True)
    person = session.person
    assert (person.state, person.done, person.force_n[0]) == ("closed", True, 0.0)
    assert person.reason == reason


def test_nobody_there(library: Any) -> None:
    client = CClient(library)
    client.connect(0)
    hellos = 0
    for ms in range(3100):
        client.poll(ms * 1_000_000)
        hellos += sum(hello for _, hello in client.sent())
    assert (client.state, client.reason, hellos) == ("closed", "no server answered within 3 s", 12)
    assert client.done


@pytest.mark.parametrize("end", [Stop("the server was stopped"), Kick("anna", reason="enough")])
def test_a_farewell_is_answered_with_an_account(library: Any, end: Stop | Kick) -> None:
    session = VirtualSession(library, "anna")
    session.run(1.0)
    session.core.handle(end, session.now_ns)
    session.run(0.3)
    person = session.person
    assert (person.state, person.done, person.force_n[0]) == ("closed", True, 0.0)
    assert person.reason.startswith("the server said goodbye: ")
    assert session.account.down.applied > 50
    assert session.largest_step_n() <= SLEW_N
    assert session.core.rooms[0].seats[0].account is not None or isinstance(end, Kick)


@pytest.mark.parametrize(
    ("bad", "why"),
    [(nan, "not finite"), (inf, "not finite"), (-inf, "not finite"), (1e300, "not finite"), (0.5, "jumped")],
)
def test_a_device_that_gives_no_place_of_a_hand_is_let_go_smoothly_and_rearmed(
    library: Any, bad: float, why: str
) -> None:
    session = VirtualSession(library, "anna")
    session.run(1.5)
    person, hand = session.person, session.hands[0]
    assert abs(person.force_n[0]) > 0.01
    good = hand.position_m[:]
    hand.move = lambda time_s, force_n: (bad,)  # type: ignore[method-assign]
    session.step()
    assert (person.safety, why in person.reason) == ("fault", True)
    session.run(0.1)
    assert person.force_n[0] == 0.0
    assert all(abs(force[0]) < inf for force in session.forces[0])
    del hand.move  # type: ignore[attr-defined]
    hand.position_m[:], hand.velocity_mps[:] = good, [0.0]
    session.run(0.1)
    assert (person.safety, person.force_n[0]) == ("fault", 0.0)
    person.rearm()
    session.run(0.5)
    assert (person.safety, person.reason) == ("live", "")
    assert person.force_n[0] != 0.0
    assert session.largest_step_n() <= SLEW_N
    session.leave()
    assert session.sends_what_the_reference_would()
    loses_nothing(person)


@pytest.mark.parametrize(("how", "why"), [("absent", "device stall"), ("skip", "watchdog")])
@pytest.mark.parametrize(("seconds", "faulty"), [(0.015, False), (0.12, True)])
def test_a_device_or_a_loop_that_stalls_is_a_fault(
    library: Any, how: str, why: str, seconds: float, faulty: bool
) -> None:
    session = VirtualSession(library, "anna")
    session.run(1.0)
    session.run(seconds, **{how: True})
    session.run(0.1)
    person = session.person
    assert (person.safety == "fault") is faulty
    assert why in person.reason or not faulty
    session.leave()
    assert person.status.up_margin_j >= -1e-3 - ROUNDING_J


@pytest.mark.parametrize(("ticks", "over"), [(10 * HZ, False), (10 * HZ + 1, True), (2**63 - 1 - 2 * HZ, True)])
def test_a_loop_that_was_away_for_long_has_lost_its_session_and_holds_nobody_up(
    library: Any, ticks: int, over: bool
) -> None:
    session = VirtualSession(library, "anna")
    session.run(1.0)
    session.person.sense(session.tick - 1 + ticks, (0.0,), session.now_ns)
    assert (session.person.state == "closed") is over
    assert ("away for 10 s" in session.person.reason) is over


def test_an_over_speed_is_a_fault(library: Any) -> None:
    session = VirtualSession(library, "anna", config={"speed_mps": 0.05})
    session.run(1.0)
    assert session.person.safety == "fault"
    assert session.person.reason.startswith("over-speed")


def test_ticks_that_were_missed_are_numbered_all_the_same(library: Any) -> None:
    session = VirtualSession(library, "anna")
    session.run(1.0)
    session.run(0.05, skip=True)
    session.leave(1.0)
    assert session.core.rooms[0].seats[0].last is not None
    newest = [message.first + len(message.waves) - 1 for message in session.messages(Waves)]
    assert all(before < after for before, after in pairwise(newest))
    assert newest[-1] >= 2.0 * 128


def test_every_edge_of_a_button_comes_to_the_world_once_and_in_order(library: Any) -> None:
    """Down, up and together, at 30 % loss; the newest orientation and grip come with them."""
    session = VirtualSession(library, "anna", loss=0.3, jitter_ticks=10)
    told = session.buttons()
    session.run(0.5)
    pressed, wanted, down = Random(3), [], 0
    for step in range(60):
        button = pressed.choice([1, 2, 32])
        down ^= 1 << (button - 1)
        wanted.append((button, bool(down >> (button - 1) & 1)))
        session.person.handle(down, (0.5, 0.5, -0.5, 0.5), 0.001 * step)
        session.run(0.04)
    session.run(0.5)
    assert told == wanted
    assert "button edges left out" not in session.person.counts
    port = session.core.rooms[0].seats[0].port
    assert port is not None
    assert (port.handle.orientation, port.handle.grip_m) == ((0.5, 0.5, -0.5, 0.5), 0.001 * 59)
    at_once = [message.handle for message in session.messages(Edges)]
    assert {abs(told.edges[-1]) for told in at_once} == {1, 2, 32}
    assert all(told.ages[-1] == 0 for told in at_once)
    assert session.sends_what_the_reference_would()


def test_edges_beyond_what_a_message_holds_wait_and_those_undone_meanwhile_are_left_out(library: Any) -> None:
    session = VirtualSession(library, "anna")
    told, person = session.buttons(), session.person
    session.run(0.5)
    person.handle(0xFFFFFF)  # 24 edges: 16 of them fit
    session.run(0.1, silent=True)
    person.handle(0x7FFFFF)  # the last of them was never told
    session.run(0.1, silent=True)
    session.run(0.5)
    assert told == [(button, True) for button in range(1, 24)]
    assert person.counts["button edges left out"] == 2


def test_a_new_seat_session_begins_with_all_buttons_up(library: Any) -> None:
    session = VirtualSession(library, "anna")
    session.person.handle(0b101)
    session.run(0.5)
    session.restart()
    told = session.buttons()
    session.run(2.0)
    assert told == [(1, True), (3, True)]


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"coupling": {"kind": "tdpa"}}, "coupling.kind"), ({"coupling": {"kind": "coupling"}}, "coupling.kind"),
    ({"users": [{"name": "anna", "position_scale": 2.0}]}, "scale, turn or clutch"),
    (
        {"object": {"kind": "scene", "file": str(shipped_scene("lift.xml")), "axes": 3}, "coupling": {"kind": "partner"}},
        "no copy",
    ),
    ({"link": {"delay_ms": 5.0}}, "emulated network"), ({"link": {"down": {"loss": 0.1}}}, "emulated network"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "why"), WRONG)
def test_it_refuses_plainly_what_it_cannot_do(library: Any, settings: dict[str, Any], why: str) -> None:
    session = VirtualSession(library, "anna", **settings)
    session.run(0.05)
    person = session.person
    assert (person.state, person.done) == ("closed", True)
    assert why in person.reason
    assert session.messages(messages.Leave)[-1].reason == clipped(person.reason, messages.LEAVE_TEXT_BYTES)
    assert session.core.rooms[0].seats[0].state == "free"


@pytest.mark.parametrize(("device_hz", "closed"), [(128, True), (256, False)])
def test_it_takes_no_seat_that_is_too_slow_for_a_hand(library: Any, device_hz: int, closed: bool) -> None:
    client = CClient(library)
    client.connect(0)
    client.receive(welcome(replace(seat(), rates=Rates(device_hz, 128)), nonce=42), 0)
    assert (client.state == "closed") is closed
    assert ("below 250 Hz" in client.reason) is closed
    assert any(isinstance(decode(datagram), messages.Leave) for datagram, _ in client.sent()) is closed


def test_a_refusal_is_told(library: Any) -> None:
    session = VirtualSession(library, "anna")
    session.run(0.1)
    second = CClient(library, name=b"anna")
    second.connect(session.now_ns)
    for datagram, _ in second.sent():
        session.core.receive(datagram, "another", session.now_ns)
    (answer,) = [datagram for address, datagram in session.core.outbox if address == "another"]
    second.receive(answer, session.now_ns)
    assert (second.state, second.done) == ("closed", True)
    assert second.reason.startswith("the server refused: ")
    assert second.reason.endswith("[taken]")


def test_leaving_releases_the_object_before_the_seat_is_given_back(library: Any) -> None:
    session = VirtualSession(library, "anna", object={"kind": "wall"})
    session.leave(1.4)
    newest = [message.waves[-1] for message in session.messages(Waves)]
    assert abs(newest[-1]) < 0.02 * max(map(abs, newest))


@pytest.mark.parametrize(("change", "why"), [
    ({"axes": 0}, "axes"), ({"axes": 4}, "axes"), ({"rate_hz": 249.0}, "rate_hz"), ({"peak_force_n": 0.0}, "peak_force_n"),
    ({"peak_force_n": nan}, "peak_force_n"), ({"peak_force_n": 1e6}, "peak_force_n"), ({"speed_mps": inf}, "speed_mps"),
    ({"slew_nps": -1.0}, "slew_nps"), ({"carried_nspm": nan}, "carried_nspm"), ({"nonce": 2**63}, "nonce"),
    ({"device": b"x" * 201}, "device"), ({"name": b"\xff"}, "name"), ({"token": b"x" * 641}, "token"),
])  # fmt: skip
def test_a_configuration_that_cannot_be_is_refused(library: Any, change: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        CClient(library, **change)
