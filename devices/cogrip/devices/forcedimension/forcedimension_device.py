"""A device of the Force Dimension SDK: every call is an exchange with it, so nothing runs besides the loop.

A force is held by the controller. What keeps one from being held for ever, should the loop hang or the process die, is the
controller's own watchdog, set here to the longest it has. It switches the forces off, and they stay off until they are enabled
again; so does the controller above a speed, and by the button on its base. So forces are enabled with the first force and not
by `open`, after which a client takes its time, and the status is believed over what was sent:

    off --a force is due--> settling --status: on--> on        on --status: off, by the watchdog--> off, for RESTS_S at least
    settling, on --status: off, by anything else; no power; an error--> lost, until it is closed and opened again
"""

import atexit
from collections.abc import Callable, Sequence
from ctypes import c_double
from math import hypot, isfinite

from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.forcedimension.models import confirm, with_handle
from cogrip.devices.forcedimension.sdk import BY_WATCHDOG, OFF_CAUSES, SATURATED, SUCCESS, TIME_GUARD, Sdk
from cogrip.devices.frozen_position import FrozenPosition
from cogrip.machine.rows import Vector
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.laws.rotations import Quaternion, log, of_matrix

WATCHDOG = 255  # units of 125 us: after 32 ms without a force the controller turns forces off
FED_S = 0.025  # pause between two forces from which on the watchdog may have turned forces off
RESTS_S = 0.02  # time without force before forces are enabled again: the client takes the device for let go, and ramps
SETTLES_TICKS = 2  # Forces are asked for so many ticks after they were enabled.
STATUS_TICKS = 16  # ticks from one question whether its forces are still on to the next
ZERO: Vector = (0.0, 0.0, 0.0)
CURE = "check its cable and power, then open it again"

_opened: set[int] = set()  # numbers of open devices: the SDK gives an open one to whoever asks for it again


