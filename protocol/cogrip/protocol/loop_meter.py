"""The loop of a line in frames, as it is now: a running median (`SPEC.md` section 8).

A wave goes there, is answered, and the answer is applied: each end sees by `heard` how many frames that took. With d frames
of delay each way, playout included, it is 2d + 1. What is measured changes when the network or a playout does, so what
counts is the last second, not the session.
"""

from collections import deque

MOST_LOOP_FRAMES = 4096  # of what a peer may make one believe: no line is longer


class LoopMeter:
    """Loops of the last `window` frames that told one. What cannot be a loop is counted in `wild` and left out."""

    __slots__ = ("_counts", "_last", "wild")

    def __init__(self, window: int) -> None:
        self._last: deque[int] = deque(maxlen=window)
        self._counts: dict[int, int] = {}
        self.wild = 0

    def add(self, loop_frames: int) -> None:
        if not 1 <= loop_frames <= MOST_LOOP_FRAMES:
            self.wild += 1
            return
        last, counts = self._last, self._counts
        if len(last) == last.maxlen:
            oldest = last[0]
            if counts[oldest] == 1:
                del counts[oldest]
            else:
                counts[oldest] -= 1
        last.append(loop_frames)
        counts[loop_frames] = counts.get(loop_frames, 0) + 1

    @property
    def full(self) -> bool:
        """Whether there have been as many as the window holds."""
        return len(self._last) == self._last.maxlen

    def median(self) -> int | None:
        """None while nothing was measured."""
        half = len(self._last) / 2
        for loop in sorted(self._counts):
            half -= self._counts[loop]
            if half <= 0:
                return loop
        return None
