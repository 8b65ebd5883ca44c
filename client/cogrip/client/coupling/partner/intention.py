"""The intended position of one's own hand: where it would be if nothing held it (theory 5b).

Symbols, per axis: x, v position and velocity of the hand, F force on it (P eq. 9), k stiffness that the hand is told to have,
b_e its damping, m_d the device's mass, Lp one pole of tau, a = Lp v's derivative.

    e = Lp x + Lp (F + b_e v) / k + m_d a / k        e' = (Lp x' + Lp (F' + b_e v') / k) through one pole of tau_r

At rest e = x + F / k for any k, and whoever models the hand by k about e finds the same x and F again. Primes are differences
from tick to tick, with the k of now: a k that changes is no motion.

One step q of the encoder moves e by q (1 + K / k), K the spring that holds the hand, and is a rate of
r_q = q (1 + K / k) / tau_r in a hand at rest. Whoever looks ahead by that feels it, and answers with a step: two hands at rest
would tremble on. So what is told of a rate r is r max(0, 1 - (r_q / r)^2): nothing of what a step explains, and nearly all of
what is much faster.
"""

from collections.abc import Sequence

from cogrip.client.coupling.partner.hand_stiffness import HAND_NPM
from cogrip.protocol.laws.partner_model import HAND_NSPM

SMOOTHING_S = 0.01  # tau
RATE_S = 0.04  # tau_r
MOST_MPS = 1.0  # fastest intention: a hand that lets go would tell of any speed


class Intention:
    """Estimate of one hand's intention on all axes, tick by tick.

    place_m   e [m]
    rate_mps  e' [m/s], as it is told
    """

    def __init__(self, axes: int, tick_s: float, mass_kg: float, step_m: float = 0.0, spring_npm: float = 0.0) -> None:
        """step_m: q of the device, 0 for an exact one; spring_npm: K."""
        self._tick_s, self._mass_kg = tick_s, mass_kg
        self._pole, self._rate_pole = tick_s / SMOOTHING_S, tick_s / RATE_S
        self._step_mps, self._spring_npm = step_m / RATE_S, spring_npm
        self.place_m = self.rate_mps = self._rates = [0.0] * axes
        self._places: list[float] | None = None  # Lp x
        self._force = self._velocity = [0.0] * axes  # Lp F, Lp v

    def begin(self, position_m: Sequence[float]) -> None:
        """Begin with a hand at rest here that nothing holds."""
        count = len(position_m)
        self._places = list(position_m)
        self._force, self._velocity = [0.0] * count, [0.0] * count
        self.place_m, self.rate_mps = list(position_m), [0.0] * count
        self._rates = self.rate_mps

    def update(
        self, position_m: Sequence[float], velocity_mps: Sequence[float], force_n: Sequence[float],
        stiffness_npm: float = HAND_NPM,
    ) -> None:  # fmt: skip
        """Enter a tick."""
        if self._places is None:
            self.begin(position_m)
        assert self._places is not None
        pole, rate_pole, tick_s = self._pole, self._rate_pole, self._tick_s
        places, forces, speeds, rates = self._places, self._force, self._velocity, self._rates
        compliance, inertia = 1.0 / stiffness_npm, self._mass_kg / tick_s
        place, rate = [], []
        for axis, x in enumerate(position_m):
            moved = pole * (x - places[axis])
            pushed, gained = pole * (force_n[axis] - forces[axis]), pole * (velocity_mps[axis] - speeds[axis])
            places[axis] = at = places[axis] + moved
            forces[axis] = held = forces[axis] + pushed
            speeds[axis] = speed = speeds[axis] + gained
            place.append(at + (held + HAND_NSPM * speed + inertia * gained) * compliance)
            moving = rates[axis]
            moving += rate_pole * ((moved + (pushed + HAND_NSPM * gained) * compliance) / tick_s - moving)
            rate.append(moving if -MOST_MPS < moving < MOST_MPS else MOST_MPS if moving > 0.0 else -MOST_MPS)
        self.place_m, self.rate_mps, self._rates = place, rate, rate
        if self._step_mps:
            rough = (self._step_mps * (1.0 + self._spring_npm * compliance)) ** 2
            self.rate_mps = [r - rough / r if r * r > rough else 0.0 for r in rate]
