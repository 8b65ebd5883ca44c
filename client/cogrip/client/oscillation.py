"""Detection of oscillation at the hand: a force that reverses fast, or that sits at its limit.

Two forces are watched, axis by axis. The whole force reverses where its sign changes, by half of SWING_N on either side of 0.
The local force, the part that follows the hand's own motion, turns where it goes back by more than SWING_N, whatever its sign:
then the hand itself moves to and fro, also where it presses. (The whole force may turn without that: an object's state
comes in steps.) A reversal or turn is fast if the one before was at most half a period of FAST_HZ ago. Hands turn at 12 Hz at
most, so that a train of fast turns is no person's.
"""

from collections import deque
from collections.abc import Sequence

FAST_HZ = 20.0
SWING_N = 0.5  # from one turn to the next, or it is none
TRAIN = 3  # fast turns of the local force in a row: the device end oscillates. A tap on a wall makes two
WINDOW_S = 0.5
MOST_FAST = 10  # fast reversals and turns of one axis within the window: a quarter of a second at FAST_HZ
MOST_AT_LIMIT = 0.1  # of the window


class Reversals:
    """Changes of sign of a force."""

    __slots__ = ("_half_period", "_last", "_positive")

    def __init__(self, tick_s: float) -> None:
        self._half_period = 0.5 / (FAST_HZ * tick_s)
        self._positive = True
        self._last = -1e9  # tick of the last reversal

    def add(self, tick: int, force_n: float) -> bool:
        """Return True where the force has just reversed, and fast."""
        if (force_n > -0.5 * SWING_N) if self._positive else (force_n < 0.5 * SWING_N):
            return False
        fast = tick - self._last <= self._half_period
        self._last, self._positive = tick, not self._positive
        return fast


class Turns:
    """Turns of a force, by its extremes."""

    __slots__ = ("_extreme", "_half_period", "_last", "_rising", "train")

    def __init__(self, tick_s: float) -> None:
        self._half_period = 0.5 / (FAST_HZ * tick_s)
        self._extreme = 0.0
        self._rising = True
        self._last = -1e9  # tick of the last turn
        self.train = 0  # fast turns in a row

    def add(self, tick: int, force_n: float) -> bool:
        """Return True where the force has just turned, and fast."""
        swing = force_n - self._extreme
        if (swing > 0.0) == self._rising:
            if swing:
                self._extreme = force_n
            return False
        if -SWING_N <= swing <= SWING_N:
            return False
        fast = tick - self._last <= self._half_period
        self._last, self._extreme, self._rising = tick, force_n, not self._rising
        self.train = self.train + 1 if fast else 0
        return fast


class OscillationDetector:
    """The last WINDOW_S of one device's force; `add` once a tick."""

    def __init__(self, axes: int, tick_s: float) -> None:
        self._axes = [(Reversals(tick_s), Turns(tick_s)) for _ in range(axes)]
        self._window = round(WINDOW_S / tick_s)
        self._most_at_limit = MOST_AT_LIMIT * self._window
        self._fast: list[deque[int]] = [deque() for _ in range(axes)]  # ticks, axis by axis
        self._limited: deque[int] = deque()
        self._tick = 0

    def add(self, force_n: Sequence[float], limited: bool, local_n: Sequence[float]) -> bool:
        """Enter one more tick. Returns True at each turn of a train of the local force.

        force_n   to the motors until the next tick [N], shape (axes,)
        limited   whether a limit holds it
        local_n   the part of the law that follows the hand's own motion [N], shape (axes,)
        """
        self._tick = tick = self._tick + 1
        train = False
        for axis, (whole, local) in enumerate(self._axes):
            fast = whole.add(tick, force_n[axis])
            if local.add(tick, local_n[axis]):
                fast = True
                train = train or local.train >= TRAIN
            if fast:
                self._fast[axis].append(tick)
        if limited:
            self._limited.append(tick)
        old = tick - self._window
        for ticks in (*self._fast, self._limited):
            while ticks and ticks[0] <= old:
                ticks.popleft()
        return train

    @property
    def oscillates(self) -> bool:
        for ticks in self._fast:  # noqa: SIM110 (`any` takes three times as long)
            if len(ticks) >= MOST_FAST:
                return True
        return False

    @property
    def at_limit(self) -> bool:
        return len(self._limited) > self._most_at_limit

    def forget(self) -> None:
        """Begin anew: the force was released."""
        for ticks in self._fast:
            ticks.clear()
        self._limited.clear()
