"""The server's end of time-domain passivity control: what comes out was announced, and limits hold whoever announces it."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.laws.passivity_control import CHARGE_DOWN_J, LENT_J
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.clock import Clock
from cogrip.protocol.wire.messages import Power, Stamp, decode
from cogrip.server.ports.power_port import PowerPort
from cogrip.server.ports.seat_limits import BURST_S, SeatLimits
from cogrip.server.worlds.power import PowerWorld

T = 1 / 128
UNBOUNDED = SeatLimits()


def settings_of(axes: int = 1, **coupling: Any) -> Any:
    return resolve({"object": {"axes": axes}, "coupling": {"kind": "tdpa", **coupling}, "users": [{"name": "a"}]})


def power(number: int, place: float, speed: float, entered: float, taken: float = 0.0, axes: int = 1) -> Power:
    return Power(
        1, number, (place,) * axes, (speed,) * axes, (0.0,) * axes, (entered,) * axes, (taken,) * axes, entered, 0,
        Stamp(number + 1),
    )  # fmt: skip


class Seat:
    """A port with a world of its own, stepped as a room does it."""

    def __init__(self, limits: SeatLimits = UNBOUNDED, axes: int = 1, **coupling: Any) -> None:
        self.seat = seat_settings(settings_of(axes, **coupling), 0)
        self.port = PowerPort(self.seat, limits)
        self.world = PowerWorld([self.seat])

    def step(self, message: Power | None) -> tuple[float, ...]:
        if message is not None:
            assert self.port.receive(message, 0)
        if not self.world.holding[0]:
            assert self.port.origin is not None
            self.world.join(0, self.world.position + self.port.origin)
        (answer,) = self.world.advance([self.port.pop(1)])
        self.port.push(tuple(answer))
        return tuple(answer)


moves = st.lists(
    st.tuples(st.floats(-2.0, 2.0), st.floats(0.0, 1e-3) | st.floats(0.0, 1e15), st.booleans()), min_size=1, max_size=40
)


@given(moves, st.integers(1, 3), st.floats(1.0, 1e6))
def test_no_step_takes_more_than_was_announced(hand: list[Any], axes: int, stiffness: float) -> None:
    seat, place, said, newest, stepped = Seat(axes=axes, stiffness_npm=stiffness), 0.0, 0.0, 0.0, False
    for number, (speed, more, lost) in enumerate(hand):
        place, said = place + speed * T, said + more
        if lost and stepped:
            seat.step(None)
        else:
            newest, stepped = said, True
            seat.step(power(number, place, speed, said, axes=axes))
        assert all(left >= -LENT_J / axes - 1e-12 * (1.0 + newest) for left in seat.port.left_j)
        assert seat.port.made_j - seat.port.used_j == pytest.approx(
            -seat.world.port_work_j()[0], abs=1e-9 * (1.0 + newest)
        )
    assert seat.port.up_margin_j is not None
    assert seat.port.up_margin_j >= -LENT_J / axes - 1e-12 * (1.0 + newest)


@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 1e15)), min_size=1, max_size=60),
    st.floats(0.01, 10.0),
    st.integers(1, 2),
)
def test_a_hand_that_claims_all_the_energy_there_is_brings_in_no_more_than_its_power(
    hand: list[Any], watt: float, axes: int
) -> None:
    seat, place = Seat(SeatLimits(8.0, 1.0, watt), axes=axes, stiffness_npm=1e5), 0.0
    limit = watt * BURST_S
    for number, (speed, claimed) in enumerate(hand):
        speed /= axes  # within V in any direction
        place += speed * T
        seat.step(power(number, place, speed, claimed, axes=axes))
        brought = seat.port.used_j - seat.port.made_j
        assert brought <= limit + watt * T * number + 1e-9
    assert 0.0 <= seat.port.power_left <= 1.0
    assert set(seat.port.limited) <= {"power limited", "state out of bounds"}


def test_power_that_is_held_back_is_counted_and_an_honest_hand_is_never_touched() -> None:
    """The wave limiter's promise: power F V lets a hand through that gives no more than its device can."""
    rude, honest = Seat(SeatLimits(8.0, 1.0, 0.05), stiffness_npm=5000.0), Seat(SeatLimits(8.0, 1.0, 8.0))
    for number in range(200):
        rude.step(power(number, number * T * 0.9, 0.9, 1e15))
        place = 0.01 * math.sin(0.1 * number)
        honest.step(power(number, place, 0.001 / T * math.cos(0.1 * number), number * 1e-4))
    assert rude.port.limited["power limited"] > 100
    assert rude.port.power_left < 0.1
    assert honest.port.limited == {}


def test_a_state_that_no_such_hand_can_be_in_is_dropped_and_counted() -> None:
    seat = Seat(SeatLimits(8.0, 1.0, 8.0))
    seat.step(power(0, 0.0, 0.5, 0.0))
    assert seat.port.receive(power(1, 0.9, 0.5, 0.0), 0)  # farther than V lets a hand go
    assert seat.port.receive(power(2, 0.0, 1.1, 0.0), 0)
    assert seat.port.limited == {"state out of bounds": 2}
    assert seat.port.count().received == 1


def test_what_does_not_fit_the_axes_is_unfit() -> None:
    seat = Seat(axes=2)
    assert not seat.port.receive(power(0, 0.0, 0.0, 0.0, axes=1), 0)
    assert seat.port.origin is None
    assert seat.port.receive(power(0, 0.3, 1.28, 0.0, axes=2), 0)
    assert seat.port.origin == pytest.approx((0.29, 0.29))  # before the frame that came


def test_where_no_message_came_the_proxy_is_asked_for_no_speed_but_still_for_its_place() -> None:
    seat = Seat()
    assert seat.port.receive(power(0, 0.01, 1.28, 0.5, taken=0.0), 0)
    assert seat.port.pop(1) == (0.01, 1.28, 0.5 + LENT_J, 0.0)
    seat.port.push((2.0, -0.064))  # F w T = -1 mJ: gone in
    assert seat.port.pop(1) == (0.01, 0.0, 0.5 + LENT_J, pytest.approx(1e-3 / CHARGE_DOWN_J))
    assert seat.port.receive(power(3, 0.01, 0.0, 0.5, taken=5e-4), 0)
    assert seat.port.pop(1)[3] == pytest.approx(5e-4 / CHARGE_DOWN_J)
    message = decode(seat.port.message(9, Clock(), 1, (0.1, 0.2), -0.25))
    assert isinstance(message, Power)
    (entered_j,) = message.entered_j
    assert (message.number, message.force_n, entered_j, message.taken_j) == (0, (2.0,), pytest.approx(1e-3), (0.0,))
    assert (message.position_m, message.velocity_mps) == ((0.1,), (0.2,))
    assert (message.port_j, message.acknowledged) == (-0.25, 4)
    assert (seat.port.lost, seat.port.count().sent) == (2, 4)


def test_a_seat_that_is_taken_again_finds_no_fuller_bucket() -> None:
    port = PowerPort(seat_settings(settings_of(), 0), SeatLimits(8.0, 1.0, 1.0), 0.25)
    assert port.power_left == pytest.approx(0.25)
