"""Encoders that lie: a count that jumps, or one that stands still while the arm moves. Either way the pose is lost.

A hand and the motors together accelerate the tip by a few hundred m/s^2 at most, so from one reading to the next a joint's
speed can only change by a bounded number of counts. A joint that moved, stops dead within one reading and then does
not flicker by a single count while the others go on, has lost its encoder.
"""

from __future__ import annotations

from collections.abc import Sequence

MOST_ACCELERATION_MPS2 = 250.0  # 14 N of hand and 5 N of motors on 75 g
SLACK_COUNTS = 4  # of noise and of readings that are not evenly spaced
STUCK_S = 0.02
MOVING_COUNTS = 1.5  # a reading: below that a joint may stop dead by itself
OTHERS_COUNTS = 6  # that the other joints move meanwhile


class EncoderWatch:
    """`check` once a reading, in raw counts. resolution_m: how far the tip moves a count."""

    def __init__(self, joints: int, resolution_m: float, rate_hz: int) -> None:
        self._jump = MOST_ACCELERATION_MPS2 / (rate_hz * rate_hz) / resolution_m  # counts a tick^2
        self._stuck_readings = max(2, round(STUCK_S * rate_hz))
        self._last: Sequence[float] | None = None
        self._speed = [0.0] * joints  # counts a tick, smoothed over four readings
        self._before = [0.0] * joints  # that speed when the joint stopped
        self._still = [0] * joints
        self._others = [0.0] * joints

    def check(self, counts: Sequence[float], ticks: int) -> str:
        """What is wrong with these counts, `ticks` after the last; "" for nothing."""
        last, self._last = self._last, counts
        if last is None or ticks < 1:
            return ""
        steps = [new - old for new, old in zip(counts, last, strict=True)]
        total = sum(map(abs, steps))
        wrong = ""
        for joint, step in enumerate(steps):
            speed = self._speed[joint]
            # a t^2 / 2 for the motion itself, and the smoothed speed is about a tick behind
            if abs(step - speed * ticks) > SLACK_COUNTS + self._jump * ticks * (0.5 * ticks + 1.0):
                wrong = wrong or f"encoder {'abc'[joint]} jumped by {step:g} counts"
            if step:
                self._still[joint] = 0
                self._others[joint] = 0.0
                self._speed[joint] = speed + 0.5 * (step / ticks - speed)
                continue
            if not self._still[joint]:
                self._before[joint] = abs(speed)
            self._still[joint] += ticks
            self._others[joint] += total
            self._speed[joint] = 0.5 * speed
            if (
                self._before[joint] >= MOVING_COUNTS
                and self._still[joint] >= self._stuck_readings
                and self._others[joint] >= OTHERS_COUNTS
            ):
                wrong = wrong or f"encoder {'abc'[joint]} is stuck"
        return wrong
