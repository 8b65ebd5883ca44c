"""Exact discretisation of one axis with its input held over a tick.

    m x'' + b x' + K x = f          f constant over T

symbols: m mass [kg], b damping [N s/m], K stiffness [N/m], T tick [s], f input force [N], x position [m], v = x' [m/s].
With the rest force r = f - K x at the start of the tick the exact step is, in increments (so that rest stays rest to
the bit),

    x+ = x + p v + g r              v+ = q v + h r

p, q are entries (0,1), (1,1) and g, h the input column of expm([[0, 1, 0], [-K/m, -b/m, 1/m], [0, 0, 0]] T): since f =
K x is an equilibrium, entries (0,0) and (1,0) are 1 - K g and -K h. (Paper eq. 9; van Loan 1978 for the augmented
exponential.)

The exponential is made of p and G, the integral of p from 0 to T, alone: with k = K/m and c = b/m

    p'' = -k p - c p', p(0) = 0, p'(0) = 1;   g = G / m, h = p / m, q = p' = 1 - k G - c p,

by their Taylor series over a short T, which is then doubled: p(2T) = p (1 - k G + q), G(2T) = G (2 - k G) + p^2,
q(2T) = q^2 - k p^2.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, log2, sqrt

_TERMS = 18
"""Terms of the series, where k T^2 and c T are at most 1/4 and 1/2: what is left out is below 1e-17 of the sum."""


@dataclass(frozen=True, slots=True)
class TickStep:
    """Coefficients of one tick: p [s], q [1], g [m/N], h [m/(s N)] as above; K [N/m] of the rest force."""

    p: float
    q: float
    g: float
    h: float
    stiffness_npm: float


@lru_cache(maxsize=1024)
def discretise(mass_kg: float, damping_nspm: float, stiffness_npm: float, rate_hz: int) -> TickStep:
    """The exact step of one tick of 1/rate_hz seconds."""
    k, c = stiffness_npm / mass_kg, damping_nspm / mass_kg
    doublings = max(0, ceil(log2(max(sqrt(k), c, 0.5 * rate_hz) / (0.5 * rate_hz))))
    T = 1.0 / (rate_hz * 2**doublings)
    p, G = _series(k * T * T, c * T, T)
    q = 1.0 - k * G - c * p
    for _ in range(doublings):
        p, G, q = p * (1.0 - k * G + q), G * (2.0 - k * G) + p * p, q * q - k * p * p
    return TickStep(p=p, q=q, g=G / mass_kg, h=p / mass_kg, stiffness_npm=stiffness_npm)


def _series(swing: float, decay: float, T: float) -> tuple[float, float]:
    """p [s] and G [s^2] at T, for `swing` = k T^2 and `decay` = c T."""
    before, term = 0.0, T  # the terms of T^n-1 and T^n in p
    p = G = 0.0
    for n in range(1, _TERMS + 1):
        p += term
        G += term * T / (n + 1)
        before, term = term, -(swing * before / n + decay * term) / (n + 1)
    return p, G
