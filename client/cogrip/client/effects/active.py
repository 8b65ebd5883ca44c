"""Effects with a force of their own course: vibration over time, texture over position (theory 7.8)."""

from math import pi, sin

from cogrip.client.effects.laws import ActiveLaw, Box, unit
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Floats
from cogrip.protocol.settings.effects import Effect


class Vibration(ActiveLaw):
    """Sine of amplitude A and frequency f. Held over ticks of T it would be A sinc(f T): it is divided by that, f T < 1/2."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box = Box(effect, places)
        self._direction = unit(effect.direction, places)
        self._turn = effect.frequency_hz * tick_s
        half = pi * min(self._turn, 0.5)
        self.most_n = effect.amplitude_n * half / sin(half)
        self.slope_nps = 2.0 * pi * effect.frequency_hz * effect.amplitude_n  # of the steps: 2 most_n sin(pi f T) / T

    def present(self, position_m: Floats) -> bool:
        return self._box.inside(position_m)

    def force(self, position_m: Floats, ticks: int) -> Floats:
        value = self.most_n * sin(2.0 * pi * ((self._turn * ticks) % 1.0))
        return [value * part for part in self._direction]


class Grating(ActiveLaw):
    """Grating: F = A sin(2 pi s / period), s the place along its direction. Its stiffness is 2 pi A / period."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box, self._place = Box(effect, places), effect.place_m[:places]
        self._direction = unit(effect.direction, places)
        self._period = effect.period_m
        self.most_n = effect.amplitude_n
        self.stiffness_npm = 2.0 * pi * effect.amplitude_n / effect.period_m

    def present(self, position_m: Floats) -> bool:
        return self._box.inside(position_m)

    def force(self, position_m: Floats, ticks: int) -> Floats:
        direction = self._direction
        along = add_floats([n * (x - a) for n, x, a in zip(direction, position_m, self._place, strict=False)])
        value = self.most_n * sin(2.0 * pi * ((along / self._period) % 1.0))
        return [value * part for part in direction]
