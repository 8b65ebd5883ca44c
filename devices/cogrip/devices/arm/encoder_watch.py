"""Encoder faults: a count that jumps, or one that stands still while the arm moves. Either way the pose is lost.

A hand and the motors together accelerate the tip by a few hundred m/s^2 at most, so from one reading to the next it can only go
so far off its course; but it may stop, or be stopped. Where the joints say that it went further, one of them has jumped. The
tip is asked only where a joint looks odd: near the ends of its reach a joint turns far while the tip hardly moves. It is the
same where readings were missing for up to GAP_S: the course goes on, and a hand adds little speed in so short a time. Ticks may
run up to a period late, so each step may be a tick longer or shorter than counted: as in `cogrip.devices.plausibility`.

A joint that was quick, stops dead from one tick to the next, and then does not flicker by a single count, has lost its encoder:
what a hand holds seldom stands still to a count after a blow. (It may have hit its end stop; then the person re-arms.) One
that hardly moved when its encoder was lost is not found before it moves.
"""

from collections.abc import Callable, Sequence
from math import dist

from cogrip.devices.plausibility import GAP_S, STEADY, off_course_m

MOST_ACCELERATION_MPS2 = 250.0  # largest acceleration of the tip: 14 N of hand and 5 N of motors on 75 g
SLACK_COUNTS = 4  # allowance for noise and for readings that are not evenly spaced
MOST_SPEED_MPS = 1.5  # largest speed of a tip whose speed is not known yet
STUCK_S = 0.02
QUICK_COUNTS = 1.5  # least pace of a joint that can stop dead, in counts a tick
STILL_TICKS = 8  # ticks without a reading beyond which it is not known whether a joint stopped dead
DEAD = 0.7  # least share of its pace that a joint still has before it stops dead
_NAMES = "abc"


class _Joint:
    """ran: the last step, half of the one before, a quarter ..., in counts, and ran_ticks the ticks of this sum.

    pace: counts a tick without sign, over about sixteen ticks; most_speed: of a joint whose speed is not known.

    near: what is next to the last step of all that the joint may do at its speed: go on, or stop on the way.
    """

    __slots__ = ("most_speed", "near", "pace", "ran", "ran_ticks", "still", "stopped_dead")

    def __init__(self, most_speed: float) -> None:
        self.most_speed = most_speed
        self.pace = self.near = self.ran = self.ran_ticks = 0.0
        self.still = 0  # ticks without a count
        self.stopped_dead = False

    def off(self, step: float, ticks: int) -> float:
        """Return the distance of a step from the steps that the joint can make."""
        known = self.ran_ticks > 1.0
        sense = (self.ran / (self.ran_ticks - 1.0) if known else self.most_speed) * (ticks + 1)
        low, high = (0.0, sense) if sense > 0.0 else (sense, 0.0)
        if not known:
            low = -high
        self.near = low if step < low else high if step > high else step
        return abs(step - self.near)

    def move(self, step: float, ticks: int) -> None:
        if step or ticks > STILL_TICKS:
            self.still, self.stopped_dead = 0, False
        else:
            if not self.still:
                self.stopped_dead = self.pace >= QUICK_COUNTS and abs(self.ran) >= DEAD * self.pace * self.ran_ticks
            self.still += ticks
        now = step / ticks
        if not self.ran_ticks:
            self.pace = abs(now)
        self.ran, self.ran_ticks = 0.5 * self.ran + step, 0.5 * self.ran_ticks + ticks
        self.pace += min(1.0, 0.0625 * ticks) * (abs(now) - self.pace)


Tip = Callable[[Sequence[float]], Sequence[float] | None]


class EncoderWatch:
    """`check` once a reading, in raw counts. resolution_m: how far the tip moves a count; tip: position [m] of raw counts."""

    def __init__(self, joints: int, resolution_m: float, rate_hz: int, tip: Tip | None = None) -> None:
        self._resolution_m = resolution_m
        self._tip = tip
        self._tick_s = 1.0 / rate_hz
        self._gap_ticks = round(GAP_S * rate_hz)  # without a reading: after more it is judged anew from there
        self._stuck_ticks = max(2, round(STUCK_S * rate_hz))
        self._last: Sequence[float] | None = None
        self._joints = [_Joint(MOST_SPEED_MPS / rate_hz / resolution_m) for _ in range(joints)]

    def check(self, counts: Sequence[float], ticks: int) -> str:
        """Return the fault in these counts, read `ticks` after the last ones; "" for none."""
        last, self._last = self._last, counts
        if last is None or not 0 < ticks <= self._gap_ticks:
            self._joints = [_Joint(joint.most_speed) for joint in self._joints]
            return "" if last is None else self._after_gap(last, counts, max(ticks, 1))
        late_s = 0.5 * (1.0 + max(STEADY, self._joints[0].ran_ticks)) * self._tick_s  # how old the speeds are
        off_m = off_course_m(ticks * self._tick_s, late_s, MOST_ACCELERATION_MPS2)
        most = SLACK_COUNTS + off_m / self._resolution_m
        odd, worst, stuck = -1, most, ""
        for number, joint in enumerate(self._joints):
            step = counts[number] - last[number]
            off = joint.off(step, ticks)
            if off > worst:
                odd, worst = number, off
            joint.move(step, ticks)
            if joint.stopped_dead and joint.still >= self._stuck_ticks:
                stuck = f"encoder {_NAMES[number]} is stuck"
        if odd >= 0 and self._astray(last, counts, most):
            return f"encoder {_NAMES[odd]} jumped by {counts[odd] - last[odd]:g} counts"
        return stuck

    def _after_gap(self, last: Sequence[float], counts: Sequence[float], ticks: int) -> str:
        """Whatever the arm did meanwhile, it did not go much faster than MOST_SPEED_MPS; longer gaps leave room for more."""
        most = SLACK_COUNTS + 1.5 * self._joints[0].most_speed * ticks
        steps = [new - old for new, old in zip(counts, last, strict=True)]
        worst = max(steps, key=abs)
        if abs(worst) <= most:
            return ""
        before, found = (None, None) if self._tip is None else (self._tip(last), self._tip(counts))
        if before is not None and found is not None and dist(before, found) <= most * self._resolution_m:
            return ""
        return f"encoder {_NAMES[steps.index(worst)]} jumped by {worst:g} counts"

    def _astray(self, last: Sequence[float], counts: Sequence[float], most: float) -> bool:
        """Return True if the tip is further from its possible places than `most` counts."""
        if self._tip is None:
            return True
        likely = self._tip([old + joint.near for old, joint in zip(last, self._joints, strict=True)])
        found = self._tip(counts)
        return likely is None or found is None or dist(likely, found) > most * self._resolution_m
