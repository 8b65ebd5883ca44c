"""Exact discretisation of one axis with its input held over a tick.

    m x'' + b x' + K x = f          f constant over T

symbols: m mass [kg], b damping [N s/m], K stiffness [N/m], T tick [s], f input force [N], x position [m], v = x' [m/s].
With the rest force r = f - K x at the start of the tick the exact step is, in increments (so that rest stays rest to
the bit),

    x+ = x + p v + g r              v+ = q v + h r

p, q are entries (0,1), (1,1) and g, h the input column of expm([[0, 1, 0], [-K/m, -b/m, 1/m], [0, 0, 0]] T): since f =
K x is an equilibrium, entries (0,0) and (1,0) are 1 - K g and -K h. (Paper eq. 9; van Loan 1978 for the augmented
exponential.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import expm  # type: ignore[import-untyped]


@dataclass(frozen=True, slots=True)
class Step:
    """Coefficients of one tick: p [s], q [1], g [m/N], h [m/(s N)] as above; K [N/m] of the rest force."""

    p: float
    q: float
    g: float
    h: float
    stiffness_npm: float


@lru_cache(maxsize=1024)
def discretise(mass_kg: float, damping_nspm: float, stiffness_npm: float, rate_hz: int) -> Step:
    """The exact step of one tick of 1/rate_hz seconds."""
    a = np.zeros((3, 3))
    a[0, 1] = 1.0
    a[1] = (-stiffness_npm / mass_kg, -damping_nspm / mass_kg, 1.0 / mass_kg)
    e = expm(a / rate_hz)
    return Step(p=float(e[0, 1]), q=float(e[1, 1]), g=float(e[0, 2]), h=float(e[1, 2]), stiffness_npm=stiffness_npm)
