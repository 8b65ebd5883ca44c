"""Effects that are accounted for by their work: vibration, texture, constant force, perturbation, curl field (theory 7.8)."""

from math import hypot, pi, sin

from cogrip.client.effects.laws import ActiveLaw, Box, Moment, unit
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Floats
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.effects import Effect

MOST_TURN = 0.2
"""Tangent of the largest angle by which a curl field is turned towards a damper, of a tank that is empty."""


class Vibration(ActiveLaw):
    """Sine of amplitude A and frequency f. Held over ticks of T it would be A sinc(f T): it is divided by that, f T < 1/2."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box = Box(effect, places)
        self._direction = unit(effect.direction, places)
        self._turn = effect.frequency_hz * tick_s
        half = pi * min(self._turn, 0.5)
        self.most_n = effect.amplitude_n * half / sin(half)
        self.slope_nps = 2.0 * pi * effect.frequency_hz * effect.amplitude_n  # of the steps: 2 most_n sin(pi f T) / T

    def present(self, position_m: Floats, ticks: int) -> bool:
        return self._box.inside(position_m)

    def at_zero(self, ticks: int) -> bool:
        return ticks <= 1

    def force(self, at: Moment) -> Floats:
        value = self.most_n * sin(2.0 * pi * ((self._turn * at.ticks) % 1.0))
        return [value * part for part in self._direction]


class Grating(ActiveLaw):
    """Grating: F = A sin(2 pi s / period), s the place along its direction. Its stiffness is 2 pi A / period."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box, self._place = Box(effect, places), effect.place_m[:places]
        self._direction = unit(effect.direction, places)
        self._period = effect.period_m
        self.most_n = effect.amplitude_n
        self.stiffness_npm = 2.0 * pi * effect.amplitude_n / effect.period_m

    def present(self, position_m: Floats, ticks: int) -> bool:
        return self._box.inside(position_m)

    def force(self, at: Moment) -> Floats:
        direction = self._direction
        along = add_floats([n * (x - a) for n, x, a in zip(direction, at.position_m, self._place, strict=False)])
        value = self.most_n * sin(2.0 * pi * ((along / self._period) % 1.0))
        return [value * part for part in direction]


class Constant(ActiveLaw):
    """Constant force on the hand along its direction, while that is in its box."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box, self.most_n = Box(effect, places), effect.force_n
        self._force = [-effect.force_n * part for part in unit(effect.direction, places)]

    def present(self, position_m: Floats, ticks: int) -> bool:
        return self._box.inside(position_m)

    def force(self, at: Moment) -> Floats:
        return self._force


class Perturbation(ActiveLaw):
    """Half a sine over D on the hand, A sin(pi t / D), t since it was told, or since the hand came into its box."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box, self.most_n = Box(effect, places), effect.amplitude_n
        self._direction = unit(effect.direction, places)
        self._begun = None if effect.waits else 0
        self._ticks = round(effect.seconds / tick_s)
        self.slope_nps = pi * effect.amplitude_n / (self._ticks * tick_s)

    def present(self, position_m: Floats, ticks: int) -> bool:
        if self._begun is None and self._box.inside(position_m):
            self._begun = ticks
        return self._begun is not None and ticks - self._begun < self._ticks

    def at_zero(self, ticks: int) -> bool:
        return self._begun is not None and ticks - self._begun <= 1

    def force(self, at: Moment) -> Floats:
        since = (at.ticks - (self._begun or 0)) / self._ticks
        value = -self.most_n * sin(pi * since) if since < 1.0 else 0.0
        return [value * part for part in self._direction]


class CurlField(ActiveLaw):
    """Force on the hand B v x n in a box, across its motion: of two axes B (v_y, -v_x), for n = -z its opposite.

    It does no work, but for its lag. What that takes from the tank a turn of the force towards a damper puts back.
    """

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box, self._places = Box(effect, places), places
        axis = effect.direction if places == PLACES else (0.0, 0.0, effect.direction[2])
        self._x, self._y, self._z = [effect.damping_nspm * part for part in unit(axis, PLACES)]
        self.damping_nspm = effect.damping_nspm

    def present(self, position_m: Floats, ticks: int) -> bool:
        return self._box.inside(position_m)

    def size_n(self, velocity_mps: Floats) -> float:
        return self.damping_nspm * hypot(1.0, MOST_TURN) * hypot(*velocity_mps[: self._places])

    def force(self, at: Moment) -> Floats:
        vx, vy, vz = [*at.velocity_mps[: self._places], 0.0][:PLACES]
        x, y, z, turned = self._x, self._y, self._z, at.missing * MOST_TURN * self.damping_nspm
        row = y * vz - z * vy + turned * vx, z * vx - x * vz + turned * vy, x * vy - y * vx + turned * vz
        return row[: self._places]
