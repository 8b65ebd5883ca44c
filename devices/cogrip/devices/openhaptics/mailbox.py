"""The latest values that the loop's thread and the library's servo thread exchange, without queue or lock.

Each field is written by one thread only, as one whole immutable value by one assignment. So the other thread sees the old value
or the new one, never a mixture, and neither waits.
"""

from collections import Counter
from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from cogrip.devices.openhaptics.errors import FORCE_ERRORS, name_of
from cogrip.machine.rows import Vector
from cogrip.protocol.laws.rotations import Quaternion, of_matrix

SERVO_HZ = 1000  # rate of the servo by the library itself, unless it is told another one
HOLD_FRAMES = SERVO_HZ // 20  # frames, 50 ms in all, for which a force that the loop does not renew is held
MOST_WITHHELD = SERVO_HZ // 20
"""Most frames in a row whose force is dropped for errors; after more, the device is lost."""
ZERO: Vector = (0.0, 0.0, 0.0)
_OURS = (2, 0, 1)  # numbers of the library's axes in the order of ours


# OpenHaptics has x right, y up, z toward the user, in mm; the common frame x toward the user, y right, z up, in m.


def to_common(position_mm: Sequence[float]) -> Vector:
    """A position of the library [mm] in our axes [m]."""
    right, up, near = position_mm
    return 0.001 * near, 0.001 * right, 0.001 * up


def to_library(force: Vector) -> Vector:
    """A force in our axes in those of the library [N]."""
    near, right, up = force
    return right, up, near


def orientation_of(transform: Sequence[float]) -> Quaternion | None:
    """Orientation of the stylus in our axes by the library's transform, 4 x 4, column by column; None where it is none."""
    return of_matrix([[transform[4 * column + row] for column in _OURS] for row in _OURS])


class News(NamedTuple):
    """Written by the servo thread. frame counts from 1; buttons: one bit each."""

    frame: int
    position_m: Vector
    buttons: int = 0
    orientation: Quaternion | None = None


class ForceOrder(NamedTuple):
    """Written by the loop's thread. number tells an order from the one before it; force is on the hand, in our axes [N]."""

    number: int
    force_n: Vector


class Mailbox:
    """counts belongs to the servo thread: others may copy it.

    withheld  frames in a row in which nothing acted of the force that was asked for
    troubles  errors of this device so far
    """

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self.news: News | None = None
        self.lost = ""  # why the device is lost; final
        self.order = ForceOrder(0, ZERO)
        self._obeyed = 0
        self._frame = 0
        self._age = HOLD_FRAMES
        self._drop = False
        self._dropped = ""  # why, of the newest force that was
        self.withheld = self.troubles = 0

    def say(self, force: Vector) -> None:
        """Loop: this force on the hand from the next frame on [N]."""
        self.order = ForceOrder(self.order.number + 1, force)

    def trouble(self, code: int, text: str) -> None:
        """Servo: the library reports an error of this device. A force error drops one frame's force, any other ends it."""
        self.counts[name_of(code)] += 1
        self.troubles += 1
        if code in FORCE_ERRORS:
            self._drop, self._dropped = True, text
        else:
            self.lose(text)

    def lose(self, text: str) -> None:
        """Servo: no force any more; the first reason is kept."""
        self.lost = self.lost or text

    def frame(self, position_mm: Vector, buttons: int = 0, transform: Sequence[float] = ()) -> Vector:
        """Servo: one frame's readings, for the frame's force in the library's axes [N]."""
        self._frame += 1
        drop, self._drop = self._drop, False
        position = to_common(position_mm)
        if isfinite(position[0] + position[1] + position[2]):
            self.news = News(self._frame, position, buttons, orientation_of(transform) if transform else None)
        else:
            self.counts["position not finite"] += 1
            drop = True
        force = self._fresh()
        if not (drop or self.lost):
            self.withheld = 0
            return to_library(force)
        self.withhold()
        return ZERO

    def withhold(self) -> None:
        """Servo: nothing acts in this frame of the force that is asked for. One withheld for long loses the device."""
        self.withheld = self.withheld + 1 if any(self.order.force_n) else 0
        if self.withheld > MOST_WITHHELD and self._dropped:
            self.lose(self._dropped)

    def skip(self, why: str) -> Vector:
        """Servo: this frame's readings are not to be trusted; it has no force."""
        self._frame += 1
        self.counts[why] += 1
        self._drop = False
        self._fresh()
        self.withhold()
        return ZERO

    def _fresh(self) -> Vector:
        """The loop's force, or none if it is older than HOLD_FRAMES. Frames are counted: there is no clock to be wrong."""
        number, force = self.order
        if number != self._obeyed:
            self._obeyed, self._age = number, 0
        elif self._age < HOLD_FRAMES:
            self._age += 1
            if self._age == HOLD_FRAMES and any(force):
                self.counts["force not renewed"] += 1
        return force if self._age < HOLD_FRAMES else ZERO
