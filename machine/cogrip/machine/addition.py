"""Sums of numbers, from the first to the last: the same bits on every Python.

The built-in `sum` of floats is compensated from Python 3.12 on, and plain before: `sum([0.1] * 10)` is 1.0 or
0.9999999999999999. A recording must play again bit for bit on either, so nothing in this project calls `sum` itself.
"""

from collections.abc import Iterable, Sequence


def add_floats(values: Iterable[float]) -> float:
    """Return the plain sum of floats, each addition rounded once; 0.0 of none."""
    total = 0.0
    for value in values:
        total += value
    return total


def add_products(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the plain sum of products of two rows of one length, each operation rounded once."""
    total = 0.0
    for place, value in enumerate(a):
        total += value * b[place]
    return total


def add_integers(values: Iterable[int]) -> int:
    """Return the sum of whole numbers, which is exact in any order. A flag counts as 0 or 1."""
    return sum(values)
