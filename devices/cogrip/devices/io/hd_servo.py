"""The one servo thread of the HD library, and the devices it drives.

Which thread may call what: the library has one "current device" and one stack of errors for everybody. So once the servo
runs, whatever concerns a device is called in the servo thread: in a frame of the device, or by `Servo.together` between
frames. Only hdInitDevice and hdDisableDevice, which can take long, are called outside of it; a frame checks that they did not
make another device current under it.
"""

from __future__ import annotations

import atexit
import ctypes
from collections.abc import Callable
from ctypes import c_double, c_int
from functools import partial
from typing import Any, TypeVar

from cogrip.devices.device import DeviceError
from cogrip.devices.io.hd_library import CALLBACK, ErrorReport, load, pop_errors
from cogrip.devices.openhaptics.errors import FORCE_ERRORS, cure_for
from cogrip.devices.openhaptics.mailbox import ZERO, Mailbox
from cogrip.devices.openhaptics.models import Facts
from cogrip.machine.rows import Vector

_Answer = TypeVar("_Answer")

INVALID_HANDLE = 0xFFFFFFFF
NO_REASON = 0x303  # code of an error without a reason: mostly a name that the vendor's settings do not have
MODEL_TYPE, CALIBRATION_STYLE = 0x2501, 0x2555
NOMINAL_MAX_STIFFNESS, NOMINAL_MAX_FORCE, NOMINAL_MAX_CONTINUOUS_FORCE = 0x2602, 0x2603, 0x2604
FORCE_OUTPUT = 0x4000
DONE, CONTINUE, CHECK_STATUS = 0, 1, 0
CURRENT_BUTTONS, CURRENT_POSITION, CURRENT_TRANSFORM, CURRENT_FORCE = 0x2000, 0x2050, 0x2052, 0x2700
MAX_PRIORITY, MIN_PRIORITY = 0xFFFF, 0

_servos: dict[int, Servo] = {}  # servo of each library, which has one scheduler in a process


def servo_of(library: str) -> Servo:
    """The servo of the library at path `library`, "" for the usual names; made once. Raises DeviceError."""
    hd = load(library)
    if hd._handle not in _servos:
        _servos[hd._handle] = Servo(hd)
    return _servos[hd._handle]


class ServoFrame:
    """See `Mailbox.frame` for what a frame decides. `over` ends the frames: the device is not touched any more."""

    def __init__(self, hd: ctypes.CDLL, handle: int, mailbox: Mailbox, take_errors: Callable[[], None]) -> None:
        self._hd = hd
        self._handle = handle
        self._mailbox = mailbox
        self._take_errors = take_errors
        self._position = (c_double * 3)()
        self._force = (c_double * 3)()
        self._transform = (c_double * 16)()
        self._buttons = (c_int * 1)()
        self.over = False

    def call(self, _: object) -> int:
        """The callback. Nothing may be raised out of it: ctypes would print it, and the last force would stay."""
        if self.over:
            return DONE
        self._hd.hdMakeCurrentDevice(self._handle)
        self._hd.hdBeginFrame(self._handle)
        try:
            force = self._judge()
        except Exception as error:  # noqa: BLE001 (said by read(), and the force is zero from here on)
            self._mailbox.lose(f"openhaptics: a frame failed: {error!r}; please report this")
            force = ZERO
        self._send(force)
        if self._troubled():
            self._let_go()
        self._hd.hdEndFrame(self._handle)
        return CONTINUE

    def _troubled(self) -> bool:
        """Return whether the library has reported errors of this device since it was last asked."""
        before = self._mailbox.troubles
        self._take_errors()
        return self._mailbox.troubles != before

    def _let_go(self) -> None:
        """A force could not be set, so the one before it stays: set none; where that fails, too, switch forces off."""
        self._mailbox.withhold()
        self._send(ZERO)
        if self._troubled():
            self._hd.hdDisable(FORCE_OUTPUT)
            self._mailbox.lose(f"openhaptics: its force cannot be set, so forces were switched off; {cure_for(0x300)}")

    def within(self, work: Callable[[], _Answer]) -> _Answer:
        """Return the result of `work`, run within a frame of its own that sends no force."""
        self._hd.hdBeginFrame(self._handle)
        try:
            return work()
        finally:
            self._send(ZERO)
            self._hd.hdEndFrame(self._handle)

    def send_zero(self) -> None:
        self.within(lambda: None)

    def _judge(self) -> Vector:
        hd, position = self._hd, self._position
        hd.hdGetDoublev(CURRENT_POSITION, position)
        hd.hdGetDoublev(CURRENT_TRANSFORM, self._transform)
        hd.hdGetIntegerv(CURRENT_BUTTONS, self._buttons)
        self._take_errors()  # of this frame so far, and of the end of the one before
        if hd.hdGetCurrentDevice() != self._handle:  # a device being opened was made current under us
            hd.hdMakeCurrentDevice(self._handle)
            return self._mailbox.skip("another device was current")
        if not hd.hdIsEnabled(FORCE_OUTPUT):
            self._mailbox.lose(f"openhaptics: lost: the library has switched its forces off; {cure_for(0x300)}")
        return self._mailbox.frame((position[0], position[1], position[2]), self._buttons[0], self._transform[:])

    def _send(self, force: Vector) -> None:
        self._force[0], self._force[1], self._force[2] = force
        self._hd.hdSetDoublev(CURRENT_FORCE, self._force)


