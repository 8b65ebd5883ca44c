"""A device of the Force Dimension SDK: every call is an exchange with it, so nothing runs besides the loop.

A force is held by the controller. What keeps one from being held for ever, should the loop hang or the process die, is the
controller's own watchdog, set here to the longest it has.
"""

import atexit
from collections.abc import Callable, Sequence
from ctypes import c_double
from math import hypot, isfinite

from cogrip.devices.arm.kinematics import Vector
from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.forcedimension.models import confirm, with_handle
from cogrip.devices.forcedimension.sdk import SATURATED, SUCCESS, TIME_GUARD, Sdk
from cogrip.protocol.rotations import Quaternion, of_matrix

WATCHDOG = 255  # x 125 us = 32 ms without a force, and the controller turns forces off
STATUS_TICKS = 128  # how often it is asked whether its forces are still on
ZERO: Vector = (0.0, 0.0, 0.0)
CURE = "check its cable and power, then open it again"

_opened: set[int] = set()  # the SDK gives a device that is open to whoever asks for it again


class ForceDimensionDevice(Driver):
    """See `Device`. `index` is the SDK's number of the device; `load` gives the SDK, when it is opened."""

    def __init__(self, where: str, index: int, record: Capability, stated: str, load: Callable[[], Sdk]) -> None:
        super().__init__(where, record.axes)
        self.capability = record
        self._index = index
        self._stated = stated
        self._load = load
        self._rest = (0.0,) * (3 - record.axes)

    def open(self, rate_hz: int) -> None:
        """Raises DeviceError also for a device of another model, or one that is not calibrated."""
        self._check_open(rate_hz, self.capability)
        if self._index in _opened:
            raise self._error("is open already in this process; close that one first")
        sdk = self._load()
        number = sdk.dhd.openID(self._index)
        if number < 0:
            raise self._error(f"is not to be had: {sdk.dhd.errorGetLastStr()}; {CURE}")
        self._open, self._dhd, self._id, self._status = True, sdk.dhd, number, sdk.status()
        self._position, self._tick, self._asked = [0.0, 0.0, 0.0], 0, 0
        self._lost, self._blind = "", False
        self._rows, self._gap = [[0.0] * 3 for _ in range(3)], c_double()
        _opened.add(self._index)
        atexit.register(self.close)
        try:
            self._prepare()
        except BaseException:
            self.close()
            raise

    def _prepare(self) -> None:
        dhd, number, status = self._dhd, self._id, self._status
        try:
            kind = int(dhd.getSystemType(number))
        except ValueError as error:
            raise self._error(f"it does not say what it is ({error}); {CURE}") from None
        self.capability = with_handle(self.capability, confirm(kind, self._stated, self._where))
        self._check(dhd.getStatus(status, number), "its state cannot be read")
        if status.reset or not status.power:
            what = "is not calibrated" if status.power else "is switched off: switch it on"
            raise self._error(f"{what}; calibrate it with the vendor's program, then open it again")
        self._check(dhd.setMaxForce(self.capability.peak_force_n, number), "its force cannot be limited")
        if dhd.expert.enableExpertMode() < 0 or dhd.expert.setWatchdog(WATCHDOG, number) < 0:
            self._counts["watchdog not available"] += 1
        dhd.expert.disableExpertMode()
        self._check(dhd.setForce(ZERO, number), "its force cannot be set")
        self._check(dhd.enableForce(True, number), "its forces cannot be enabled")

    def read(self, tick: int) -> Sample | None:
        self._check_read(tick)
        dhd, position = self._dhd, self._position
        answer = dhd.getPosition(position, self._id)
        if answer == TIME_GUARD:
            self._counts["position read again too soon"] += 1
        if answer in SUCCESS and tick - self._asked >= STATUS_TICKS:
            self._asked = tick
            answer = dhd.getStatus(self._status, self._id)
            if not self._status.force:
                self._counts["forces off"] += 1
        if answer not in SUCCESS:
            self._lose()
        if self._lost:
            raise DeviceError(self._lost)
        self._blind = not isfinite(position[0] + position[1] + position[2])
        if self._blind:
            self._counts["position not finite"] += 1
            self._send(ZERO)
            return None
        return Sample(tuple(position[: self._axes]), None, 0, *self._handle())

    def _handle(self) -> tuple[int, Quaternion | None, float | None]:
        """Buttons, orientation and grip of the handle, as far as there are any and they can be read."""
        dhd, record, rows, gap = self._dhd, self.capability, self._rows, self._gap
        buttons = dhd.getButtonMask(self._id) & ((1 << record.buttons) - 1) if record.buttons else 0
        turned = grip_m = None
        if record.gives_orientation:
            turned = of_matrix(rows) if dhd.getOrientationFrame(rows, self._id) in SUCCESS else None
            if turned is None:
                self._counts["orientation not read"] += 1
        if record.grip_m is not None:
            closed, opened = record.grip_m
            if dhd.getGripperGap(gap, self._id) in SUCCESS and isfinite(gap.value):
                grip_m = min(opened, max(closed, gap.value))
            else:
                self._counts["gripper not read"] += 1
        return buttons, turned, grip_m

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """A force above the limit keeps its direction; one that is none at all becomes zero."""
        self._need_open("write")
        size = hypot(*force_n)
        if len(force_n) != self._axes or not isfinite(size):
            self._send(ZERO)
            raise self._wrong_force(force_n, "; the force is zero now")
        acting: Sequence[float] | None = None
        if size > self.capability.peak_force_n:
            fraction = self.capability.peak_force_n / size
            acting = tuple([fraction * f for f in force_n])
            self._counts["force limited"] += 1
        x, y, z = (*(acting or force_n), *self._rest)
        self._send((-x, -y, -z))  # the hand gets -F
        return self._zero if self._lost or self._blind else acting

    def close(self) -> None:
        """Errors on the way are counted: nothing more can be done about it."""
        if not self._open:
            return
        self._open = False
        answers = self._dhd.setForce(ZERO, self._id), self._dhd.stop(self._id), self._dhd.close(self._id)
        if not all(answer in SUCCESS for answer in answers):
            self._counts["error at close"] += 1
        atexit.unregister(self.close)
        _opened.discard(self._index)

    def _send(self, force: Vector) -> None:
        """A device that is lost gets zero until it is closed, one whose position is no number until it is one again."""
        answer = self._dhd.setForce(ZERO if self._lost or self._blind else force, self._id)
        if answer == SATURATED:
            self._counts["motor saturated"] += 1
        elif answer not in SUCCESS:
            self._lose()

    def _lose(self) -> None:
        """Said by the next read()."""
        if not self._lost:
            self._lost = f"{self._where}: lost: {self._dhd.errorGetLastStr()}; {CURE}"
            self._dhd.setForce(ZERO, self._id)

    def _check(self, answer: int, what: str) -> None:
        if answer not in SUCCESS:
            raise self._error(f"{what}: {self._dhd.errorGetLastStr()}; {CURE}")
