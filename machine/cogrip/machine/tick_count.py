"""Ticks of a loop, and percentiles of how late they began and how long they worked."""

import math

import msgspec

from cogrip.machine.histogram import DurationHistogram


class Percentiles(msgspec.Struct, frozen=True, array_like=True):
    """Percentiles of durations, in the unit of the field that holds them; None where there were none."""

    p50: float | None = None
    p99: float | None = None
    p999: float | None = None
    max: float | None = None

    @classmethod
    def of(cls, histogram: DurationHistogram, unit_ns: float) -> "Percentiles":
        """Percentiles of a histogram in units of `unit_ns` nanoseconds."""
        summary = histogram.summary_us()
        scale = 1e3 / unit_ns
        return cls(**{name: None if math.isnan(value) else value * scale for name, value in summary.items()})


class TickCount(msgspec.Struct, frozen=True, array_like=True):
    """Ticks of a loop: due = run + skipped."""

    due: int = 0
    run: int = 0
    late_us: Percentiles = Percentiles()
    work_us: Percentiles = Percentiles()
