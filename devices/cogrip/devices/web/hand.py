"""The hand of a pointer: a spring whose set-point follows the pointer within bounds of energy, speed and stretch.

The set-point is modulated (Lee and Huang 2010; theory section 7.5): a step from p to p+ puts K_h (|p+ - x|^2 - |p - x|^2) / 2
into the spring, which a tank has to pay. The tank is filled with the power of a hand and holds BURST_S of it: a pointer that
jumps puts in no more than a hand could.
"""

from collections.abc import Sequence
from math import sqrt

import msgspec

from cogrip.devices.settings import Positive
from cogrip.devices.simulated.hands import Vector
from cogrip.devices.simulated.phantom import PhantomPlant
from cogrip.protocol.settings import HUMAN_POWER_W

BURST_S = 0.05  # of the power that the tank holds at most
SILENCE_S = 0.1  # without a pointer message: the hand lets go
RELEASE_S = 0.05  # in which the spring goes slack
SPEED_MPS = 1.0  # of the set-point
STRETCH_N = 5.0  # most force of the spring
FOLLOWS = 0.9  # share of the damper that a hand that has let go no longer makes felt


class PointerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys of the hand. power_w: largest mean power of the pointer."""

    hand_stiffness_npm: Positive = 400.0
    hand_damping_nspm: Positive = 8.0
    power_w: Positive = HUMAN_POWER_W


class PointerHand:
    """A `Hand` that `point` moves.

    entered_j  energy that steps of the set-point have put into the spring so far
    """

    def __init__(self, settings: PointerSettings, plant: PhantomPlant) -> None:
        """plant: of which this hand holds the device."""
        self.stiffness_npm = settings.hand_stiffness_npm
        self.damping_nspm = settings.hand_damping_nspm
        self.entered_j = 0.0
        self._power_w = settings.power_w
        self._plant = plant
        self._rate_hz = 1
        self._target: Sequence[float] = ()
        self._set_point: list[float] = []
        self._held = False
        self._tension = 0.0  # 1 holding, 0 slack
        self._heard = 0  # tick of the newest pointer message
        self._tank_j = 0.0

    @property
    def holds(self) -> bool:
        """True while the pointer holds the device."""
        return self._held

    def open(self, rate_hz: int, home_m: Vector | None) -> Vector:
        """See `Hand.open`."""
        self._rate_hz = rate_hz
        home = home_m or (0.0,) * len(self._plant.position_m)
        self._set_point, self._target = list(home), home
        self._held, self._tension, self._heard = False, 0.0, 0
        self._tank_j, self.entered_j = self._power_w * BURST_S, 0.0
        return home

    def point(self, tick: int, target_m: Sequence[float], *, holds: bool) -> None:
        """Take a pointer's message: where it is, on the axes of the device, and whether it holds."""
        if holds:
            if not self._held:
                self._take_hold()
            self._target = target_m[: len(self._set_point)]
        self._held, self._heard = holds, tick

    def _take_hold(self) -> None:
        """Begin where the device is: what is left of the last grip's stretch stays."""
        at = self._plant.position_m
        self._set_point = [x + self._tension * (p - x) for x, p in zip(at, self._set_point, strict=True)]
        self._tension = 1.0

    def intended(self, tick: int) -> tuple[Vector, Vector]:
        """See `Hand.intended`."""
        at, speed = self._plant.position_m, self._plant.velocity_mps
        g, follows = self._tension, FOLLOWS * (1.0 - self._tension)
        place = tuple([x + g * (p - x) for x, p in zip(at, self._set_point, strict=True)])
        return place, tuple([follows * v for v in speed])

    def drive(self, tick: int) -> Sequence[float]:
        """See `Hand.drive`. Moves the set-point by one tick."""
        if self._held and tick - self._heard > SILENCE_S * self._rate_hz:
            self._held = False
        self._tank_j = min(self._tank_j + self._power_w / self._rate_hz, self._power_w * BURST_S)
        if self._held:
            self._move()
        elif self._tension > 0.0:
            self._tension = max(0.0, self._tension - 1.0 / (RELEASE_S * self._rate_hz))
        place, speed = self.intended(tick)
        K, B = self.stiffness_npm, self.damping_nspm
        return [K * p + B * v for p, v in zip(place, speed, strict=True)]

    def _move(self) -> None:
        """Move the set-point towards the target as far as speed, stretch and tank allow."""
        at, K = self._plant.position_m, self.stiffness_npm
        pulled = [p - x for p, x in zip(self._set_point, at, strict=True)]
        step = [t - p for t, p in zip(self._target, self._set_point, strict=True)]
        length = sqrt(sum([d * d for d in step]))
        if length == 0.0:
            return
        share = min(1.0, SPEED_MPS / self._rate_hz / length)
        # K/2 (2 s (pulled . step) + s^2 |step|^2) is what a share s of the step puts in: at most the tank, and at most the
        # spring's own largest energy less what it has.
        along = sum([p * d for p, d in zip(pulled, step, strict=True)])
        stored_j = 0.5 * K * sum([p * p for p in pulled])
        room_j = min(self._tank_j, max(0.0, 0.5 * STRETCH_N * STRETCH_N / K - stored_j))
        share = min(share, (sqrt(along * along + 2.0 * room_j / K * length * length) - along) / (length * length))
        put_in_j = 0.5 * K * (2.0 * share * along + share * share * length * length)
        if put_in_j > 0.0:
            self._tank_j -= put_in_j
            self.entered_j += put_in_j
        self._set_point = [p + share * d for p, d in zip(self._set_point, step, strict=True)]
