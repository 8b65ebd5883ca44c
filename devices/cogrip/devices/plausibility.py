"""Samples, and reports of the acting force, that no held device gives: a position that jumps, an age that grows, a velocity
that its positions deny, a force that nobody asked for.

Symbols: x position [m], v velocity [m/s], T tick [s], t time since the last sample that was used [s], w window [s],
m apparent mass [kg] and F_peak peak force [N] of the device record.

    jump      A held handle goes on as it did, or stops anywhere on the way, or bounces back. Beyond that it is brought off its
              course by the hand, with at most HAND_MPS2 up to HAND_MPS of added speed, and by the motors, with F_peak / m. The
              speed is known from the last steps, so it is old, by l = (1 + N)/2 ticks: |off| <= r(t), of dr/dt = dv(t + l).
    velocity  Two sums that forget with w: of x_k - x_{k-1} - v T, which a filter's lag of 0.4 w leaves below 0.6 w times the
              top speed of the last 2 w; and of |v| T less thrice the path, for a velocity that only shakes.

Loops are uneven: a tick may run up to one period late, so every step may be one tick longer than counted, or one shorter.
The course is a sum of steps, each of which halves the ones before, over the ticks N of the same sum: of these, one may be
missing.
"""

from collections import deque
from collections.abc import Sequence
from math import hypot, isfinite, sqrt

from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES, POSE_AXES

HAND_MPS2 = 200.0  # peak acceleration of what a hand holds; recorded strokes stay below 100
HAND_MPS = 0.6  # speed that a hand, or a blow, adds to a handle within a few milliseconds
REBOUND = 0.5  # share of the speed that an end stop gives back
UNKNOWN_MPS = 1.5  # largest speed of a device whose steps do not tell its speed yet
SLACK_COUNTS = 4.0
GAP_S = 0.02  # longest time without a sample after which the speed is still known; an older sample is not used
STEADY = 2.0  # N where every step is one tick
JUMPS = 3.0  # implausible samples, less half of the plausible ones, that are a fault
WINDOW_S = 0.05
DRIFT_SHARE = 0.6
DRIFT_SLACK_M = 3e-4
PATH_SLACK_M, PATH_SLACK_COUNTS = 2e-3, 20.0
REPORT_S = 0.03  # age of the oldest force that may still act: a request was held back, and was made again
REPORT_SLACK = 0.02  # allowance for a reported force, as a fraction of the peak force
REPORTS = 3.0  # implausible reports, less half of the plausible ones, that are a fault

NOTHING = (0.0,) * POSE_AXES

JUMP, AGE, OLD, DRIFT = "implausible jump", "implausible age", "old sample", "velocity against position"
REPORT = "implausible force reported"


def off_course_m(time_s: float, late_s: float, most_mps2: float, most_mps: float = HAND_MPS) -> float:
    """Return the largest deviation [m] after `time_s` from the course of a speed that is `late_s` old.

    The speed gained is most_mps2 (t + late_s), at most most_mps.
    """
    rising_s = min(time_s, max(0.0, most_mps / most_mps2 - late_s))
    return most_mps2 * rising_s * (0.5 * rising_s + late_s) + most_mps * (time_s - rising_s)


