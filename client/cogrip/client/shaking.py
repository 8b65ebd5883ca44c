"""Shaking that a hand feels: the force that varies faster than hands move, for as long as it goes on.

Per axis a high-pass filter of two equal poles at SHAKE_HZ, F the force of a tick [N]:

    l <- l + a (F - l)        h = F - l        l' <- l' + a (h - l')        h' = h - l'

Its root mean square over all places, in windows of WINDOW_S; what the last SUSTAINED of them all exceed has lasted. A contact
that is made or lost is in one of them or two. Hands detect vibration of a stylus or a grasped handle at a few hundredths of a
newton, the less the nearer to 200 Hz (Israr, Choi and Tan 2006; Brisben, Hsiao and Johnson 1999).
"""

from collections import deque
from collections.abc import Sequence
from math import exp, pi, sqrt

from cogrip.protocol.setting_types import PLACES

SHAKE_HZ = 12.0  # rate at which hands turn at most
WINDOW_S = 0.125
SUSTAINED = 4  # windows


class Shaking:
    """Shaking of one hand. Call `enter` each tick with a force that is all there, and `pause` in any other.

    shake_n  largest so far that has lasted for SUSTAINED windows [N rms]
    """

    __slots__ = ("_axes", "_fraction", "_left", "_lower", "_lowest", "_recent", "_started", "_sum", "_window", "shake_n")

    def __init__(self, axes: int, tick_s: float) -> None:
        self._axes = min(axes, PLACES)
        self._fraction = 1.0 - exp(-2.0 * pi * SHAKE_HZ * tick_s)
        self._window = max(1, round(WINDOW_S / tick_s))
        self._lower, self._lowest = [0.0] * PLACES, [0.0] * PLACES
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
        lower, lowest, fraction = self._lower, self._lowest, self._fraction
        if not self._started:
            self._started, self._left, self._sum = True, self._window, 0.0
            for axis in range(self._axes):
                lower[axis], lowest[axis] = force_n[axis], 0.0
        total = self._sum
        for axis in range(self._axes):
            low = lower[axis] + fraction * (force_n[axis] - lower[axis])
            high = force_n[axis] - low
            lower[axis] = low
            low = lowest[axis] + fraction * (high - lowest[axis])
            lowest[axis] = low
            high -= low
            total += high * high
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
