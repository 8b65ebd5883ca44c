"""Loop gain of people who feel each other by models (theory 5b): what an intention that is off makes of the others'.

Symbols: s = 2 pi i f; N people; k_h, b_h stiffness and damping of a hand, m, b_d of its device; k, b_e, m_d what whoever
estimates the intention takes them for; K, B own spring, m_o, d object; m_m, b_m of a model; tau, tau_r, h as in `intention`:

    c = K + B s    Z = m s^2 + (b_h + b_d) s + k_h    Z_m = m_m s^2 + b_m s + k    a = c / (Z + c)    b = c / (Z_m + c)
    X = a b k / (m_o s^2 + d s + N c - c a - (N - 1) c b)
    E = 1 - (Z - b_e s) / k        R = s / (1 + tau_r s)        H = h + g b_a / (k (1 + tau_u s)), g b_a, tau_u of the drift
    L = 1 / (1 + tau s) ((1 + H R) E + m_d s^2 / k) X

An intention of one partner comes into that of another by L, late by the loop. With (N - 1) |L| < 1 at all f no delay makes the
loop unstable, without its gates (small gain): a sufficient condition, and no more.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cogrip.client.coupling.partner.hand_stiffness import HAND_NPM, LEAST_NPM, MOST_NPM
from cogrip.client.coupling.partner.intention import RATE_S, SMOOTHING_S
from cogrip.protocol.laws.partner_model import ADDED_NSPM, DAMPED_NPM, DRIFT_S, DRIFTING, HAND_NSPM, HORIZON_S, MODEL_KG

Array = NDArray[np.float64]
FREQUENCIES_HZ: Array = np.geomspace(0.01, 100.0, 4000)


class PartnerLoop(NamedTuple):
    """A room: springs, object and devices, and how intentions are estimated and taken on."""

    people: int
    spring_npm: float
    spring_nspm: float
    object_kg: float
    object_nspm: float
    device_kg: float
    device_nspm: float
    smoothing_s: float = SMOOTHING_S
    rate_s: float = RATE_S
    horizon_s: float = HORIZON_S
    model_kg: float = MODEL_KG
    model_nspm: float = HAND_NSPM + ADDED_NSPM  # of one whose intentions are late

    def gains(self, frequencies_hz: Array, hand_npm: float, told_npm: float, hand_nspm: float) -> Array:
        """Return (N - 1) |L| at frequencies [Hz] for hands of this stiffness and damping, told to be of `told_npm`."""
        s = 2j * np.pi * frequencies_hz
        people, k = self.people, told_npm
        c = self.spring_npm + self.spring_nspm * s
        own = self.device_kg * s**2 + (hand_nspm + self.device_nspm) * s + hand_npm
        model = self.model_kg * s**2 + self.model_nspm * min(1.0, k / DAMPED_NPM) * s + k
        a, b = c / (own + c), c / (model + c)
        weight = self.object_kg * s**2 + self.object_nspm * s + people * c - c * a - (people - 1) * c * b
        moved = a * b * k / weight
        estimate = 1.0 - (own - HAND_NSPM * s) / k
        carried = DRIFTING * (self.model_nspm - HAND_NSPM) / max(k, DAMPED_NPM)
        ahead = 1.0 + (self.horizon_s + carried / (1.0 + DRIFT_S * s)) * s / (1.0 + self.rate_s * s)
        loop = (ahead * estimate + self.device_kg * s**2 / k) * moved / (1.0 + self.smoothing_s * s)
        found: Array = (people - 1) * np.abs(loop)
        return found

    def gain(self, hand_npm: float, told_npm: float, hand_nspm: float = HAND_NSPM) -> float:
        """Return the largest (N - 1) |L| at any frequency."""
        return float(self.gains(FREQUENCIES_HZ, hand_npm, told_npm, hand_nspm).max())

    def worst(self, hand_npm: float) -> float:
        """Return the larger gain: before anything is known of this hand, and once its stiffness is known."""
        known = min(MOST_NPM, max(LEAST_NPM, hand_npm))
        return max(self.gain(hand_npm, HAND_NPM), self.gain(hand_npm, known))

    def felt_npm(self, hand_npm: float) -> float:
        """Return the stiffness that a hand feels at rest against all others, each a hand of `hand_npm` that holds still."""
        others = (self.people - 1) / (1.0 / self.spring_npm + 1.0 / hand_npm)
        return 1.0 / (1.0 / self.spring_npm + 1.0 / others)