class Plausibility:
    """Judges the samples of one device. Plain sums, no clock: time is that of the ticks at which samples were taken."""

    def __init__(self, capability: Capability, tick_s: float) -> None:
        self._tick_s = tick_s
        self._half_tick_s = 0.5 * tick_s
        self._kept = max(0.0, 1.0 - tick_s / WINDOW_S)  # of the drift, in a tick
        self._motors_mps2 = capability.peak_force_n / capability.apparent_mass_kg
        self._slack_m = SLACK_COUNTS * capability.resolution_m + 1e-6
        self._drift_m = DRIFT_SLACK_M + SLACK_COUNTS * capability.resolution_m
        self._path_m = PATH_SLACK_M + PATH_SLACK_COUNTS * capability.resolution_m
        self._gap_ticks = max(1, round(GAP_S / tick_s))
        self._most_age = capability.latency_ticks + self._gap_ticks
        self._axes = capability.axes
        self._tick: int | None = None  # at which a sample was judged
        self._quick = self._most_m(tick_s, 1.5 * tick_s) ** 2  # a step of one tick that is no jump at any speed [m^2]
        self.restart()

    def restart(self) -> None:
        """Forget where the device was: the next sample is taken as it is."""
        self._at: Sequence[float] | None = None
        self._taken = 0
        self._step, self._last = list(NOTHING), list(NOTHING)  # newest step of each axis [m], and its speed [m/s]
        self._ran = list(NOTHING)  # the last step, half of the one before, a quarter ... [m]
        self._ran_ticks = 0.0  # N, the ticks of this sum; 0: nothing is known
        self._odd = 0  # ticks from the last sample that was used to the first one after it that was not
        self._jumps = 0.0
        self._reported: Sequence[float] | None = None
        self._reported_mps = 0.0  # its length
        self._drift = list(NOTHING)
        self._path = self._top = 0.0
        self.fault = ""

    def judge(self, tick: int, sample: Sample) -> str:
        """The name under which this sample of `tick` is not to be used, "" if it may be. `fault` says why it ends the force."""
        position, age = sample.position_m, sample.age_ticks
        last, self._tick = self._tick, tick
        self.fault = ""
        if not 0 <= age <= self._most_age + (0 if last is None else tick - last):
            return AGE
        taken, before = tick - age, self._at
        if before is None:
            if isfinite(add_floats(position)):
                self._at, self._taken, self._reported = position, taken, sample.velocity_mps
                self._reported_mps = hypot(*sample.velocity_mps) if sample.velocity_mps else 0.0
            return ""
        ticks = taken - self._taken
        if ticks <= 0:
            return OLD if ticks < 0 or tick != last else ""
        square, step = 0.0, self._step
        if len(position) == PLACES:  # as below, without a loop
            (x, y, z), (then_x, then_y, then_z) = position, before
            step[0], step[1], step[2] = x, y, z = x - then_x, y - then_y, z - then_z
            square = x * x + y * y + z * z
        else:
            for axis in range(self._axes):
                step[axis] = moved = position[axis] - before[axis]
                square += moved * moved
        if square < self._quick and ticks == 1:
            self._jumps = max(0.0, self._jumps - 0.5) if self._jumps else 0.0
        elif not isfinite(square):
            return ""  # safety's matter
        elif self._jumped(ticks):
            return JUMP
        self._move(ticks)
        self._at, self._taken = position, taken
        reported = sample.velocity_mps
        return "" if reported is None else self._denied(reported, ticks)

    def _jumped(self, ticks: int) -> bool:
        """A sample that comes after one that was odd is not believed more readily because time has passed."""
        tick_s, fewest = self._tick_s, self._ran_ticks - 1.0
        known = fewest > 0.0 and ticks <= self._gap_ticks
        rate = 1.0 / (fewest * tick_s) if known else 0.0
        ahead_s, behind_s = (ticks + 1) * tick_s, -REBOUND * ticks * tick_s
        square = 0.0
        for axis in range(self._axes):
            moved = self._step[axis]
            if known:
                speed, last = rate * self._ran[axis], self._last[axis]
                high, low = (speed, last) if speed > last else (last, speed)
                high, low = max(0.0, ahead_s * high, behind_s * low), min(0.0, ahead_s * low, behind_s * high)
            else:
                high = ahead_s * UNKNOWN_MPS
                low = -high
            off = moved - high if moved > high else low - moved if moved < low else 0.0
            square += off * off
        late_s = 0.5 * (1.0 + max(STEADY, self._ran_ticks)) * tick_s
        off_m, most_m = sqrt(square), self._most_m((self._odd or ticks) * tick_s, late_s)
        if off_m <= most_m:
            self._odd, self._jumps = 0, max(0.0, self._jumps - 0.5)
            return False
        self._odd = self._odd or ticks
        self._jumps += 1.0
        if self._jumps >= JUMPS:
            self.fault = (
                f"the position jumped: {_length(self._step, self._axes) * 1e3:.1f} mm in {ticks * tick_s * 1e3:.1f} ms,"
                f" {off_m * 1e3:.1f} mm off its course, and {most_m * 1e3:.2g} mm is the most a hand does; check the"
                " encoders and their cables, then re-arm"
            )
        return True

    def _most_m(self, time_s: float, late_s: float) -> float:
        """Return the plausible deviation [m] from its course, by the hand, the motors and the encoder's resolution."""
        motors_m = self._motors_mps2 * time_s * (0.5 * time_s + late_s)
        return self._slack_m + off_course_m(time_s, late_s, HAND_MPS2) + motors_m

    def _move(self, ticks: int) -> None:
        """Add the step to the course that is known; over a gap none is."""
        rate, step, last, ran = 1.0 / (ticks * self._tick_s), self._step, self._last, self._ran
        if ticks == 1 and self._axes == PLACES:  # as below, without a loop
            x, y, z = step[0], step[1], step[2]
            last[0], last[1], last[2] = x * rate, y * rate, z * rate
            ran[0], ran[1], ran[2] = 0.5 * ran[0] + x, 0.5 * ran[1] + y, 0.5 * ran[2] + z
            self._ran_ticks = 0.5 * self._ran_ticks + 1.0
            return
        known = ticks <= self._gap_ticks
        for axis in range(self._axes):
            moved = step[axis]
            last[axis] = moved * rate
            ran[axis] = 0.5 * ran[axis] + moved if known else 0.0
        self._ran_ticks = 0.5 * self._ran_ticks + ticks if known else 0.0

    def _denied(self, reported: Sequence[float], ticks: int) -> str:
        """DRIFT, where what the velocities add up to is not what the positions say."""
        before, self._reported = self._reported, reported
        slow, self._reported_mps = self._reported_mps, hypot(*reported)
        if before is None or ticks > self._gap_ticks or not isfinite(add_floats(reported)):
            return ""
        half_s, keep, drift = self._half_tick_s, self._kept, self._drift
        if ticks != 1:
            half_s, keep = ticks * half_s, max(0.0, 1.0 - ticks * self._tick_s / WINDOW_S)
        for axis in range(self._axes):
            drift[axis] = keep * drift[axis] + self._step[axis] - half_s * (before[axis] + reported[axis])
        speed = self._reported_mps
        self._path = path = keep * self._path + half_s * (slow + speed) - 3.0 * _length(self._step, self._axes)
        moves = _length(self._ran, self._axes) / (self._ran_ticks * self._tick_s)
        self._top = top = max(0.5 * (1.0 + keep) * self._top, speed, moves)
        off_m = _length(drift, self._axes)
        if off_m <= self._drift_m + DRIFT_SHARE * WINDOW_S * top and path <= self._path_m:
            return ""
        self.fault = (
            f"the device's velocity, {speed:.3g} m/s now, and its positions deny each other by"
            f" {max(off_m, self._path) * 1e3:.1f} mm in {WINDOW_S * 1e3:g} ms; check the driver and the encoders, then re-arm"
        )
        return DRIFT


