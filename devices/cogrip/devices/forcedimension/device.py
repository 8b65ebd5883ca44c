"""A device of the Force Dimension SDK: every call is an exchange with it, so nothing runs besides the loop.

A force is held by the controller. What keeps one from being held for ever, should the loop hang or the process die, is the
controller's own watchdog, set here to the longest it has.
"""

import atexit
from collections.abc import Callable, Mapping, Sequence
from math import hypot, isfinite

from cogrip.devices.arm.kinematics import Vector
from cogrip.devices.device import Capability, DeviceError, Sample, check_rate
from cogrip.devices.forcedimension.models import confirm
from cogrip.devices.forcedimension.sdk import SATURATED, SUCCESS, TIME_GUARD, Dhd, Sdk, Status

WATCHDOG = 255  # x 125 us = 32 ms without a force, and the controller turns forces off
STATUS_TICKS = 128  # how often it is asked whether its forces are still on
ZERO: Vector = (0.0, 0.0, 0.0)
CURE = "check its cable and power, then open it again"

_opened: set[int] = set()  # the SDK gives a device that is open to whoever asks for it again


class ForceDimensionDevice:
    """See `Device`. `index` is the SDK's number of the device; `load` gives the SDK, when it is opened."""

    def __init__(self, where: str, index: int, record: Capability, stated: str, load: Callable[[], Sdk]) -> None:
        self.capability = record
        self._where = where
        self._index = index
        self._stated = stated
        self._load = load
        self._zero = (0.0,) * record.axes
        self._rest = (0.0,) * (3 - record.axes)
        self._counts: dict[str, int] = {}
        self._dhd: Dhd | None = None
        self._id = -1

    @property
    def counts(self) -> Mapping[str, int]:
        """Forces limited, motors saturated, forces that the controller turned off."""
        return dict(self._counts)

    def open(self, rate_hz: int) -> None:
        """See `Device.open`. Raises DeviceError also for a device of another model, or one that is not calibrated."""
        if self._dhd is not None:
            raise DeviceError(f"{self._where}: is open already; close it first")
        check_rate(rate_hz, self.capability, self._where)
        if self._index in _opened:
            raise DeviceError(f"{self._where}: is open already in this process; close that one first")
        sdk = self._load()
        number = sdk.dhd.openID(self._index)
        if number < 0:
            raise DeviceError(f"{self._where}: is not to be had: {sdk.dhd.errorGetLastStr()}; {CURE}")
        self._dhd, self._id, self._status = sdk.dhd, number, sdk.status()
        self._position, self._tick, self._asked = [0.0, 0.0, 0.0], 0, 0
        self._lost, self._blind = "", False
        _opened.add(self._index)
        atexit.register(self.close)
        try:
            self._prepare(sdk.dhd, number, self._status)
        except BaseException:
            self.close()
            raise

    def _prepare(self, dhd: Dhd, number: int, status: Status) -> None:
        try:
            kind = int(dhd.getSystemType(number))
        except ValueError as error:
            raise DeviceError(f"{self._where}: it does not say what it is ({error}); {CURE}") from None
        confirm(kind, self._stated, self._where)
        self._check(dhd, dhd.getStatus(status, number), "its state cannot be read")
        if status.reset or not status.power:
            what = "is not calibrated" if status.power else "is switched off: switch it on"
            raise DeviceError(f"{self._where}: {what}; calibrate it with the vendor's program, then open it again")
        self._check(dhd, dhd.setMaxForce(self.capability.peak_force_n, number), "its force cannot be limited")
        if dhd.expert.enableExpertMode() < 0 or dhd.expert.setWatchdog(WATCHDOG, number) < 0:
            self._count("watchdog not available")
        dhd.expert.disableExpertMode()
        self._check(dhd, dhd.setForce(ZERO, number), "its force cannot be set")
        self._check(dhd, dhd.enableForce(True, number), "its forces cannot be enabled")

    def read(self, tick: int) -> Sample | None:
        """See `Device.read`."""
        dhd = self._dhd
        if dhd is None:
            raise self._closed("read")
        if tick < self._tick:
            raise DeviceError(f"{self._where}: read(tick={tick}) after tick {self._tick}; ticks must not fall")
        self._tick = tick
        position = self._position
        answer = dhd.getPosition(position, self._id)
        if answer == TIME_GUARD:
            self._count("position read again too soon")
        if answer in SUCCESS and tick - self._asked >= STATUS_TICKS:
            self._asked = tick
            answer = dhd.getStatus(self._status, self._id)
            if not self._status.force:
                self._count("forces off")
        if answer not in SUCCESS:
            self._lose(dhd)
        if self._lost:
            raise DeviceError(self._lost)
        self._blind = not isfinite(position[0] + position[1] + position[2])
        if self._blind:
            self._count("position not finite")
            self._send(dhd, ZERO)
            return None
        return Sample(tuple(position[: len(self._zero)]), None)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """See `Device.write`. A force above the limit keeps its direction; one that is none at all becomes zero."""
        dhd = self._dhd
        if dhd is None:
            raise self._closed("write")
        size = hypot(*force_n)
        if len(force_n) != len(self._zero) or not isfinite(size):
            self._send(dhd, ZERO)
            what = f"{tuple(force_n)} N: not finite"
            if len(force_n) != len(self._zero):
                what = f"{len(force_n)} forces to {len(self._zero)} axes"
            raise DeviceError(f"{self._where}: write of {what}; the force is zero now")
        acting: Sequence[float] | None = None
        if size > self.capability.peak_force_n:
            fraction = self.capability.peak_force_n / size
            acting = tuple([fraction * f for f in force_n])
            self._count("force limited")
        x, y, z = (*(acting or force_n), *self._rest)
        self._send(dhd, (-x, -y, -z))  # the hand gets -F
        return self._zero if self._lost or self._blind else acting

    def close(self) -> None:
        """See `Device.close`. What the SDK refuses on the way is counted: nothing more can be done about it."""
        dhd, self._dhd = self._dhd, None
        if dhd is None:
            return
        answers = dhd.setForce(ZERO, self._id), dhd.stop(self._id), dhd.close(self._id)
        if not all(answer in SUCCESS for answer in answers):
            self._count("error at close")
        atexit.unregister(self.close)
        _opened.discard(self._index)

    def _send(self, dhd: Dhd, force: Vector) -> None:
        """A device that is lost gets zero until it is closed, one whose position is no number until it is one again."""
        answer = dhd.setForce(ZERO if self._lost or self._blind else force, self._id)
        if answer == SATURATED:
            self._count("motor saturated")
        elif answer not in SUCCESS:
            self._lose(dhd)

    def _lose(self, dhd: Dhd) -> None:
        """Said by the next read()."""
        if not self._lost:
            self._lost = f"{self._where}: lost: {dhd.errorGetLastStr()}; {CURE}"
            dhd.setForce(ZERO, self._id)

    def _check(self, dhd: Dhd, answer: int, what: str) -> None:
        if answer not in SUCCESS:
            raise DeviceError(f"{self._where}: {what}: {dhd.errorGetLastStr()}; {CURE}")

    def _count(self, name: str) -> None:
        self._counts[name] = self._counts.get(name, 0) + 1

    def _closed(self, verb: str) -> DeviceError:
        return DeviceError(f"{self._where}: {verb} while it is closed; call open(rate_hz) first")
