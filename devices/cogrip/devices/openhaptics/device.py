"""The loop's side of a device that the HD library's servo thread drives."""

from collections.abc import Callable, Mapping, Sequence
from math import hypot, isfinite
from typing import Protocol

from cogrip.devices.device import Capability, DeviceError, Sample, check_rate
from cogrip.devices.openhaptics.calibration import Calibrated, calibrate
from cogrip.devices.openhaptics.mailbox import ZERO, Mailbox
from cogrip.devices.openhaptics.models import Facts, lowered


class Link(Calibrated, Protocol):
    """A device that the library has given us. Verbs raise DeviceError."""

    def facts(self) -> Facts: ...
    def start(self) -> None:
        """Frames with forces from now on."""
        ...

    def close(self) -> None:
        """Zero force, then let go. Twice does nothing."""
        ...


class OpenHapticsDevice:
    """See `Device`. `connect` gives the link of a mailbox; `record` holds until the device is open and may lower it."""

    def __init__(self, where: str, record: Capability, stated: str, connect: Callable[[Mailbox], Link]) -> None:
        self.capability = record
        self._where = where
        self._record = record
        self._stated = stated
        self._connect = connect
        self._zero = (0.0,) * record.axes
        self._rest = ZERO[record.axes :]
        self._counts: dict[str, int] = {}
        self._servo_counts: dict[str, int] = {}
        self._mailbox = Mailbox(self._servo_counts)
        self._link: Link | None = None
        self._tick = self._seen = 0

    @property
    def counts(self) -> Mapping[str, int]:
        """Force errors by name, stale forces, forces limited."""
        return {**self._servo_counts, **self._counts}

    @property
    def buttons(self) -> int:
        """Those of the stylus that are pressed, one bit each."""
        news = self._mailbox.news
        return news.buttons if news else 0

    def open(self, rate_hz: int) -> None:
        """See `Device.open`. Raises DeviceError also for a device of another model, and before it is calibrated."""
        if self._link is not None:
            raise DeviceError(f"{self._where}: is open already; close it first")
        check_rate(rate_hz, self._record, self._where)
        self._mailbox = Mailbox(self._servo_counts)
        link = self._connect(self._mailbox)
        try:
            self.capability = lowered(self._record, link.facts(), self._stated, self._where)
            calibrate(link)
            link.start()
        except BaseException:
            link.close()
            raise
        self._link, self._tick, self._seen = link, 0, 0

    def read(self, tick: int) -> Sample | None:
        """See `Device.read`. None until the servo has had another frame."""
        if self._link is None:
            raise self._closed("read")
        if tick < self._tick:
            raise DeviceError(f"{self._where}: read(tick={tick}) after tick {self._tick}; ticks must not fall")
        self._tick = tick
        if self._mailbox.lost:
            raise DeviceError(self._mailbox.lost)
        news = self._mailbox.news
        if news is None or news.frame == self._seen:
            return None
        self._seen = news.frame
        return Sample(news.position_m[: len(self._zero)], None, 1)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """See `Device.write`. A force above the limit keeps its direction; one that is none at all becomes zero."""
        if self._link is None:
            raise self._closed("write")
        if len(force_n) != len(self._zero):
            self._mailbox.say(ZERO)
            raise DeviceError(
                f"{self._where}: write of {len(force_n)} forces to {len(self._zero)} axes; the force is zero now"
            )
        size = hypot(*force_n)
        if not isfinite(size):
            self._mailbox.say(ZERO)
            raise DeviceError(f"{self._where}: write of {tuple(force_n)} N: not finite; the force is zero now")
        acting: Sequence[float] | None = None
        if self._mailbox.lost:
            acting = self._zero
        elif size > self.capability.peak_force_n:
            fraction = self.capability.peak_force_n / size
            acting = tuple([fraction * f for f in force_n])
            self._counts["force limited"] = self._counts.get("force limited", 0) + 1
        x, y, z = (*(acting or force_n), *self._rest)
        self._mailbox.say((-x, -y, -z))  # the hand gets -F
        return acting

    def close(self) -> None:
        """See `Device.close`."""
        link, self._link = self._link, None
        if link is not None:
            self._mailbox.say(ZERO)
            link.close()

    def _closed(self, verb: str) -> DeviceError:
        return DeviceError(f"{self._where}: {verb} while it is closed; call open(rate_hz) first")
