"""A device with a wrong sign, swapped axes, another gain or late samples, that says nothing of it."""

from collections.abc import Sequence
from typing import Any

from cogrip.devices.device import Device, Sample

SIGN, POSITION_SIGN, SWAP, MOTOR_GAIN, POSITION_GAIN = "sign", "position sign", "swap", "motor gain", "position gain"
FAULTS = (SIGN, POSITION_SIGN, SWAP, MOTOR_GAIN, POSITION_GAIN)


class FaultyDevice:
    """See `Device`. fault: one of FAULTS, "" for none; late_ticks: by which its samples are older than it says.

    A wrong sign is that of x; swapped are x and y, of the motors; gains are 2.
    """

    def __init__(self, inner: Device, fault: str = "", late_ticks: int = 0) -> None:
        self._inner, self._fault, self._late_ticks = inner, fault, late_ticks
        self._read: list[tuple[float, ...]] = []
        self.counts: dict[str, int] = {}
        self.open, self.close = inner.open, inner.close

    @property
    def capability(self) -> Any:
        return self._inner.capability

    def read(self, tick: int) -> Sample | None:
        sample = self._inner.read(tick)
        if sample is None:
            return None
        x, *rest = sample.position_m
        if self._fault == POSITION_SIGN:
            x = -x
        gain = 2.0 if self._fault == POSITION_GAIN else 1.0
        self._read.append(tuple(gain * part for part in (x, *rest)))
        return sample.replaced(position_m=self._read[max(0, len(self._read) - 1 - self._late_ticks)])

    def _altered(self, force_n: Sequence[float]) -> tuple[float, ...]:
        x, *rest = force_n
        if self._fault == SIGN:
            x = -x
        elif self._fault == SWAP:
            x, rest[0] = rest[0], x
        gain = 2.0 if self._fault == MOTOR_GAIN else 1.0
        return tuple(gain * part for part in (x, *rest))

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        acting = self._inner.write(self._altered(force_n))
        if acting is None:
            return None
        gain = 0.25 if self._fault == MOTOR_GAIN else 1.0
        return tuple(gain * part for part in self._altered(acting))
