"""The loop of a line: a running median over the last second (`SPEC.md` section 8).

A wave is sent, answered, and the answer is applied: each end sees by `acknowledged` and its own ticks how long that took,
2d + 1 frames with d frames of delay in each direction, playout delay included.
"""

from collections import Counter, deque

from cogrip.machine.addition import add_integers

MOST_LOOP_FRAMES = 4096  # longest loop that is believed


class LoopMeter:
    """Median of the last `window` loops, entered in ticks.

    implausible  values that cannot be a loop: counted and ignored
    """

    __slots__ = ("_counts", "_last", "_ticks_per_frame", "implausible")

    def __init__(self, window: int, ticks_per_frame: int = 1) -> None:
        self._ticks_per_frame = ticks_per_frame
        self._last: deque[int] = deque(maxlen=window)
        self._counts: Counter[int] = Counter()
        self.implausible = 0

    def add(self, loop_ticks: int) -> None:
        """Add one measured loop time."""
        if not self._ticks_per_frame <= loop_ticks <= MOST_LOOP_FRAMES * self._ticks_per_frame:
            self.implausible += 1
            return
        last, counts = self._last, self._counts
        if len(last) == last.maxlen:
            oldest = last[0]
            counts[oldest] -= 1
            if not counts[oldest]:
                del counts[oldest]
        last.append(loop_ticks)
        counts[loop_ticks] += 1

    @property
    def full(self) -> bool:
        """True once the window is full."""
        return len(self._last) == self._last.maxlen

    def mean(self, loops: int) -> float | None:
        """Return the mean of the last so many loops [frames], None before the first: what a hand that rested felt meanwhile."""
        last = list(self._last)[-loops:]
        return add_integers(last) / (len(last) * self._ticks_per_frame) if last else None

    def median(self) -> float | None:
        """Return the median [frames], None before the first loop."""
        half = len(self._last) / 2
        for loop in sorted(self._counts):
            half -= self._counts[loop]
            if half <= 0:
                return loop / self._ticks_per_frame
        return None
