"""The intended position of one's own hand: where it would be if nothing held it (theory 5b).

Symbols, per axis: x, v position and velocity of the hand, F force on it (P eq. 9), k stiffness that the hand is told to have,
b_e its damping, m_d the device's mass, Lp one pole of tau, a = Lp v's derivative.

    e = Lp[x + (F + b_e v) / k] + m_d a / k          e' = backward difference of Lp[...] through one pole of tau_r

At rest e = x + F / k for any k, and whoever models the hand by k about e finds the same x and F again.
"""

from collections.abc import Sequence

HAND_NPM = 150.0  # k, told for every hand
HAND_NSPM = 5.0  # b_e
SMOOTHING_S = 0.02  # tau
RATE_S = 0.06  # tau_r


class Intention:
    """Estimate of one hand's intention on all axes, tick by tick.

    place_m   e [m]
    rate_mps  e' [m/s]
    """

    def __init__(self, axes: int, tick_s: float, mass_kg: float) -> None:
        self._tick_s, self.mass_kg = tick_s, mass_kg
        self._pole, self._rate_pole = tick_s / SMOOTHING_S, tick_s / RATE_S
        self.place_m = self.rate_mps = [0.0] * axes
        self._filtered: list[float] | None = None
        self._velocity = [0.0] * axes

    def begin(self, position_m: Sequence[float]) -> None:
        """Begin with a hand at rest here that nothing holds."""
        zero = [0.0] * len(position_m)
        self._filtered, self._velocity = list(position_m), zero
        self.place_m, self.rate_mps = list(position_m), list(zero)

    def update(self, position_m: Sequence[float], velocity_mps: Sequence[float], force_n: Sequence[float]) -> None:
        """Enter a tick."""
        if self._filtered is None:
            self.begin(position_m)
        assert self._filtered is not None
        place, rate = [], []
        for axis, (x, v, force) in enumerate(zip(position_m, velocity_mps, force_n, strict=True)):
            self._velocity[axis] += self._pole * (v - self._velocity[axis])
            acceleration = (v - self._velocity[axis]) / SMOOTHING_S
            before = self._filtered[axis]
            self._filtered[axis] = now = before + self._pole * (x + (force + HAND_NSPM * v) / HAND_NPM - before)
            place.append(now + self.mass_kg * acceleration / HAND_NPM)
            moving = self.rate_mps[axis]
            rate.append(moving + self._rate_pole * ((now - before) / self._tick_s - moving))
        self.place_m, self.rate_mps = place, rate
