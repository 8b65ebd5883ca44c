"""Safety of a hand that holds on, and forces that a law wishes for tick by tick."""

from collections.abc import Sequence
from dataclasses import replace

from cogrip.client.safety.limiter import RAMP_IN_S, Safety
from cogrip.devices.device import Capability

from tests.client.seated_client import capability

TICK_S = 1 / 1000
PEAK_N = 8.0
RECORD = replace(capability(3), peak_force_n=PEAK_N, workspace_m=((-0.1, 0.1),) * 3)
Force = tuple[float, ...]


def live(record: Capability = RECORD, tick_s: float = TICK_S, length_scale: float = 1.0, **changed: object) -> Safety:
    """Return the safety of such a device, with these changes of its record, as the ramp begins."""
    safety = Safety(replace(record, **changed), tick_s, length_scale)  # type: ignore[arg-type]
    for event in ("open", "calibrated", "go"):
        assert safety.event(event)  # type: ignore[arg-type]
    return safety


def full(record: Capability = RECORD, tick_s: float = TICK_S, length_scale: float = 1.0, **changed: object) -> Safety:
    """Live, the ramp behind it."""
    safety = live(record, tick_s, length_scale, **changed)
    give(safety, (0.0,) * record.axes, round(RAMP_IN_S / tick_s) + 1)
    return safety


def give(safety: Safety, wish: Sequence[float] | None, ticks: int, gap: bool = False) -> list[Force]:
    """Return the forces of so many ticks of one wish."""
    return [safety.limit(wish, gap) for _ in range(ticks)]