def _length(row: Sequence[float], axes: int) -> float:
    return hypot(*[row[axis] for axis in range(axes)])


class ForceReports:
    """Judges what `Device.write` says that acts: a part of what was asked now, or lately.

    asked  to be called with each force [N], shape (axes,), that is being written
    """

    def __init__(self, capability: Capability, rate_hz: int) -> None:
        self._slack_n = REPORT_SLACK * capability.peak_force_n
        self._asked: deque[Sequence[float]] = deque(maxlen=max(2, round(REPORT_S * rate_hz)))
        self.asked = self._asked.append
        self._odd = 0.0
        self.fault = ""

    def judge(self, acting_n: Sequence[float]) -> str:
        """REPORT, where this cannot be what acts; "" if it may be. `fault` says why it ends the force, once it goes on."""
        self.fault = ""
        if any(self._fits(acting_n, force_n) for force_n in reversed(self._asked)):
            self._odd = max(0.0, self._odd - 0.5)
            return ""
        self._odd += 1.0
        if self._odd >= REPORTS:
            asked = ", ".join(f"{part:.3g}" for part in self._asked[-1])
            self.fault = (
                f"says that {tuple(acting_n)} N acts where ({asked}) N was asked; correct what the driver's write returns,"
                " then re-arm"
            )
        return REPORT

    def _fits(self, acting_n: Sequence[float], force_n: Sequence[float]) -> bool:
        """Each axis has a part of its force, from none to all of it."""
        slack = self._slack_n
        return len(acting_n) == len(force_n) and all(
            min(0.0, asked) - slack <= part <= max(0.0, asked) + slack
            for part, asked in zip(acting_n, force_n, strict=True)
        )
