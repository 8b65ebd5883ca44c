"""Sizes of rows against a bound, without a root: `hypot` and `dist` are asked only where it is close, or above."""

from collections.abc import Sequence

NEARLY = 1.0 - 1e-12  # fraction of a bound's square: what is below it is below the bound by more than rounding


def surely_below(row: Sequence[float], most: float) -> bool:
    """Return whether hypot(*row) is below `most` by more than rounding. False for numbers that are not finite."""
    square = 0.0
    for value in row:
        square += value * value
    return square < NEARLY * most * most


def change_surely_below(row: Sequence[float], before: Sequence[float], most: float) -> bool:
    """Return whether dist(row, before) is below `most` by more than rounding. False for numbers that are not finite."""
    square = 0.0
    for axis, value in enumerate(row):
        was = before[axis]
        square += (value - was) * (value - was)
    return square < NEARLY * most * most
