"""One frame of the HD library's servo thread: read, judge, send a force, whatever happens."""

import ctypes
from collections.abc import Callable
from ctypes import c_double, c_int
from typing import TypeVar

from cogrip.devices.arm.kinematics import Vector
from cogrip.devices.openhaptics.mailbox import ZERO, Mailbox

_Answer = TypeVar("_Answer")

CURRENT_BUTTONS, CURRENT_POSITION, CURRENT_FORCE = 0x2000, 0x2050, 0x2700
DONE, CONTINUE = 0, 1


class Frame:
    """See `Mailbox.frame` for what a frame decides. `over` ends the frames: the device is not touched any more."""

    def __init__(self, hd: ctypes.CDLL, handle: int, mailbox: Mailbox, take_errors: Callable[[], None]) -> None:
        self._hd = hd
        self._handle = handle
        self._mailbox = mailbox
        self._take_errors = take_errors
        self._position = (c_double * 3)()
        self._force = (c_double * 3)()
        self._buttons = c_int()
        self._buttons_at = ctypes.pointer(self._buttons)
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
        self._hd.hdEndFrame(self._handle)
        return CONTINUE

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
        hd.hdGetIntegerv(CURRENT_BUTTONS, self._buttons_at)
        self._take_errors()  # of this frame so far, and of the end of the one before
        if hd.hdGetCurrentDevice() != self._handle:  # a device being opened was made current under us
            hd.hdMakeCurrentDevice(self._handle)
            return self._mailbox.skip("another device was current")
        return self._mailbox.frame((position[0], position[1], position[2]), self._buttons.value)

    def _send(self, force: Vector) -> None:
        self._force[0], self._force[1], self._force[2] = force
        self._hd.hdSetDoublev(CURRENT_FORCE, self._force)
