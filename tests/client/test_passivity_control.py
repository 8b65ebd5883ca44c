"""The client's end of time-domain passivity control: an exact energy ledger, and a controller that keeps to it."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.coupling.passivity_control import ASTRAY_MPS, RESERVE_J, SOFT_NPS, PassivityControl
from cogrip.client.inputs import DeviceFailed, ForceApplied, Poll, Stop
from cogrip.protocol.laws.passivity_control import CHARGE_UP_J, LENT_J
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.clock import Clock
from cogrip.protocol.wire.messages import Power, Stamp

from tests.client.seated_client import T_C, T_N, Client, M, at_ns, seat, walk

B = 20.0


def control_of(axes: int = 1, **tables: Any) -> PassivityControl:
    return PassivityControl(seat(object={"axes": axes}, coupling={"kind": "tdpa"}, **tables))


def power(number: int, force: float, entered: float, taken: float = 0.0, axes: int = 1, acknowledged: int = 0) -> Power:
    row = (0.0,) * axes
    return Power(
        7, number, row, row, (force,) * axes, (entered,) * axes, (taken,) * axes, 0.0, acknowledged, Stamp(number + 1)
    )  # fmt: skip


def hear(control: PassivityControl, *said: Any, **more: Any) -> None:
    assert control.receive(power(*said, **more))
    control.start_frame()


def gliding(ticks: int, force: float | None = None) -> tuple[Client, PassivityControl, Callable[[range], list[Power]]]:
    """Return a client whose hand glides for so long, its controller, and how it goes on. force: the server's, if any."""
    client = Client(kind="tdpa")

    def say(number: int) -> None:
        if force is not None:
            client.core.receive(messages.encode(power(number // M, force, 0.0)), at_ns(number))

    def go_on(ticks: range) -> list[Power]:
        client.sent()
        client.run(ticks, lambda number: 1e-4 * number, say, 0.1)
        return [message for message in client.sent() if isinstance(message, Power)]

    go_on(range(ticks))
    assert isinstance(client.core.coupling, PassivityControl)
    return client, client.core.coupling, go_on


def claimed(control: PassivityControl) -> list[float]:
    return [energy.value for energy in control._in]


def run_tick(control: PassivityControl, guess: float, speed: float) -> float:
    """A tick in which the hand moves at `speed` where `guess` was estimated; returns the force."""
    (force,) = control.force((0.0,), (guess,))
    control.applied_n = (force,)
    control.elapse((speed,), (guess,))
    return force


speeds = st.floats(-1.0, 1.0)
ticks = st.lists(st.tuples(speeds, speeds), min_size=1, max_size=40)
energies = st.lists(st.tuples(st.floats(-20.0, 20.0), st.floats(0.0, 0.01), ticks), min_size=1, max_size=6)


@pytest.fixture
def control() -> PassivityControl:
    return control_of()


@given(energies)
def test_what_the_hand_takes_is_paid_up_to_what_one_tick_may_miss(frames: list[Any]) -> None:
    """The bound of docs/decisions/0011-methods.md: in a tick W falls to -E(0), and below it by no more than
    |F| (|dx| - ASTRAY T) of the force that may be given, and what the damper took that pays debts.
    """
    control = control_of()
    said = put = out = 0.0
    for number, (wanted, more, moves) in enumerate(frames):
        said += more
        hear(control, number, wanted, said)
        for guess, speed in moves:
            (before,) = control.left_j
            force = run_tick(control, guess, speed)
            (after,) = control.left_j
            given_n, moved = control._given[0], speed * T_C
            energy = force * moved
            put, out = put + max(0.0, energy), out + max(0.0, -energy)
            beyond = abs(given_n) * max(0.0, abs(moved) - ASTRAY_MPS * T_C)
            damped = max(0.0, -(force - given_n) * moved)
            assert after + LENT_J >= min(0.0, before + LENT_J) - beyond - damped - 1e-15
            assert abs(force - given_n) <= B * abs(guess) + 1e-12
    (left,) = control.left_j
    control.end_frame()
    message = messages.decode(control.message(7, Clock(), 1, (0.0,), (0.0,), (0.0,)))
    kept = put - message.entered_j[0]
    assert left == pytest.approx(said + kept - out, abs=1e-12)  # W = S + kept - out
    assert control.port_j == pytest.approx(put - out, abs=1e-12)
    assert kept >= -1e-15  # nothing is claimed that the hand did not put in
    assert control.down_margin_j is not None
    assert control.down_margin_j <= min(0.0, left) + 1e-15 or left >= control.down_margin_j
    reserve = max(RESERVE_J, abs(wanted) * ASTRAY_MPS * T_C)
    if left <= said + reserve:
        assert said - message.taken_j[0] == pytest.approx(left - reserve, abs=1e-12)


slow = st.lists(st.floats(-ASTRAY_MPS, ASTRAY_MPS), max_size=20)


@given(st.lists(st.tuples(st.floats(-8.0, 8.0), st.floats(0.0, 2e-3), slow), max_size=8))
def test_a_hand_slower_than_the_guess_may_be_wrong_never_takes_more_than_is_there(frames: list[Any]) -> None:
    """W >= -E(0) for any guess of its velocity. The damper that pays a deficit acts where the hand goes."""
    control, said = control_of(), 0.0
    for number, (wanted, more, moves) in enumerate(frames):
        said += more
        hear(control, number, wanted, said)
        for speed in moves:
            run_tick(control, speed, speed)
    assert control.down_margin_j is not None
    assert control.down_margin_j >= -LENT_J - 1e-15


def test_a_force_that_nothing_pays_for_fades_and_one_that_is_paid_for_does_not() -> None:
    rich, poor = control_of(), control_of()
    forces = []
    for control, entered in ((rich, 1.0), (poor, 0.0)):
        hear(control, 0, -3.0, entered)
        control._in = [CompensatedSum(1.0)]  # the server has enough: no damper
        control._left[0].add(RESERVE_J)
        control._given = [-3.0]
        forces.append([run_tick(control, 0.1, 0.1) for _ in range(200)])
    assert forces[0] == [-3.0] * 200
    poorer = [abs(force) for force in forces[1]]
    assert all(after >= before - SOFT_NPS * T_C - 1e-12 for before, after in itertools.pairwise(poorer))
    assert poorer[0] > 2.5
    assert poorer[-1] < 0.5
    assert poor.down_margin_j is not None
    assert poor.down_margin_j >= 0.0
    assert rich.controlled == 0 < poor.controlled


def test_a_hand_that_presses_against_the_force_is_not_controlled(control: PassivityControl) -> None:
    hear(control, 0, 0.2, 0.0)
    control._in = [CompensatedSum(1.0)]
    assert [run_tick(control, 0.1, 0.1) for _ in range(50)] == [0.2] * 50
    assert control.controlled == 0


def test_a_hand_pays_in_by_a_damper_while_the_server_has_nothing_to_take(control: PassivityControl) -> None:
    control._left = [CompensatedSum(1.0)]
    hear(control, 0, 0.0, 0.0, taken=0.0)
    for charged, share in ((0.0, 0.5), (0.5, 0.25), (1.0, 0.0)):
        control._in = [CompensatedSum(charged * CHARGE_UP_J)]
        assert list(control.force((0.0,), (0.04,))) == pytest.approx([share * B * 0.04])


def test_what_is_put_in_pays_debts_first_then_half_of_it_is_kept_until_the_reserve_is_full(
    control: PassivityControl,
) -> None:
    control._left = [CompensatedSum(-1e-3)]
    cases = (
        (5e-4, 0.0, -5e-4), (1.5e-3, 5e-4, 5e-4), (1e-3, 1e-3, 1e-3), (5e-3, 3.5e-3, 3.5e-3), (1e-3, 4e-3, 4e-3),
        (1e-3, 5e-3, 4e-3),
    )  # fmt: skip
    for push, entered, left in cases:
        control.applied_n = (1.0,)
        control.elapse((push / T_C,), (0.0,))
        assert control._in[0].value == pytest.approx(entered, abs=1e-12), push
        assert control.left_j[0] == pytest.approx(left, abs=1e-12), push
    assert control.left_j[0] == pytest.approx(RESERVE_J)


def test_a_strong_force_is_given_in_full_once_enough_is_kept_for_it(control: PassivityControl) -> None:
    """30 N of a wall, which a hand presses into: the reserve follows the force."""
    control._in = [CompensatedSum(1.0)]
    forces = []
    for tick in range(600):
        if tick % M == 0:
            hear(control, tick // M, 30.0, 0.0)
        forces.append(run_tick(control, 0.05, 0.05))
    assert forces[0] < 1.0
    assert forces[-1] == 30.0
    assert control.left_j[0] == pytest.approx(30.0 * ASTRAY_MPS * T_C, rel=0.1)
    assert control.down_margin_j == 0.0


def test_axes_keep_their_own_books() -> None:
    control = control_of(3)
    control.applied_n = (2.0, -1.0, 0.0)
    control.elapse((0.1, 0.1, 0.1), (0.1, 0.1, 0.1))
    assert control.left_j[0] > 0.0 > control.left_j[1]
    assert control.left_j[2] == 0.0
    assert control.down_margin_j == pytest.approx(-0.1 * T_C)


def test_the_newest_message_stands_and_sums_lose_nothing(control: PassivityControl) -> None:
    hear(control, 5, 1.0, 0.3)
    assert control.receive(power(4, 9.0, 0.2))  # too late
    assert control.receive(power(5, 1.0, 0.3))  # twice
    control.start_frame()
    control.start_frame()
    assert (control._wanted, control.left_j) == ((1.0,), (pytest.approx(0.3),))
    hear(control, 9, 2.0, 0.5, acknowledged=3)
    assert control.left_j[0] == pytest.approx(0.5)
    assert control.loop_frames() == 1.0  # this end's frame 4, which answers 3
    count = control.count()
    assert (count.sent, count.applied, count.late, count.lost, count.duplicate) == (10, 2, 1, 7, 1)


@pytest.mark.parametrize("latency", [0, 2])
def test_the_books_hold_what_the_hand_felt_to_the_last_bit_of_work(latency: int) -> None:
    """Ramped, clipped by safety, or by the device: nothing leaks between the hand's work and the channel."""
    client = Client(2, latency=latency, kind="tdpa")
    for number, place in enumerate((walk(3, 400, 2) * 4.0).tolist()):
        if number % M == 0:
            client.core.receive(messages.encode(power(number // M, 1.0, number * 1e-5, axes=2)), number)
        force = client.tick(number, *place, age=latency)
        if number % 7 == 0:
            client.core.handle(ForceApplied(tuple(0.5 * value for value in force)), client.core.now_ns)
    ledger = client.core.ledger
    assert abs(ledger.work_j) > 1e-6
    assert ledger.port_j == pytest.approx(ledger.work_j, abs=1e-15)
    assert ledger.leak_j == pytest.approx(0.0, abs=1e-15)


def test_the_proxy_is_sent_exactly_where_the_hand_went() -> None:
    client = Client(kind="tdpa")
    places = (walk(5, 60 * M + 1, 1)[:, 0] + 0.1).tolist()
    client.run(range(len(places)), lambda number: places[number])
    sent = [message for message in client.sent() if isinstance(message, Power)]
    assert [message.number for message in sent] == list(range(60))
    for message, (before, after) in zip(sent, itertools.pairwise(places[::M]), strict=True):
        assert message.position_m[0] == pytest.approx(after, abs=1e-12)
        assert message.velocity_mps[0] * T_N == pytest.approx(after - before, abs=1e-12)


def test_a_faulty_hand_moves_no_proxy_and_claims_nothing() -> None:
    client, control, go_on = gliding(5 * M + 1)
    client.core.handle(DeviceFailed("device: unplugged"), client.core.now_ns)
    before, place = claimed(control), client.core.position_m[0]
    last = go_on(range(5 * M + 1, 12 * M + 1))[-1]
    assert last.position_m[0] == pytest.approx(place, abs=1e-12)
    assert last.velocity_mps == (0.0,)
    assert claimed(control) == before


def test_who_takes_leave_claims_nothing_and_lets_the_proxy_come_to_a_stop() -> None:
    client, control, go_on = gliding(20 * M + 1, 2.0)
    client.core.handle(Stop(), client.core.now_ns)
    before = claimed(control)
    places = [message.position_m[0] for message in go_on(range(20 * M + 1, 100 * M + 1))]
    assert claimed(control) == before
    steps = [b - a for a, b in itertools.pairwise(places)]
    assert steps[0] > 5e-4
    assert all(b <= a + 1e-12 for a, b in itertools.pairwise(steps))
    assert steps[-1] == pytest.approx(0.0, abs=1e-12)
    assert client.core.may_leave


def test_a_new_server_begins_with_new_books() -> None:
    client, _, go_on = gliding(6 * M + 3)
    before = client.core.ledger.port_j
    quiet_ns = client.core.session.last_received_ns + 600_000_000
    client.core.handle(Poll(), quiet_ns)
    client.renew(quiet_ns)
    control = client.core.coupling
    assert isinstance(control, PassivityControl)
    assert (control.port_j, control.left_j) == (0.0, (0.0,))
    assert client.core.ledger.port_j == before
    first = go_on(range(6 * M + 3, 7 * M + 1))[-1]
    assert first.number == 0
    assert first.position_m[0] == pytest.approx(1e-4 * 7 * M, abs=1e-12)


def test_constants_are_per_second_and_not_per_tick() -> None:
    """A guess may be wrong by so many m/s, a force may change by so many N/s, at every device rate."""
    slow, fast = control_of(), control_of(rates={"device_hz": 8192, "network_hz": 128})
    assert fast._astray_m * 8 == pytest.approx(slow._astray_m)
    assert fast._soft_n * 8 == pytest.approx(slow._soft_n)
    assert fast._horizon == pytest.approx(8 * slow._horizon)
    assert math.isclose(slow._soft_n, SOFT_NPS / 1024)
