"""Encoders that lie: a count that jumps, or one that stands still while the arm moves. Either way the pose is lost.

A hand and the motors together accelerate the tip by a few hundred m/s^2 at most, so from one reading to the next it can only go
so far off its course; but it may stop, or be stopped. Where the joints say that it went further, one of them has jumped. The
tip is asked only where a joint looks odd: near the ends of its reach a joint turns far while the tip hardly moves.

A joint that was quick, stops dead from one tick to the next, and then does not flicker by a single count, has lost its encoder:
what a hand holds seldom stands still to a count after a blow. (It may have hit its end stop; then the person re-arms.) One
that hardly moved when its encoder was lost is not found before it moves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import dist

MOST_ACCELERATION_MPS2 = 250.0  # 14 N of hand and 5 N of motors on 75 g
SLACK_COUNTS = 4  # of noise and of readings that are not evenly spaced
MOST_SPEED_MPS = 1.5  # of an arm that is not known yet
STUCK_S = 0.02
QUICK_COUNTS = 1.5  # a tick
DEAD = 0.7  # share of its pace that a joint still has when it stops dead
GAP_TICKS = 8  # without a reading: what the arm did meanwhile is not known, so it is judged anew from there
_NAMES = "abc"


class _Joint:
    """speed: counts a tick, over about two ticks; pace: without sign, over about sixteen."""

    __slots__ = ("pace", "speed", "still", "stopped_dead")

    def __init__(self) -> None:
        self.speed = self.pace = 0.0
        self.still = 0  # ticks without a count
        self.stopped_dead = False

    def move(self, step: float, ticks: int) -> None:
        if step:
            self.still = 0
        else:
            if not self.still:
                self.stopped_dead = self.pace >= QUICK_COUNTS and abs(self.speed) >= DEAD * self.pace
            self.still += ticks
        now = step / ticks
        self.speed += 0.5 * (now - self.speed)
        self.pace += min(1.0, ticks / 16) * (abs(now) - self.pace)


Tip = Callable[[Sequence[float]], Sequence[float] | None]


class EncoderWatch:
    """`check` once a reading, in raw counts. resolution_m: how far the tip moves a count; tip: position [m] of raw counts."""

    def __init__(self, joints: int, resolution_m: float, rate_hz: int, tip: Tip | None = None) -> None:
        self._resolution_m = resolution_m
        self._tip = tip
        self._jump = MOST_ACCELERATION_MPS2 / (rate_hz * rate_hz) / resolution_m  # counts a tick^2
        self._most_speed = MOST_SPEED_MPS / rate_hz / resolution_m
        self._stuck_ticks = max(2, round(STUCK_S * rate_hz))
        self._last: Sequence[float] | None = None
        self._joints = [_Joint() for _ in range(joints)]
        self._known = False  # their speeds

    def check(self, counts: Sequence[float], ticks: int) -> str:
        """What is wrong with these counts, `ticks` after the last; "" for nothing."""
        last, self._last = self._last, counts
        if last is None or not 0 < ticks <= GAP_TICKS:
            self._joints = [_Joint() for _ in self._joints]
            self._known = False
            return ""
        # a t^2 / 2 for the motion itself, and the smoothed speed is about a tick behind
        most = SLACK_COUNTS + self._jump * ticks * (0.5 * ticks + 1.5)
        steps = [new - old for new, old in zip(counts, last, strict=True)]
        likely = [self._likely(joint, step, ticks) for joint, step in zip(self._joints, steps, strict=True)]
        off = [abs(step - near) for step, near in zip(steps, likely, strict=True)]
        wrong, worst = "", max(off)
        if worst > most and self._astray([old + step for old, step in zip(last, likely, strict=True)], counts, most):
            number = off.index(worst)
            wrong = f"encoder {_NAMES[number]} jumped by {steps[number]:g} counts"
        self._known = True
        for number, joint in enumerate(self._joints):
            joint.move(steps[number], ticks)
            if joint.stopped_dead and joint.still >= self._stuck_ticks:
                wrong = wrong or f"encoder {_NAMES[number]} is stuck"
        return wrong

    def _likely(self, joint: _Joint, step: float, ticks: int) -> float:
        """What is next to `step` of all that this joint may do at its speed: go on, or stop on the way."""
        if not self._known:
            return max(-self._most_speed * ticks, min(self._most_speed * ticks, step))
        way = joint.speed * ticks
        return max(min(0.0, way), min(max(0.0, way), step))

    def _astray(self, likely: Sequence[float], counts: Sequence[float], most: float) -> bool:
        """Whether the tip is further from where it may be than `most` counts make."""
        if self._tip is None:
            return True
        expected, found = self._tip(likely), self._tip(counts)
        return expected is None or found is None or dist(expected, found) > most * self._resolution_m