class ForceDimensionDevice(Driver):
    """See `Device`. `index` is the SDK's number of the device; `load` gives the SDK, when it is opened."""

    def __init__(self, where: str, index: int, record: Capability, stated: str, load: Callable[[], Sdk]) -> None:
        super().__init__(where, record.axes)
        self.capability = record
        self._index = index
        self._stated = stated
        self._load = load
        self._places = min(record.axes, PLACES)
        self._rest = (0.0,) * (PLACES - self._places)
        self._turns, self._grips = record.axes == POSE_AXES, record.axes == GRIP_AXES

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
        self._system_type = sdk.system_type
        self._position, self._tick, self._asked = [0.0, 0.0, 0.0], 0, 0
        self._on = False
        self._fed_ticks, self._rest_ticks = max(1, int(FED_S * rate_hz)), round(RESTS_S * rate_hz)
        self._written = self._enables_at = self._flows_at = 0  # ticks: newest force; forces are enabled from, flow from
        self._lost, self._blind, self._opens = "", False, 1.0
        self._velocity, self._frozen = [0.0, 0.0, 0.0], FrozenPosition(self.capability.resolution_m, rate_hz)
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
        kind = self._system_type(number)
        if kind < 0:
            raise self._error(f"it does not say what it is ({dhd.errorGetLastStr()}); {CURE}")
        self.capability = with_handle(self.capability, confirm(kind, self._stated, self._where))
        self._check(dhd.getStatus(status, number), "its state cannot be read")
        if status.reset or not status.power:
            what = "is not calibrated" if status.power else "is switched off: switch it on"
            raise self._error(f"{what}; calibrate it with the vendor's program, then open it again")
        self._check(dhd.setMaxForce(self.capability.peak_force_n, number), "its force cannot be limited")
        self._prepare_own()
        if dhd.expert.enableExpertMode() < 0 or dhd.expert.setWatchdog(WATCHDOG, number) < 0:
            self._counts["watchdog not available"] += 1
        dhd.expert.disableExpertMode()
        self._check(self._apply(ZERO, ZERO), "its force cannot be set")

    def _prepare_own(self) -> None:
        """Limit what a wrist or a gripper gives; raise DeviceError for one without motors."""
        dhd, number, record = self._dhd, self._id, self.capability
        if record.rotation is not None:
            if not dhd.hasActiveWrist(number):
                raise self._error("its wrist has no motors, by its own word; take it with 3 axes")
            self._check(dhd.setMaxTorque(record.rotation.peak_torque_nm, number), "its torque cannot be limited")
        if record.gripper is not None:
            if not dhd.hasActiveGripper(number):
                raise self._error("its gripper has no motor, by its own word; take it with 3 axes")
            self._check(dhd.setMaxGripperForce(record.gripper.peak_force_n, number), "its gripper cannot be limited")
            self._opens = -1.0 if dhd.isLeftHanded(number) else 1.0

    def read(self, tick: int) -> Sample | None:
        self._check_read(tick)
        dhd, position = self._dhd, self._position
        answer = dhd.getPosition(position, self._id)
        if answer == TIME_GUARD:
            self._counts["position read again too soon"] += 1
        if answer in SUCCESS and (tick - self._asked >= STATUS_TICKS or tick - self._written >= self._fed_ticks):
            answer = self._ask(tick)
        if answer not in SUCCESS:
            self._lose(dhd.errorGetLastStr())
        if self._lost:
            raise DeviceError(self._lost)
        self._blind = not isfinite(position[0] + position[1] + position[2])
        if self._blind:
            self._counts["position not finite"] += 1
            self._send(ZERO)
            return None
        place: tuple[float, ...] = tuple(position)
        if self._frozen.still(place, tick) and dhd.getLinearVelocity(self._velocity, self._id) in SUCCESS:
            self._lose(self._frozen.judge(self._velocity))
            if self._lost:
                raise DeviceError(self._lost)
        buttons, turned, grip_m = self._handle()
        own = self._own(turned, grip_m)
        return None if own is None else Sample((*place[: self._places], *own), None, 0, buttons, turned, grip_m)

    def _own(self, turned: Quaternion | None, grip_m: float | None) -> Sequence[float] | None:
        """Return the axes behind the places, None where they could not be read: no sample is whole without."""
        if self._turns:
            return None if turned is None else log(turned)
        if self._grips:
            return None if grip_m is None else (self._gap.value,)
        return ()

    def _ask(self, tick: int) -> int:
        """Ask for the status, and believe it. Return the SDK's answer."""
        self._asked = tick
        status = self._status
        answer = self._dhd.getStatus(status, self._id)
        if answer not in SUCCESS:
            return answer
        if not status.power:
            self._lose("its power is gone")
        elif status.reset:
            self._lose("it is not calibrated any more: calibrate it with the vendor's program")
        elif status.error:
            self._lose("its controller reports an error")
        elif self._on and not (status.force and (status.torque or not self._turns)):
            self._counts["forces off"] += 1
            paused = tick - self._written >= self._fed_ticks
            if status.forceoffcause == BY_WATCHDOG or paused:
                self._on, self._enables_at = False, tick + self._rest_ticks
            else:
                cause, what = (
                    OFF_CAUSES.get(status.forceoffcause, "it does not say why"),
                    "torques" if status.force else "forces",
                )
                self._lose(f"its controller has switched the {what} off ({cause})")
        return answer

    def _flows(self) -> bool:
        """Return whether force may flow at this tick; enable forces where they are due."""
        tick = self._tick
        if not self._on and tick >= self._enables_at:
            self._send(ZERO)  # the watchdog begins with a force
            answers = [self._dhd.enableForce(True, self._id)]
            if self._grips:
                answers.append(self._dhd.enableGripperForce(True, self._id))
            if not all(answer in SUCCESS for answer in answers):
                self._lose(f"its forces cannot be enabled: {self._dhd.errorGetLastStr()}")
            self._on, self._flows_at = True, tick + SETTLES_TICKS
            self._asked = self._flows_at - STATUS_TICKS
        return self._on and tick >= self._flows_at

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
        """A force above the limit keeps its direction; one that is none becomes zero, and so does any while none flows."""
        self._need_open("write")
        if len(force_n) != self._axes or not isfinite(hypot(*force_n)):
            self._send(ZERO)
            raise self._wrong_force(force_n, "; the force is zero now")
        record, places = self.capability, self._places
        arm = _limited(force_n[:places], record.peak_force_n)
        own: Sequence[float] = force_n[places:]
        if own:
            most = (
                record.rotation.peak_torque_nm
                if record.rotation
                else record.gripper.peak_force_n
                if record.gripper
                else 0.0
            )
            own = _limited(own, most)
        acting: Sequence[float] | None = None
        if (whole := (*arm, *own)) != tuple(force_n):
            acting = whole
            self._counts["force limited"] += 1
        flows = self._lost or self._flows()
        if flows:  # the hand gets -F
            x, y, z = (*arm, *self._rest)
            a, b, c = (*own, *ZERO)[:PLACES]
            self._send((-x, -y, -z), (-a, -b, -c))
        else:
            self._send(ZERO)
        self._written = self._tick
        return self._zero if self._lost or self._blind or not flows else acting

    def close(self) -> None:
        """Errors on the way are counted: nothing more can be done about it."""
        if not self._open:
            return
        self._open = False
        answers = self._apply(ZERO, ZERO), self._dhd.stop(self._id), self._dhd.close(self._id)
        if not all(answer in SUCCESS for answer in answers):
            self._counts["error at close"] += 1
        atexit.unregister(self.close)
        _opened.discard(self._index)

    def _apply(self, force: Vector, own: Vector) -> int:
        """Hold this force on the hand, and this torque, or the force in the first number that opens a gripper."""
        if self._turns:
            return self._dhd.setForceAndTorque(force, own, self._id)
        if self._grips:
            return self._dhd.setForceAndGripperForce(force, self._opens * own[0], self._id)
        return self._dhd.setForce(force, self._id)

    def _send(self, force: Vector, own: Vector = ZERO) -> None:
        """A device that is lost gets zero until it is closed, one whose position is no number until it is one again."""
        dead = self._lost or self._blind
        answer = self._apply(ZERO, ZERO) if dead else self._apply(force, own)
        if answer == SATURATED:
            self._counts["motor saturated"] += 1
        elif answer not in SUCCESS:
            self._lose(self._dhd.errorGetLastStr())

    def _lose(self, why: str) -> None:
        """Said by the next read(); no reason is none."""
        if why and not self._lost:
            self._lost = f"{self._where}: lost: {why}; {CURE}"
            self._apply(ZERO, ZERO)

    def _check(self, answer: int, what: str) -> None:
        if answer not in SUCCESS:
            raise self._error(f"{what}: {self._dhd.errorGetLastStr()}; {CURE}")


def _limited(force: Sequence[float], most: float) -> Sequence[float]:
    """Return the force, or torque, with its direction and at most this size."""
    size = hypot(*force)
    return force if size <= most else tuple([most / size * part for part in force])
