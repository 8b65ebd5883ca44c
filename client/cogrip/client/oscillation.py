"""Detection of oscillation at the hand: a force that reverses fast, or that sits at its limit.

A turn is where the force of an axis turns back after it has changed by more than SWING_N; it is fast if the one before was at most
half a period of FAST_HZ ago. Hands turn at 12 Hz at most, so that a train of fast turns is no person's. A fast turn counts as a
reversal where the force has changed its sign, or where the device end feeds the motion: the work of the force that
follows the hand's own motion, both less their slow parts, is then negative. (What reverses because the object does, or
because its state comes in steps, is the object that is felt.)
"""

from collections import deque
from collections.abc import Sequence

FAST_HZ = 20.0
SWING_N = 0.5  # from one turn to the next, or it is none
TRAIN = 3  # fast turns in a row, from which on they are no impact: a tap on a wall makes two
SLOW_S = 0.02  # time constant of the slow parts
FED_S = 0.05  # over which the work is summed
NOISE = 0.05  # of the square of a count a tick: more than counts add to the work of a tick, beta / 12
WINDOW_S = 0.5
MOST_FAST = 10  # reversals within the window: a quarter of a second at FAST_HZ
MOST_AT_LIMIT = 0.1  # of the window


class AxisTurns:
    """Turns of the force of one axis, and the work that goes with them."""

    __slots__ = ("_extreme", "_half_period", "_keep", "_last", "_local", "_rising", "_slow", "_slow_local", "_slow_mps", "_noise", "train", "_work")

    def __init__(self, tick_s: float, count_m: float) -> None:
        count_mps = count_m / tick_s
        self._noise = NOISE * count_mps * count_mps * FED_S / tick_s
        self._half_period = 0.5 / (FAST_HZ * tick_s)
        self._slow, self._keep = tick_s / SLOW_S, 1.0 - tick_s / FED_S
        self._extreme = 0.0
        self._rising = True
        self._last = -1e9  # tick of the last turn
        self._local = self._slow_local = self._slow_mps = 0.0
        self.train = 0  # fast turns in a row
        self._work = 0.0

    def add(self, tick: int, force_n: float, local: float, mean_mps: float) -> bool:
        """True where the force has reversed, and fast."""
        slow = self._slow
        self._slow_mps += slow * (mean_mps - self._slow_mps)
        self._work = self._keep * self._work + (self._local - self._slow_local) * (mean_mps - self._slow_mps)
        self._local = local
        self._slow_local += slow * (local - self._slow_local)
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
        self.train = self.train + 1 if fast else 0
        half = 0.5 * SWING_N
        crossed = force_n > half and before < -half or force_n < -half and before > half
        return fast and (crossed or self.feeds)


    @property
    def feeds(self) -> bool:
        """Whether the device end gives energy to the fast part of the motion, beyond what counts alone can look like."""
        return self._work < -self._noise


class OscillationDetector:
    """What the last WINDOW_S held: `add` once a tick."""

    def __init__(self, axes: int, tick_s: float, count_m: float) -> None:
        self._axes = [AxisTurns(tick_s, count_m) for _ in range(axes)]
        self._window = round(WINDOW_S / tick_s)
        self._most_at_limit = MOST_AT_LIMIT * self._window
        self._fast: deque[int] = deque()
        self._limited: deque[int] = deque()
        self._tick = 0

    def add(
        self, force_n: Sequence[float], limited: bool, local_mps: Sequence[float], mean_mps: Sequence[float]
    ) -> bool:
        """One more tick. True where the device end feeds a train of fast turns.

        force_n    to the motors until the next tick [N], shape (axes,)
        limited    whether a limit holds it
        local_mps  the velocity that the damper of the law sees, shape (axes,): of its part that follows the hand's own motion
        mean_mps   mean velocity of the tick that has passed [m/s], shape (axes,)
        """
        self._tick = tick = self._tick + 1
        fed = False
        for axis, turns in enumerate(self._axes):
            if turns.add(tick, force_n[axis], local_mps[axis], mean_mps[axis]):
                self._fast.append(tick)
                fed = fed or (turns.train >= TRAIN and turns.feeds)
        if limited:
            self._limited.append(tick)
        old = tick - self._window
        for ticks in (self._fast, self._limited):
            while ticks and ticks[0] <= old:
                ticks.popleft()
        return fed

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
