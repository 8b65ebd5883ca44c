"""Detection of oscillation at the hand: a force that reverses fast, or that sits at its limit.

Two forces are watched, axis by axis. The whole force, as its mean over a frame, reverses where its sign changes, by half of
SWING_N on either side of 0. The local force, the part that follows the hand's own motion, turns (has an extremum) where it goes
back by more than SWING_N, whatever its sign: then the hand itself moves to and fro, also where it presses. A reversal or turn
is fast if the one before was at most half a period of FAST_HZ ago. Hands turn at 12 Hz at most, so that a train of fast turns
is no person's.

A hand that meets a stiff wall rings, and the ring decays: that is how a hard thing feels, and nothing makes energy. So a turn
counts only if the swing that it ends is RING_KEPT times the one of a period before, in the same direction, or more.

The mean, because what comes from the server is held over a frame: where a hand accelerates, the force of a line ramps with it
and steps back at each frame, by b T_n xddot (0.8 N for a tremor of 1.3 mm at 9 Hz), and in free motion that is around 0. An
oscillation of the loop through the server reverses its mean. Within a frame only the local force varies.
"""

from collections import deque
from collections.abc import Sequence
from math import inf

FAST_HZ = 20.0
SWING_N = 0.5  # least swing of a force between two turns, or two reversals
HALF_SWING_N, BACK_N = 0.5 * SWING_N, -0.5 * SWING_N
RING_KEPT = 0.95  # A ring that keeps less of a swing a period later decays, at a damping ratio of 0.008 or more.
TRAIN = 3  # fast turns of the local force in a row that mean that the device end oscillates; a tap on a wall makes two
REVERSALS = 5  # fast reversals of the whole force in a row that mean that the loop through the server oscillates
RINGS_DOWN = 3  # reversals that a loop is given to ring down in once it is damped more
WINDOW_S = 0.5
MOST_FAST = 10
"""Fast reversals and turns of one axis within the window that are an oscillation: a quarter of a second at FAST_HZ."""
MOST_AT_LIMIT = 0.1  # largest fraction of the window for which a limit may hold the force


class AxisTurns:
    """Reversals of the whole force on one axis, and turns of the local one, by its extremes.

    fast       ticks of the fast ones within the window
    sum_n      of the force in the frame under way
    swing_n    of the local force, to its last turn; swing_before_n: to the turn before that
    train      fast turns in a row, those of a ring that decays left out
    reversals  fast reversals in a row, less those in which it was to ring down
    """

    __slots__ = (
        "extreme", "fast", "positive", "reversals", "reversed_at", "rising", "sum_n", "swing_before_n", "swing_n", "train",
        "turned_at", "turned_n",
    )  # fmt: skip

    def __init__(self) -> None:
        self.positive = self.rising = True
        self.reversed_at = self.turned_at = -1e9  # ticks of the last ones
        self.extreme = self.sum_n = 0.0
        self.turned_n = self.swing_n = self.swing_before_n = 0.0  # turned_n: the local force at its last turn
        self.train = self.reversals = 0
        self.fast: deque[int] = deque()


class OscillationDetector:
    """The last WINDOW_S of one device's force; `add` once a tick.

    oscillates  whether an axis has had so many fast reversals and turns within the window
    reverses    whether the whole force has reversed fast in this tick, REVERSALS times in a row, and RINGS_DOWN times more each
    at_limit    whether a limit has held the force for so much of it
    """

    def __init__(self, axes: int, tick_s: float, frame_ticks: int = 1) -> None:
        self._frame_ticks, self._in_frame = frame_ticks, 0  # ticks of a frame, and of the one under way so far
        self._axes = [AxisTurns() for _ in range(axes)]
        self._half_period = 0.5 / (FAST_HZ * tick_s)  # of FAST_HZ [ticks]
        self._window = round(WINDOW_S / tick_s)
        self._most_at_limit = MOST_AT_LIMIT * self._window
        self._limited: deque[int] = deque()
        self._tick = 0
        self._forgets_at = inf  # tick at which the oldest one that is known leaves the window
        self.oscillates = self.at_limit = self.reverses = False

    def add(self, force_n: Sequence[float], limited: bool, local_n: Sequence[float]) -> bool:
        """Add a tick. Return True at each turn of the local force in a train of TRAIN fast turns or more.

        force_n   to the motors until the next tick [N], shape (axes,)
        limited   whether a limit holds it
        local_n   the part of the law that follows the hand's own motion [N], shape (axes,)
        """
        self._tick = tick = self._tick + 1
        train = self.reverses = False
        changed = limited or tick >= self._forgets_at
        self._in_frame += 1
        ended = self._in_frame >= self._frame_ticks
        if ended:
            self._in_frame = 0
        for number, axis in enumerate(self._axes):
            force, local, fast = force_n[number], local_n[number], False
            axis.sum_n += force
            if ended:
                force, axis.sum_n = axis.sum_n / self._frame_ticks, 0.0
            if ended and not (force > BACK_N if axis.positive else force < HALF_SWING_N):
                fast = tick - axis.reversed_at <= self._half_period
                axis.reversed_at, axis.positive = tick, not axis.positive
                axis.reversals = axis.reversals + 1 if fast else 0
                if axis.reversals >= REVERSALS:
                    self.reverses = True
                    axis.reversals -= RINGS_DOWN
            swing = local - axis.extreme
            if (swing > 0.0) == axis.rising:
                axis.extreme = local
            elif not -SWING_N <= swing <= SWING_N:
                turned_fast = tick - axis.turned_at <= self._half_period
                ended_n = abs(axis.extreme - axis.turned_n)
                rings = turned_fast and ended_n >= RING_KEPT * axis.swing_before_n
                axis.swing_before_n, axis.swing_n, axis.turned_n = axis.swing_n, ended_n, axis.extreme
                axis.turned_at, axis.extreme, axis.rising = tick, local, not axis.rising
                axis.train = axis.train + rings if turned_fast else 0
                fast = fast or rings
                train = train or (rings and axis.train >= TRAIN)
            if fast:
                axis.fast.append(tick)
                changed = True
        if changed:
            if limited:
                self._limited.append(tick)
            self._judge(tick)
        return train

    def _judge(self, tick: int) -> None:
        """Forget what has left the window, and judge what is in it."""
        old = tick - self._window
        known = [self._limited, *[axis.fast for axis in self._axes]]
        for ticks in known:
            while ticks and ticks[0] <= old:
                ticks.popleft()
        self._forgets_at = min([ticks[0] + self._window for ticks in known if ticks], default=inf)
        self.at_limit = len(self._limited) > self._most_at_limit
        self.oscillates = max([len(axis.fast) for axis in self._axes]) >= MOST_FAST

    def forget(self) -> None:
        """Reset, because the force was released."""
        self._limited.clear()
        self._in_frame = 0
        for axis in self._axes:
            axis.fast.clear()
            axis.sum_n = 0.0
        self._judge(self._tick)
