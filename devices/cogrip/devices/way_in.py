"""The way back into a workspace, in words for whoever holds the handle."""

from collections.abc import Sequence
from math import hypot

WAYS = (("toward you", "away from you"), ("to your right", "to your left"), ("up", "down"))
"""Words for each axis, as it grows and as it falls."""
WELL_IN = 0.8  # fraction of the reach, or of half the box, to which the way is told
LEAST_M = 0.005  # least part of a way that is told


def into_sphere(position_m: Sequence[float], reach_m: float) -> str:
    """Return the way from a tip outside of a sphere into it, "" where there is none."""
    away = hypot(*position_m)
    return _words([(WELL_IN * reach_m / away - 1.0) * part for part in position_m]) if away > reach_m else ""


def into_box(position_m: Sequence[float], box_m: Sequence[tuple[float, float]]) -> str:
    """Return the way from a tip outside of a box into it, "" where there is none."""
    way = []
    for part, (low, high) in zip(position_m, box_m, strict=False):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        to = min(middle + WELL_IN * half, max(middle - WELL_IN * half, part))
        way.append(0.0 if low <= part <= high else to - part)
    return _words(way)


def _words(way_m: Sequence[float]) -> str:
    return ", ".join(
        f"{1e3 * abs(part):.0f} mm {WAYS[axis][part < 0.0]}" for axis, part in enumerate(way_m) if abs(part) >= LEAST_M
    )
