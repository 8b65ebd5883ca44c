"""Base of the drivers: the calls that each of them refuses, with the same words, and its counts."""

from collections import Counter
from collections.abc import Mapping, Sequence

from cogrip.devices.device import Capability, DeviceError, check_rate


class Driver:
    """State that every driver has. where: its name in errors; axes: of a sample and of a force."""

    def __init__(self, where: str, axes: int) -> None:
        self._where = where
        self._axes = axes
        self._zero = (0.0,) * axes
        self._counts: Counter[str] = Counter()
        self._open = False
        self._tick = 0  # of the newest read

    @property
    def counts(self) -> Mapping[str, int]:
        return self._counts

    def _check_open(self, rate_hz: int, record: Capability) -> None:
        """Raises DeviceError where it is open already, or where `check_rate` refuses the rate."""
        if self._open:
            raise self._error("is open already; close it first")
        check_rate(rate_hz, record, self._where)

    def _check_read(self, tick: int) -> None:
        """Enter the tick of a read. Raises DeviceError where it is closed, or where ticks fall."""
        if not self._open:
            self._need_open("read")
        if tick < self._tick:
            raise self._fallen(tick)
        self._tick = tick

    def _need_open(self, verb: str) -> None:
        if not self._open:
            raise self._error(f"{verb} while it is closed; call open(rate_hz) first")

    def _fallen(self, tick: int) -> DeviceError:
        return self._error(f"read(tick={tick}) after tick {self._tick}; ticks must not fall")

    def _wrong_force(self, force_n: Sequence[float], then: str = "") -> DeviceError:
        """Return the error for a force of another number of axes, or one that is not finite. then: where that leads."""
        if len(force_n) != self._axes:
            return self._error(f"write of {len(force_n)} forces to {self._axes} axes{then}")
        return self._error(f"write of {tuple(force_n)} N: not finite{then}")

    def _error(self, text: str) -> DeviceError:
        return DeviceError(f"{self._where}: {text}")
