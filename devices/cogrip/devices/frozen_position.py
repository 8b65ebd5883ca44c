"""A position that stands still to the last bit while the device's own velocity says that it moves.

Symbols: v reported speed [m/s], T tick [s], v_0 the speed as the position stood still first, s the way [m] that v has gone
since, forgotten with WINDOW_S.

    frozen where  s = sum of v T  >  FROZEN_M + SLACK_COUNTS q + LAG_S v_0

q is one count: a tip that moves less than one shows nothing. v is filtered, and so late: it
goes on for LAG_S after a tip that stops dead.
A v of less than FROZEN_M / WINDOW_S, noise say, is never taken for motion. Nor is v held to have lasted through
a silence of the device: a reading that comes more than LAG_S after the one before it begins anew.
"""

from collections.abc import Sequence
from math import hypot, isfinite

FROZEN_M = 0.003
SLACK_COUNTS = 8.0
WINDOW_S = 0.2
LAG_S = 0.04
"""Time for which v goes on after a tip that stops dead: twice the average of 20 ms of the Force Dimension SDK."""


class FrozenPosition:
    """Judges the readings of one device, of positions [m] and velocities [m/s] of shape (axes,)."""

    def __init__(self, resolution_m: float, rate_hz: int) -> None:
        self._least_m = FROZEN_M + SLACK_COUNTS * resolution_m
        self._tick_s = 1.0 / rate_hz
        self._silent_ticks = LAG_S * rate_hz
        self._at: Sequence[float] | None = None
        self._tick = 0
        self._ticks = 0
        self._begun_mps, self._gone_m = -1.0, 0.0

    def still(self, position_m: Sequence[float], tick: int) -> bool:
        """Enter a reading. Return whether it is the one before to the last bit, so that a velocity is to be judged."""
        ticks, self._tick = tick - self._tick, tick
        self._ticks = ticks
        if position_m != self._at or ticks > self._silent_ticks:
            self._at, self._gone_m, self._begun_mps = position_m, 0.0, -1.0
            return False
        return True

    def judge(self, velocity_mps: Sequence[float]) -> str:
        """Return why a reading that stands `still` is not to be believed, "" if it may be."""
        speed = hypot(*velocity_mps)
        if not isfinite(speed):
            return ""
        if self._begun_mps < 0.0:
            self._begun_mps = speed
        step_s = self._ticks * self._tick_s
        self._gone_m = max(0.0, 1.0 - step_s / WINDOW_S) * self._gone_m + speed * step_s
        if self._gone_m <= self._least_m + LAG_S * self._begun_mps:
            return ""
        return (
            f"its position stands still, and its own velocity of {speed:.2g} m/s has gone {1e3 * self._gone_m:.1f} mm"
            " meanwhile: an encoder, or what reads it, has stopped"
        )
