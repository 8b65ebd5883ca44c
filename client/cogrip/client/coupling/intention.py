"""The intended position of one's own hand: where it would be if nothing held it (theory 5b).

Symbols, per axis: x, v position and velocity of the hand, F force on it (P eq. 9), k stiffness that the hand is told to have,
b_e its damping, m_d the device's mass, Lp one pole of tau, a = Lp v's derivative.

    e = Lp x + Lp (F + b_e v) / k + m_d a / k        e' = (Lp x' + Lp (F' + b_e v') / k) through one pole of tau_r

At rest e = x + F / k for any k, and whoever models the hand by k about e finds the same x and F again. Primes are differences
from tick to tick, with the k of now: a k that changes is no motion.
"""

from collections.abc import Sequence

from cogrip.client.coupling.hand_stiffness import HAND_NPM
from cogrip.protocol.laws.partner_model import HAND_NSPM

SMOOTHING_S = 0.01  # tau
RATE_S = 0.03  # tau_r
MOST_MPS = 1.0  # fastest intention: a hand that lets go would tell of any speed


class Intention:
    """Estimate of one hand's intention on all axes, tick by tick.

    place_m   e [m]
    rate_mps  e' [m/s]
    """

    def __init__(self, axes: int, tick_s: float, mass_kg: float) -> None:
        self._tick_s, self._mass_kg = tick_s, mass_kg
        self._pole, self._rate_pole = tick_s / SMOOTHING_S, tick_s / RATE_S
        self.place_m = self.rate_mps = [0.0] * axes
        self._places: list[float] | None = None  # Lp x
        self._force = self._velocity = [0.0] * axes  # Lp F, Lp v

    def begin(self, position_m: Sequence[float]) -> None:
        """Begin with a hand at rest here that nothing holds."""
        count = len(position_m)
        self._places = list(position_m)
        self._force, self._velocity = [0.0] * count, [0.0] * count
        self.place_m, self.rate_mps = list(position_m), [0.0] * count

    def update(
        self, position_m: Sequence[float], velocity_mps: Sequence[float], force_n: Sequence[float],
        stiffness_npm: float = HAND_NPM,
    ) -> None:  # fmt: skip
        """Enter a tick."""
        if self._places is None:
            self.begin(position_m)
        assert self._places is not None
        pole, place, rate = self._pole, [], []
        for axis, (x, v, force) in enumerate(zip(position_m, velocity_mps, force_n, strict=True)):
            moved = pole * (x - self._places[axis])
            pushed, gained = pole * (force - self._force[axis]), pole * (v - self._velocity[axis])
            self._places[axis] = at = self._places[axis] + moved
            self._force[axis] = held = self._force[axis] + pushed
            self._velocity[axis] = speed = self._velocity[axis] + gained
            place.append(at + (held + HAND_NSPM * speed + self._mass_kg * gained / self._tick_s) / stiffness_npm)
            moved += (pushed + HAND_NSPM * gained) / stiffness_npm
            moving = self.rate_mps[axis]
            moving += self._rate_pole * (moved / self._tick_s - moving)
            rate.append(min(MOST_MPS, max(-MOST_MPS, moving)))
        self.place_m, self.rate_mps = place, rate