class Servo:
    """The servo thread of a library and the devices it runs; it runs while there are any."""

    def __init__(self, hd: ctypes.CDLL) -> None:
        self.hd = hd
        self.links: dict[int, ServoDevice] = {}
        self._running = False
        self._strays: list[ErrorReport] | None = None
        self._kept: list[Any] = []
        self._tickets: list[int] = []
        atexit.register(self.close)  # an interpreter that ends cannot be called back any more

    def close(self) -> None:
        """Let go of all devices."""
        for link in tuple(self.links.values()):
            link.close()

    def connect(self, name: str, mailbox: Mailbox) -> ServoDevice:
        """The device that the vendor's settings call `name`, "" for the default one; no force flows yet. Raises DeviceError."""
        where = f"openhaptics:{name}"
        strays: list[ErrorReport] = []
        self._strays = strays
        handle = int(self.hd.hdInitDevice(name.encode() or None))
        self._strays = None
        reports = pop_errors(self.hd) + strays
        if handle in self.links:
            raise DeviceError(f"{where}: is open already as {self.links[handle].where}; close that one first")
        if handle == INVALID_HANDLE:
            raise failed(where, "is not to be had", reports)
        link = self.links[handle] = ServoDevice(self, handle, where, mailbox)
        try:
            link.check("is not to be had", reports)
            if not self._running:
                self.hd.hdStartScheduler()
                self._running = True
                link.check("the servo does not start", self.together(partial(pop_errors, self.hd)))
        except DeviceError:
            link.close()
            raise
        return link

    def together(self, work: Callable[[], _Answer]) -> _Answer:
        """Run `work` in the servo thread between frames and wait for it; here and now where the servo does not run."""
        answers: list[_Answer] = []
        problems: list[Exception] = []

        def run(_: object) -> int:
            if not answers and not problems:
                try:
                    answers.append(work())
                except Exception as problem:  # noqa: BLE001 (raised again below, in the thread that asked)
                    problems.append(problem)
            return DONE

        if self._running:
            callback = CALLBACK(run)
            self.hd.hdScheduleSynchronous(callback, None, MIN_PRIORITY)
            if not answers and not problems:  # not run: the servo is dead, or full and may yet call it
                self._kept.append(callback)
        run(None)
        if problems:
            raise problems[0]
        return answers[0]

    def schedule(self, call: Callable[[object], int]) -> None:
        """Call at every frame until it returns DONE, which unschedules it."""
        callback = CALLBACK(call)
        self._kept.append(callback)  # for ever: nothing says when the servo is through with it
        self._tickets.append(self.hd.hdScheduleAsynchronous(callback, None, MAX_PRIORITY))

    def forget(self, link: ServoDevice) -> None:
        """Disable the device; the last one stops the servo. Stop, unschedule, disable: the order of the toolkit's examples."""
        self.links.pop(link.handle, None)
        if self._running and not self.links:
            self.hd.hdStopScheduler()
            self._running = False
            for ticket in self._tickets:
                if self.hd.hdWaitForCompletion(ticket, CHECK_STATUS):  # it has had no frame since it was closed
                    self.hd.hdUnschedule(ticket)
            self._tickets.clear()
        self.hd.hdDisableDevice(link.handle)
        if not self._running:
            pop_errors(self.hd)

    def sort(self, reports: list[ErrorReport]) -> None:
        """Hand errors to the devices they are of; those of no device are everybody's.

        An error says which device was current. While one is being opened that may be another one than the error is of, so
        errors that end a session wait until that is over.
        """
        strays = self._strays
        for report in reports:
            link = self.links.get(report.handle)
            if strays is not None and report.code not in FORCE_ERRORS:
                strays.append(report)
            else:
                for each in (link,) if link is not None else tuple(self.links.values()):
                    each.mailbox.trouble(report.code, each.text(report))


