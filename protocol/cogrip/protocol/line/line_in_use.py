"""Tuning of a line while it is in use: the loop time that it goes by, and its impedances by frame (theory 7.1 to 7.3)."""

from collections import deque
from math import exp

from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.settings.line_tuning import bounded, flat_s
from cogrip.protocol.settings.types import Prefer

FOLLOW_S = 5.0  # time in which the followed loop time changes by a factor of e at most
READINGS_HZ = 4
AGREED = 0.05  # largest difference of two readings in a row that agree, as a fraction of the newer one
NEW = 0.1  # difference to the last goal above which a reading is a new one, as a fraction of that goal
KEPT = 64  # changes that are remembered until their frames are popped


class LoopFollower:
    """Loop time that a line goes by: that of its meter, slowly, or `flat_s` where that is longer.

    factor: by which it changes in a step, at most

    A reading becomes the goal once two in a row agree and it is NEW away from the last. `update` is called once in `frames`
    frames, so `factor` is exp(frames T_n / FOLLOW_S).
    """

    __slots__ = ("_every", "_flat_s", "_frame_s", "_goal_s", "_seen_s", "_waited", "factor", "loop_s")

    def __init__(self, loop_s: float, prefer: Prefer, frame_s: float, frames: int) -> None:
        self._flat_s, self._frame_s = flat_s(prefer), frame_s
        self.loop_s = self._goal_s = max(loop_s, self._flat_s)
        self.factor = exp(frames * frame_s / FOLLOW_S)
        self._every = max(1, round(1.0 / (READINGS_HZ * frames * frame_s)))
        self._waited = 0
        self._seen_s: float | None = None

    def update(self, loops: LoopMeter) -> None:
        """Move `loop_s` on towards what is measured."""
        self._waited += 1
        if self._waited >= self._every and loops.full:
            self._waited = 0
            self._read(loops.median())
        self.loop_s = min(max(self._goal_s, self.loop_s / self.factor), self.loop_s * self.factor)

    def _read(self, loop: float | None) -> None:
        before, self._seen_s = self._seen_s, None if loop is None else max(loop * self._frame_s, self._flat_s)
        now = self._seen_s
        agreed = now is not None and before is not None and abs(now - before) <= AGREED * now
        if now is not None and agreed and abs(now - self._goal_s) > NEW * self._goal_s:
            self._goal_s = now


class ImpedanceChanges:
    """Impedances by the number of the frame from which each holds, as the other end says them.

    impedance_nspm  that of the frame asked for last
    """

    __slots__ = ("_coming", "_newest", "impedance_nspm")

    def __init__(self, impedance_nspm: float) -> None:
        self.impedance_nspm = impedance_nspm
        self._coming: deque[tuple[int, float]] = deque(maxlen=KEPT)
        self._newest = -1

    def add(self, number: int, impedance_nspm: float) -> None:
        """Record that frames from `number` on have this impedance, within bounds; a number that is not the newest is known."""
        if number > self._newest:
            self._newest = number
            self._coming.append((number, bounded(impedance_nspm)))

    def at(self, number: int) -> float:
        """Return the impedance of frame `number`, which is no lower than those asked for before."""
        coming = self._coming
        while coming and coming[0][0] <= number:
            _, self.impedance_nspm = coming.popleft()
        return self.impedance_nspm
