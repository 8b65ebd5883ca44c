"""Durations in log-spaced bins: fixed memory, a fraction of a microsecond to add, percentiles within 3.2 %.

A value of b bits is filed under its b and its top five bits (one and four more): 16 equal bins an octave, each at most
1/16 of its lower edge wide, as in HdrHistogram. Below 32 ns every value has its own bin. Reported values are bin
middles, so they err by at most 1/32; the maximum is exact.
"""

import math
from bisect import bisect_left
from collections.abc import Iterable
from itertools import accumulate
from typing import NamedTuple

from cogrip.machine.addition import add_integers
from cogrip.machine.bit_length import bit_length

_SUB_BITS = 4
_SUB_BINS = 1 << _SUB_BITS  # number of bins an octave
_KEPT_BITS = _SUB_BITS + 1  # bits of a duration that choose its bin: the leading one and those below it
_LARGEST_NS = (1 << 62) - 1  # longest duration, 146 years: a longer one counts as this
_BINS = ((62 - _KEPT_BITS) << _SUB_BITS) + 2 * _SUB_BINS
_NOTHING = (0,) * _BINS

RELATIVE_ERROR = 1 / (2 * _SUB_BINS)


class Bin(NamedTuple):
    """Values low_ns <= v < high_ns, and how many there were."""

    low_ns: int
    high_ns: int
    counted: int


def _edges(index: int) -> tuple[int, int]:
    """Return the bin's half-open range [low, high) in ns."""
    if index < 2 * _SUB_BINS:
        return index, index + 1
    shift = (index >> _SUB_BITS) - 1
    top = index - (shift << _SUB_BITS)
    return top << shift, (top + 1) << shift


class DurationHistogram:
    """Counts of durations in ns: lateness of ticks, work of ticks, round trips."""

    __slots__ = ("_counts", "max_ns", "total_ns")

    def __init__(self) -> None:
        self._counts = list(_NOTHING)
        self.max_ns = self.total_ns = 0

    def add(self, value_ns: int) -> None:
        """Count one duration, below 2**63. Negative ones (a clock read a little early) count as 0."""
        if value_ns > self.max_ns:
            if value_ns > _LARGEST_NS:
                value_ns = _LARGEST_NS
            self.max_ns = value_ns
        elif value_ns < 0:
            value_ns = 0
        self.total_ns += value_ns
        shift = bit_length(value_ns) - 5  # _KEPT_BITS, written out: a global costs a tenth of the call
        if shift > 0:
            self._counts[(shift << 4) + (value_ns >> shift)] += 1
        else:
            self._counts[value_ns] += 1

    @property
    def count(self) -> int:
        """Number of durations added."""
        return add_integers(self._counts)

    def percentile(self, q: float) -> float:
        """Return the smallest recorded duration in ns that q percent (0 to 100) do not exceed, to 1/32; nan while empty.

        This is numpy's `method="inverted_cdf"`: an observed value, never an interpolation between two.
        """
        if not 0.0 <= q <= 100.0:
            raise ValueError(f"percentile {q} is outside 0 to 100: give percent, 99.9 and not 0.999")
        count = self.count
        if not count:
            return math.nan
        # The tiny step back keeps 99.9 % of 1000 at rank 999: the product may come out as 999.0000000001.
        rank = max(1, math.ceil(q * count / 100.0 - 1e-9))
        if rank >= count:
            return float(self.max_ns)
        low, high = _edges(bisect_left(list(accumulate(self._counts)), rank))
        return min((low + high - 1) / 2, float(self.max_ns))

    def merge(self, other: "DurationHistogram") -> None:
        """Add every duration of other."""
        self._counts = [mine + theirs for mine, theirs in zip(self._counts, other._counts, strict=True)]
        self.max_ns = max(self.max_ns, other.max_ns)
        self.total_ns += other.total_ns

    def clear(self) -> None:
        """Remove all durations, for the next window of a running display."""
        self._counts = list(_NOTHING)
        self.max_ns = self.total_ns = 0

    def bins(self) -> list[Bin]:
        """Return the non-empty bins in rising order."""
        return [Bin(*_edges(index), held) for index, held in enumerate(self._counts) if held]

    def summary_us(self, percentiles: Iterable[float] = (50, 99, 99.9)) -> dict[str, float]:
        """Return percentiles and the exact maximum in us: {"p50": .., "p99": .., "p999": .., "max": ..}; nan while empty."""
        summary = {f"p{q:g}".replace(".", ""): self.percentile(q) / 1e3 for q in percentiles}
        summary["max"] = self.max_ns / 1e3 if self.count else math.nan
        return summary
