"""Detection of oscillation at the hand: a force that turns back and forth fast, or that sits at its limit.

A turn is where a force of one axis turns back after it has changed by more than SWING_N; it is fast if the one before was at
most half a period of FAST_HZ ago. Hands turn at 12 Hz at most, so that a train of fast turns is no person's. Two forces are
watched. Turns of the whole force count where its sign changes by them: a force that comes in steps, as an object's state does,
turns as well. Turns of the local force, the part that follows the hand's own motion, always count: the hand moves by them.
"""

from collections import deque
from collections.abc import Sequence

FAST_HZ = 20.0
SWING_N = 0.5  # from one turn to the next, or it is none
TRAIN = 3  # fast turns of the local force in a row: the device end oscillates. A tap on a wall makes two
WINDOW_S = 0.5
MOST_FAST = 10  # fast turns within the window: a quarter of a second at FAST_HZ
MOST_AT_LIMIT = 0.1  # of the window


class Turns:
    """Turns of one force, by its extremes."""

    __slots__ = ("_extreme", "_half_period", "_last", "_rising", "crossed", "train")

    def __init__(self, tick_s: float) -> None:
        self._half_period = 0.5 / (FAST_HZ * tick_s)
        self._extreme = 0.0
        self._rising = True
        self._last = -1e9  # tick of the last turn
        self.crossed = False  # the sign changed by the last turn, half a swing on either side
        self.train = 0  # fast turns in a row

    def add(self, tick: int, force_n: float) -> bool:
        """True where the force has turned, and fast."""
        before = self._extreme
        swing = force_n - before
        if (swing > 0.0) == self._rising:
            if swing:
                self._extreme = force_n
            return False
        if -SWING_N <= swing <= SWING_N:
            return False
        fast = tick - self._last <= self._half_period
        self._last, self._extreme, self._rising = tick, force_n, not self._rising
        self.crossed = min(abs(force_n), abs(before)) >= 0.5 * SWING_N and force_n * before < 0.0
        self.train = self.train + 1 if fast else 0
        return fast


class OscillationDetector:
    """The last WINDOW_S of one device's force: `add` once a tick."""

    def __init__(self, axes: int, tick_s: float) -> None:
        self._axes = [(Turns(tick_s), Turns(tick_s)) for _ in range(axes)]
        self._window = round(WINDOW_S / tick_s)
        self._most_at_limit = MOST_AT_LIMIT * self._window
        self._fast: deque[int] = deque()
        self._limited: deque[int] = deque()
        self._tick = 0

    def add(self, force_n: Sequence[float], limited: bool, local_n: Sequence[float]) -> bool:
        """One more tick. True at each turn of a train of the local force.

        force_n   to the motors until the next tick [N], shape (axes,)
        limited   whether a limit holds it
        local_n   the part of the law that follows the hand's own motion [N], shape (axes,)
        """
        self._tick = tick = self._tick + 1
        train = False
        for axis, (whole, local) in enumerate(self._axes):
            reversed_ = whole.add(tick, force_n[axis]) and whole.crossed
            if local.add(tick, local_n[axis]):
                reversed_ = True
                train = train or local.train >= TRAIN
            if reversed_:
                self._fast.append(tick)
        if limited:
            self._limited.append(tick)
        old = tick - self._window
        for ticks in (self._fast, self._limited):
            while ticks and ticks[0] <= old:
                ticks.popleft()
        return train

    @property
    def oscillates(self) -> bool:
        return len(self._fast) >= MOST_FAST

    @property
    def at_limit(self) -> bool:
        return len(self._limited) > self._most_at_limit

    def forget(self) -> None:
        """Begin anew: the force was let go."""
        self._fast.clear()
        self._limited.clear()
