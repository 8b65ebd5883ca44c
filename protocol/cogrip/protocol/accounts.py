"""What each end knows of a session when it ends; exchanged in the last two messages, joined in `summary.json`."""

import math
from typing import Annotated

import msgspec

from cogrip.protocol.histogram import DurationHistogram

Row = Annotated[tuple[float, ...], msgspec.Meta(max_length=3)]  # one number an axis


class LinkCount(msgspec.Struct, frozen=True, array_like=True):
    """Frames of one direction by fate: sent = applied + late + lost (`SPEC.md` section 6)."""

    sent: int = 0
    received: int = 0
    applied: int = 0
    lost: int = 0
    late: int = 0
    duplicate: int = 0
    pending: int = 0


class Percentiles(msgspec.Struct, frozen=True, array_like=True):
    """Of durations, in the unit of the field that holds them; None where there were none."""

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


class ClientAccount(msgspec.Struct, frozen=True, array_like=True):
    """What one person's client knows at the end of a session."""

    position_m: Row
    force_n: Row
    peak_force_n: float
    travel_m: float
    felt_stiffness_npm: float | None
    predicted_stiffness_npm: float | None
    down_margin_j: float | None
    device_leak_j: float
    down: LinkCount
    rtt_ms: Percentiles
    ticks: TickCount
    diverged: bool
    state: Annotated[str, msgspec.Meta(max_length=40)]
    reason: Annotated[str, msgspec.Meta(max_length=300)]


class SeatAccount(msgspec.Struct, frozen=True, array_like=True):
    """What the server knows of one person at the end of a session."""

    proxy_m: Row
    up_margin_j: float | None
    line_margin_j: float | None
    up: LinkCount


class RoomAccount(msgspec.Struct, frozen=True, array_like=True):
    """What the server knows of the object."""

    position_m: Row
    velocity_mps: Row
    travel_m: float
    diverged: bool
    energy_balance_error_j: float
    ticks: TickCount
