"""The hand of a pointer: a spring whose set-point follows the pointer as a hand could.

The set-point is modulated (Lee and Huang 2010; theory section 7.5): a step from p to p+ puts K_h (|p+ - x|^2 - |p - x|^2) / 2
into the spring, which an energy budget has to cover. The budget grows with the power of a hand, up to BURST_S of it: a
pointer that jumps puts in no more than a hand could. Speed and acceleration are bounded as well, or a pointer that shakes, or
beats on a wall, would be taken for a force that oscillates, which is a fault: in free space an acceleration a of the device
brings a force that reverses with each frame, b a / (2 network_hz), 0.25 N at 3.2 m/s^2 with the usual b.

A hand that has let go is no load: its spring is slack, and its damper moves with the device.
"""

from collections.abc import Sequence
from math import sqrt

import msgspec

from cogrip.devices.settings import Positive
from cogrip.devices.simulated.phantom import PhantomPlant
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.settings.types import HUMAN_POWER_W

BURST_S = 0.05  # time over which the hand's power fills the energy budget
SILENCE_S = 0.1  # time without a pointer message after which the hand lets go; one comes every 50 ms while it holds
RELEASE_S = 0.05  # time in which the hand lets go, and in which its damper takes hold again
SPEED_MPS = 0.5  # largest speed of the set-point: an unhurried reach
ACCELERATION_MPS2 = 2.5  # largest acceleration of the set-point: a reach of 0.1 m takes 0.4 s
SETTLE_S = 0.005  # time constant of the set-point's last bit of the way
STRETCH_N = 3.0
"""Largest force of the spring: it pulls at 0.18 m/s against the damper. Pulled farther it drags the set-point along."""


def lead_m(speed_mps: float) -> float:
    """Return how far ahead of the set-point a target has to be for it to go at this speed: see `PointerHand._accelerated`."""
    A, tau = ACCELERATION_MPS2, SETTLE_S
    if speed_mps < A * tau:
        return speed_mps * tau
    return 0.5 * (speed_mps * speed_mps / A + A * tau * tau)


class PointerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys of the hand. power_w: largest mean power of the pointer."""

    hand_stiffness_npm: Positive = 400.0
    hand_damping_nspm: Positive = 16.0
    power_w: Positive = HUMAN_POWER_W


class PointerHand:
    """A `Hand` that `point` moves.

    entered_j    energy that steps of the set-point have put into the spring so far
    set_point_m  where the spring's other end is
    """

    def __init__(self, settings: PointerSettings, plant: PhantomPlant) -> None:
        """plant: of which this hand holds the device."""
        self.stiffness_npm = settings.hand_stiffness_npm
        self.damping_nspm = settings.hand_damping_nspm
        self.entered_j = 0.0
        self.set_point_m: list[float] = []
        self._power_w = settings.power_w
        self._plant = plant
        self._rate_hz = 1
        self._target: Sequence[float] = ()
        self._speed_mps: list[float] = []  # of the set-point
        self._held = False
        self._tension = 0.0  # of the spring: 1 holding, 0 slack
        self._grip = 0.0  # of the damper: 1 holding, 0 moving with the device
        self._newest_tick = 0  # of pointer messages
        self._moved = -1  # tick whose step the set-point has made
        self._budget_j = 0.0

    @property
    def holds(self) -> bool:
        """True while the pointer holds the device."""
        return self._held

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`."""
        self._rate_hz = rate_hz
        home = home_m or (0.0,) * len(self._plant.position_m)
        self.set_point_m, self._target, self._speed_mps = list(home), home, [0.0] * len(home)
        self._held, self._tension, self._grip, self._newest_tick, self._moved = False, 0.0, 0.0, 0, -1
        self._budget_j, self.entered_j = self._power_w * BURST_S, 0.0
        return home

    def point(self, tick: int, target_m: Sequence[float], *, holds: bool) -> None:
        """Take a pointer's message: where it is, on the axes of the device, and whether it holds."""
        if holds:
            if not self._held:
                self._take_hold()
            self._target = target_m[: len(self.set_point_m)]
        self._held, self._newest_tick = holds, tick

    def let_go(self) -> None:
        """Let go at once: there is nobody at the pointer any more."""
        self._held = False

    def _take_hold(self) -> None:
        """Begin with the force that there is: what is left of the last grip's stretch."""
        at = self._plant.position_m
        self.set_point_m = [x + self._tension * (p - x) for x, p in zip(at, self.set_point_m, strict=True)]
        self._speed_mps = [0.0] * len(at)
        self._tension = 1.0

    def intended(self, tick: int) -> tuple[Row, Row]:
        """See `Hand.intended`."""
        at, speed = self._plant.position_m, self._plant.velocity_mps
        g, follows = self._tension, 1.0 - self._grip
        place = tuple([x + g * (p - x) for x, p in zip(at, self.set_point_m, strict=True)])
        return place, tuple([follows * v for v in speed])

    def drive(self, tick: int) -> Sequence[float]:
        """See `Hand.drive`. The first call of a tick moves the set-point."""
        if tick > self._moved:
            self._moved = tick
            self._step(tick)
        place, speed = self.intended(tick)
        K, B = self.stiffness_npm, self.damping_nspm
        return [K * p + B * v for p, v in zip(place, speed, strict=True)]

    def force_n(self) -> list[float]:
        """Return the force of the hand on the device."""
        at, speed = self._plant.position_m, self._plant.velocity_mps
        g, h = self._tension * self.stiffness_npm, self._grip * self.damping_nspm
        return [g * (p - x) - h * v for p, x, v in zip(self.set_point_m, at, speed, strict=True)]

    def _step(self, tick: int) -> None:
        """Let go after a silence; fill the energy budget; move grip and set-point by one tick."""
        if self._held and tick - self._newest_tick > SILENCE_S * self._rate_hz:
            self._held = False
        self._budget_j = min(self._budget_j + self._power_w / self._rate_hz, self._power_w * BURST_S)
        change = 1.0 / (RELEASE_S * self._rate_hz)
        if self._held:
            self._grip = min(1.0, self._grip + change)
            self._yield()
            self._move()
        else:
            self._grip = max(0.0, self._grip - change)
            self._tension = max(0.0, self._tension - change)

    def _yield(self) -> None:
        """Bring the set-point along where the device is pulled away from it."""
        at, most_m = self._plant.position_m, STRETCH_N / self.stiffness_npm
        pulled = [p - x for p, x in zip(self.set_point_m, at, strict=True)]
        stretch_m = sqrt(add_floats([d * d for d in pulled]))
        if stretch_m > most_m:
            share = most_m / stretch_m
            self.set_point_m = [x + share * d for x, d in zip(at, pulled, strict=True)]

    def _move(self) -> None:
        """Move the set-point towards the target as far as acceleration, speed, stretch and energy budget allow."""
        at, rate, K = self._plant.position_m, self._rate_hz, self.stiffness_npm
        speed = self._accelerated()
        step = [v / rate for v in speed]
        square = add_floats([d * d for d in step])
        if square == 0.0:
            return
        # K/2 (2 s (pulled . step) + s^2 |step|^2) is what a share s of the step puts in: at most the budget, and at most the
        # spring's own largest energy less what it has.
        pulled = [p - x for p, x in zip(self.set_point_m, at, strict=True)]
        along = add_floats([p * d for p, d in zip(pulled, step, strict=True)])
        stored_j = 0.5 * K * add_floats([p * p for p in pulled])
        room_j = min(self._budget_j, max(0.0, 0.5 * STRETCH_N * STRETCH_N / K - stored_j))
        share = min(1.0, (sqrt(along * along + 2.0 * room_j / K * square) - along) / square)
        put_in_j = 0.5 * K * (2.0 * share * along + share * share * square)
        if put_in_j > 0.0:
            self._budget_j -= put_in_j
            self.entered_j += put_in_j
        self.set_point_m = [p + share * d for p, d in zip(self.set_point_m, step, strict=True)]
        self._speed_mps = [share * v for v in speed]

    def _accelerated(self) -> list[float]:
        """Return the set-point's next velocity: towards the target, so that it can stop there."""
        A, tau = ACCELERATION_MPS2, SETTLE_S
        away = [t - p for t, p in zip(self._target, self.set_point_m, strict=True)]
        length = sqrt(add_floats([d * d for d in away]))
        near = A * tau * tau  # within which it is approached with the time constant, without more than A
        wanted = min(SPEED_MPS, length / tau if length < near else sqrt(2.0 * A * (length - 0.5 * near)))
        change = [wanted / length * d - v if length else -v for d, v in zip(away, self._speed_mps, strict=True)]
        size, most = sqrt(add_floats([d * d for d in change])), A / self._rate_hz
        share = min(1.0, most / size) if size else 0.0
        return [v + share * d for v, d in zip(self._speed_mps, change, strict=True)]