def failed(where: str, what: str, reports: list[ErrorReport]) -> DeviceError:
    """The error for `reports`, whose first is the cause."""
    if not reports:
        return DeviceError(f"{where}: {what}: the library gives no reason; {cure_for(NO_REASON)}")
    first = reports[0]
    return DeviceError(f"{where}: {what}: {first.text} (error 0x{first.code:x}); {cure_for(first.code)}")


class ServoDevice:
    """One device of a servo. Verbs raise DeviceError with the library's words."""

    def __init__(self, servo: Servo, handle: int, where: str, mailbox: Mailbox) -> None:
        self.servo = servo
        self.handle = handle
        self.where = where
        self.mailbox = mailbox
        self._frame = ServoFrame(servo.hd, handle, mailbox, lambda: servo.sort(pop_errors(servo.hd)))

    def facts(self) -> Facts:
        """Facts that the library reports about the device."""
        return self._do("it cannot be asked what it is", self._ask)

    def calibration(self) -> int:
        """The state of calibration, asked within a frame as its answer is the frame's."""
        check = partial(self._frame.within, self.servo.hd.hdCheckCalibration)
        return int(self._do("its calibration cannot be checked", check))

    def calibration_styles(self) -> int:
        """Bits of the ways it can be calibrated."""
        return self._do("it cannot be asked how it is calibrated", partial(self._integer, CALIBRATION_STYLE))

    def update_calibration(self, style: int) -> None:
        self._do("its calibration cannot be updated", partial(self.servo.hd.hdUpdateCalibration, style))

    def start(self) -> None:
        """Frames with forces from now on, the first of them zero."""
        self._do("its forces cannot be enabled", self._enable)
        self.servo.schedule(self._frame.call)
        self.check("its frames cannot be scheduled", self.servo.together(partial(pop_errors, self.servo.hd)))

    def close(self) -> None:
        """Zero force, then let go. Twice does nothing. Errors on the way are counted: nothing more can be done about them."""
        if self._frame.over:
            return
        self.servo.together(self._leave)
        self.servo.forget(self)

    def text(self, report: ErrorReport) -> str:
        return f"{self.where}: lost: {report.text} (error 0x{report.code:x}); {cure_for(report.code)}"

    def check(self, what: str, reports: list[ErrorReport]) -> None:
        """Raise for errors of this device or of none; hand over those of others."""
        others = [report for report in reports if report.handle != self.handle and report.handle in self.servo.links]
        self.servo.sort(others)
        mine = [report for report in reports if report not in others]
        if mine:
            raise failed(self.where, what, mine)

    def _do(self, what: str, work: Callable[[], _Answer]) -> _Answer:
        def run() -> tuple[_Answer, list[ErrorReport]]:
            self.servo.hd.hdMakeCurrentDevice(self.handle)
            return work(), pop_errors(self.servo.hd)

        answer, reports = self.servo.together(run)
        self.check(what, reports)
        return answer

    def _ask(self) -> Facts:
        model = (self.servo.hd.hdGetString(MODEL_TYPE) or b"").decode(errors="replace")
        nominal = (NOMINAL_MAX_FORCE, NOMINAL_MAX_CONTINUOUS_FORCE, NOMINAL_MAX_STIFFNESS)
        return Facts(model, *[self._double(name) for name in nominal])

    def _double(self, name: int) -> float:
        value = (c_double * 6)()
        self.servo.hd.hdGetDoublev(name, value)
        return value[0]

    def _integer(self, name: int) -> int:
        value = (c_int * 6)()
        self.servo.hd.hdGetIntegerv(name, value)
        return value[0]

    def _enable(self) -> None:
        self._frame.send_zero()
        self.servo.hd.hdEnable(FORCE_OUTPUT)

    def _leave(self) -> None:
        self._frame.over = True
        self.servo.hd.hdMakeCurrentDevice(self.handle)
        self._frame.send_zero()
        self.servo.hd.hdDisable(FORCE_OUTPUT)
        self.servo.sort(pop_errors(self.servo.hd))
