"""Impedance and wave filter of a line by its loop time, for settings that say "auto" (theory 7.1 to 7.3, decision 15).

A line of impedance b and loop time T is a spring 2b/T and a mass bT/2: K m = b^2, so b follows T and what people prefer. Two
hands at the ends of long lines ring as masses on a spring do: from LONG_S on a filter of lag S in each direction damps that.

    b = least of 2 m / T, `USUAL_NSPM`, and what the device carries; "stiff": what the device carries
    S = LAG_S, or SHARE T where that is more; SLOPE (T - LONG_S) where that is less
"""

from math import inf, pi
from typing import NamedTuple

from cogrip.protocol.settings.types import Prefer

USUAL_NSPM = 20.0
LEAST_NSPM, MOST_NSPM = 1.0, 60.0
"""Range of b that a seat may choose from: scenes are tested from there to there (theory 8.2)."""
MASS_KG = {"light": 0.5, "balanced": 1.8, "stiff": inf}  # largest apparent mass of a line, by what its seat prefers
LONG_S, SLOPE, LAG_S, SHARE = 0.28, 10.0, 0.41, 0.65


class Tuning(NamedTuple):
    """Impedance b [N s/m], and lag S of the filter in each direction [s]."""

    impedance_nspm: float
    filter_lag_s: float


def tuning(loop_s: float, prefer: Prefer, carried_nspm: float = USUAL_NSPM) -> Tuning:
    """Return what suits a line of this loop time and a device that carries so much."""
    usual = inf if prefer == "stiff" else USUAL_NSPM
    b = min(2.0 * MASS_KG[prefer] / loop_s, usual, carried_nspm)
    return Tuning(bounded(b), max(0.0, min(max(LAG_S, SHARE * loop_s), SLOPE * (loop_s - LONG_S))))


def flat_s(prefer: Prefer) -> float:
    """Return up to which loop time a device that carries enough has the same tuning."""
    return min(2.0 * MASS_KG[prefer] / USUAL_NSPM, LONG_S)


def kept_tuning(prefer: Prefer, carried_nspm: float = USUAL_NSPM) -> Tuning:
    """Return that of a line that keeps it, whatever its loop time is: the spring makes up for the line, or no wave follows."""
    return tuning(flat_s(prefer), prefer, carried_nspm)


def bounded(impedance_nspm: float) -> float:
    """Return the impedance that a seat which may choose has, of the one that it asks for."""
    return min(max(impedance_nspm, LEAST_NSPM), MOST_NSPM)


def corner_hz(lag_s: float) -> float:
    """Return the corner of a filter of lag S; 0 for none."""
    return 1.0 / (2.0 * pi * lag_s) if lag_s else 0.0


def filter_lag_s(corner: float) -> float:
    """Return S of a filter with this corner [Hz]; 0 for none."""
    return 1.0 / (2.0 * pi * corner) if corner else 0.0
