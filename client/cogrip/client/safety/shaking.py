"""Shaking that a hand feels: the force that varies faster than hands move, for as long as it goes on.

Each axis has a Butterworth high-pass filter of four poles at SHAKE_HZ: two stages, x in and y out, of

    y = c (x - 2 x' + x'') - a_1 y' - a_2 y''        ' the tick before

Its root mean square over all places, in windows of WINDOW_S; what the last SUSTAINED of them all exceed has lasted. A contact
that is made or lost is in one of them or two. Hands detect vibration of a stylus or a grasped handle at a few hundredths of a
newton, the less the nearer to 200 Hz (Israr, Choi and Tan 2006; Brisben, Hsiao and Johnson 1999).
"""

from collections import deque
from collections.abc import Sequence
from math import cos, pi, sin, sqrt

from cogrip.protocol.axes import PLACES

SHAKE_HZ = 12.0  # cut-off frequency: hands turn at this rate at most
WINDOW_S = 0.125
NOTHING = (0.0,) * (4 * PLACES)
SUSTAINED = 4  # windows in a row that a force must exceed to have lasted
QUALITIES = 0.5411961001461971, 1.3065629648763766
"""Quality factors of the two stages: 1 / (2 cos(pi/8)) and 1 / (2 cos(3 pi/8))."""


class Shaking:
    """Shaking of one hand. Call `enter` each tick with a force that is all there, and `pause` in any other.

    shake_n  largest so far that has lasted for SUSTAINED windows [N rms]
    """

    __slots__ = ("_axes", "_first", "_kept", "_left", "_recent", "_second", "_started", "_sum", "_window", "shake_n")

    def __init__(self, axes: int, tick_s: float) -> None:
        self._axes = min(axes, PLACES)
        turn = 2.0 * pi * min(SHAKE_HZ * tick_s, 0.25)
        first, second = QUALITIES
        self._first, self._second = list(_stage(turn, first)), list(_stage(turn, second))  # c, a_1 and a_2
        self._window = max(1, round(WINDOW_S / tick_s))
        self._kept = list(NOTHING)  # two numbers a stage and axis
        self._recent: deque[float] = deque(maxlen=SUSTAINED)
        self._started = False
        self._left, self._sum = self._window, 0.0
        self.shake_n = 0.0

    def pause(self) -> None:
        """Forget the windows so far: the force is ramped, or none."""
        if self._started:
            self._started = False
            self._recent.clear()

    def enter(self, force_n: Sequence[float]) -> None:
        """Add the force of a tick [N]."""
        kept = self._kept
        c, a1, a2 = self._first
        d, b1, b2 = self._second
        if not self._started:  # as if that force had always been
            self._started, self._left, self._sum = True, self._window, 0.0
            for axis in range(self._axes):
                x = force_n[axis]
                kept[4 * axis], kept[4 * axis + 1] = -c * x, c * x
                kept[4 * axis + 2] = kept[4 * axis + 3] = 0.0
        total = self._sum
        for axis in range(self._axes):
            at, x = 4 * axis, force_n[axis]
            y = c * x + kept[at]
            kept[at] = kept[at + 1] - 2.0 * c * x - a1 * y
            kept[at + 1] = c * x - a2 * y
            z = d * y + kept[at + 2]
            kept[at + 2] = kept[at + 3] - 2.0 * d * y - b1 * z
            kept[at + 3] = d * y - b2 * z
            total += z * z
        self._sum = total
        self._left -= 1
        if not self._left:
            self._end_window()

    def _end_window(self) -> None:
        recent = self._recent
        recent.append(sqrt(self._sum / self._window))
        self._left, self._sum = self._window, 0.0
        if len(recent) == SUSTAINED and min(recent) > self.shake_n:
            self.shake_n = min(recent)


def _stage(turn: float, quality: float) -> tuple[float, float, float]:
    """Return c, a_1 and a_2 of a stage with its corner at `turn` rad a tick, by the bilinear transform."""
    alpha = sin(turn) / (2.0 * quality)
    return 0.5 * (1.0 + cos(turn)) / (1.0 + alpha), -2.0 * cos(turn) / (1.0 + alpha), (1.0 - alpha) / (1.0 + alpha)
