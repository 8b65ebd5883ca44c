"""Estimators that the client's `MotionObserver` was compared with (docs/velocity.md). Same calls, plain floats."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol


class Estimator(Protocol):
    """Positions in, velocities out, one call a sample."""

    def update(self, position_m: Sequence[float], ticks: int = 1) -> list[float]:
        """Velocity [m/s], shape (axes,), `ticks` ticks after the sample before, at the position [m] read now."""
        ...

    def reset(self) -> None:
        """Forget everything."""
        ...


class AdaptiveWindow:
    """First-order adaptive windowing, end fit (Janabi-Sharifi, Hayward and Chen 2000).

    The slope of the line from the oldest to the newest sample of the longest window, at most `most` samples back, in which none
    is further than one count from that line: for all that the encoder says the motion could have been uniform.
    """

    def __init__(self, axes: int, tick_s: float, resolution_m: float, most: int = 16) -> None:
        self._axes = axes
        self._tick_s = tick_s
        self._band_m = resolution_m * (1.0 + 1e-6)  # counts are computed: a sum of them is off by roundings
        self._samples: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=most + 1)
        self._tick = 0

    def update(self, position_m: Sequence[float], ticks: int = 1) -> list[float]:
        self._tick += ticks
        self._samples.appendleft((self._tick, tuple(position_m)))
        return [self._slope(axis) for axis in range(self._axes)]

    def _slope(self, axis: int) -> float:
        """Each sample allows a cone of slopes from the newest; a window holds while its own is in all of those inside."""
        samples, band, tick_s = iter(self._samples), self._band_m, self._tick_s
        newest, place = next(samples)
        at = place[axis]
        slope, low, high = 0.0, float("-inf"), float("inf")
        for tick, old in samples:
            span_s = (newest - tick) * tick_s
            direction = at - old[axis]
            candidate = direction / span_s
            if not low <= candidate <= high:
                break
            slope = candidate
            low, high = max(low, (direction - band) / span_s), min(high, (direction + band) / span_s)
        return slope

    def reset(self) -> None:
        self._samples.clear()


class FollowingAlphaBeta:
    """`MotionObserver` of positions alone whose memory falls from `slow` at rest to `fast` at one count a tick.

    It is quiet where counts come one by one.
    """

    def __init__(self, axes: int, tick_s: float, resolution_m: float, slow: float = 0.8, fast: float = 0.4) -> None:
        self._tick_s = tick_s
        self._count_mps = max(resolution_m, 1e-12) / tick_s
        self._slow, self._fast = slow, fast
        self._position: list[float] | None = None
        self._velocity = [0.0] * axes

    def update(self, position_m: Sequence[float], ticks: int = 1) -> list[float]:
        estimate, velocity = self._position, self._velocity
        if estimate is None:
            self._position = list(position_m)
            return velocity
        step_s = self._tick_s * ticks
        for axis, measured in enumerate(position_m):
            predicted = estimate[axis] + step_s * velocity[axis]
            error = measured - predicted
            share = min(1.0, abs(velocity[axis]) / self._count_mps)
            memory = self._slow + share * (self._fast - self._slow)
            estimate[axis] = predicted + (1.0 - memory * memory) * error
            velocity[axis] += (1.0 - memory) ** 2 / step_s * error
        return velocity

    def reset(self) -> None:
        self._position = None
        self._velocity = [0.0] * len(self._velocity)
