"""Trial of a device's motors: one that runs with its force is let go for a moment, and how it goes on tells why.

A motor that pushes the wrong way turns the damping that a coupling renders into drive: the handle runs off, and the ledger
takes it for a hand that works hard. A hand that begins a quick stroke looks the same. They differ once the force is gone: a
hand that pushed against it gains speed, a handle that was driven by it gains no more.

Symbols, of blocks of BLOCK_S or longer, the newest with index 0: x place [m] at its end, d = x_0 - x_-1 displacement,
e = d / |d|, F mean force that loads the hand [N], m apparent mass [kg], T length of a block [s], a = e (d_0 - d_-1) / T^2
acceleration [m/s^2].

    suspected   e F and e d have grown by a factor of R or more in each of two blocks: R = QUICK from FIRST of the peak force
                on, SLOW from LATER on, and wherever a trial has said that the device is driven. And m a is at most HEAVY e F;
                or LIGHT e F, as a driven device has no more, where d grows by SUDDEN or more and steadily, as no hand does
    tried       the force is let go within a block: r = m (a_3 - a_0) / (e F_0) is what that made of the motion, 1 for a light
                hand that pushed, -1 for a motor that drove, and about 0 for a hand so stiff that it minds neither
    driven      r < -DRIVEN: the force is held to PROBATION of the peak force for WITHIN_S; a fault where such r, without
                one above PUSHED between, add up to -EVIDENCE, each -1 at most

Where the hand has pushed along an axis, its motor pushes back as it should: it is not suspected again. A wrong sign of a device
that a firm hand keeps from running is not seen here; `cogrip.devices.response` sees it.
"""

from collections.abc import Sequence
from math import hypot, inf, sqrt
from typing import Literal

from cogrip.devices.device import Capability
from cogrip.protocol.setting_types import PLACES

BLOCK_S = 8.0 / 1024.0
MOST_BLOCK_S = 2.0 * BLOCK_S
COUNTS = 4.0  # by which the least force is to move the device in a block
QUICK, FIRST = 1.2, 0.04
SLOW, LATER = 1.1, 0.08
LEAST_N = 0.3  # below, friction and counts decide how a handle moves
LEAST_COUNTS = 3.0  # in the newest block
HEAVY, LIGHT = 0.5, 1.2
SUDDEN, STEADY = 1.35, 0.85
ALONG = 0.7  # share of a force along the motion, of one that drives it
TRIAL_BLOCKS = 3  # in the first of them the force goes
DRIVEN, PUSHED = 0.45, 0.25
EVIDENCE = 1.5
PROBATION = 0.12
MOST_TRIALS = 5  # within WITHIN_S: a hand so stiff that nothing can be said is let be
WITHIN_S = 10.0
MAIN = 0.5  # part of a direction along an axis, from which on the axis takes part
AXES = "xyz"

Step = Literal["", "try", "end", "pushed"]


class MotorTrial:
    """Watches one device. Call `enter` each tick with force, and in each of a trial.

    trying  a trial is under way: the force is to be gone
    proved  axes along which a hand has pushed against the force
    fault   why the device must not be held, "" if it may
    ratios  r of each trial so far
    most_n  largest force until it is known whether the device is driven [N]; inf: any
    """

    __slots__ = (
        "_at", "_block", "_driven", "_force_n", "_gain_m", "_least_m", "_left", "_mass_kg", "_moved", "_n", "_peak_n",
        "_pushed_n", "_sums", "_tick", "_tick_s", "_tried", "_within", "fault", "most_n", "proved", "ratios", "trying",
    )  # fmt: skip

    def __init__(self, capability: Capability, tick_s: float) -> None:
        self._tick_s = tick_s
        self._within = round(WITHIN_S / tick_s)
        self.ratios: list[float] = []
        self.set_record(capability)

    def set_record(self, capability: Capability) -> None:
        """Begin anew, with another device record."""
        self._peak_n, self._mass_kg = capability.peak_force_n, capability.apparent_mass_kg
        least_n = max(LEAST_N, FIRST * self._peak_n)
        # time in which such a force moves it by COUNTS
        seen_s = sqrt(COUNTS * capability.resolution_m * self._mass_kg / least_n)
        self._n = max(2, round(min(MOST_BLOCK_S, max(BLOCK_S, seen_s)) / self._tick_s))
        self._least_m = LEAST_COUNTS * capability.resolution_m + 1e-6
        self.proved: set[int] = set()
        self.fault, self.most_n = "", inf
        self._tried: list[int] = []  # ticks of trials
        self._driven: list[tuple[int, float]] = []  # and, with their r, of those in which the device was driven
        self.forget()

    def forget(self) -> None:
        """Forget the blocks so far, and a trial that is under way."""
        self.trying = False
        self._tick = -1
        self._block = 0
        self._sums = [0.0] * PLACES
        self._at: list[Sequence[float]] = []
        self._force_n: list[list[float]] = []
        self._left = 0

    def enter(self, tick: int, position_m: Sequence[float], force_n: Sequence[float]) -> Step:
        """Add a tick: where the device is, and the force that it holds from now on [N]. Return what is to be done."""
        elapsed, self._tick = tick - self._tick, tick
        if elapsed != 1 and self._block and not self.trying:
            self.forget()
            self._tick = tick
        sums, axes = self._sums, min(PLACES, len(force_n))
        self._block += elapsed if self.trying else 1
        for axis in range(axes):
            sums[axis] += force_n[axis]
        if self._block < self._n:
            return ""
        self._at.append(position_m)
        self._force_n.append([part / self._block for part in sums])
        self._sums, self._block = [0.0] * PLACES, 0
        if self.trying:
            return self._try(tick)
        if len(self._at) < 4:
            return ""
        if self.most_n < inf and tick - self._driven[-1][0] > self._within:
            self._driven.clear()
            self.most_n = inf
        if not self._suspected(axes) or self._tries(tick) >= MOST_TRIALS:
            del self._at[0], self._force_n[0]
            return ""
        self.trying = True
        self._tried.append(tick)
        self._left = TRIAL_BLOCKS
        return "try"

    def held(self, force_n: Sequence[float]) -> Sequence[float]:
        """Return the force, at most `most_n` in size, in its direction."""
        size = hypot(*force_n)
        return force_n if size <= self.most_n else [part * (self.most_n / size) for part in force_n]

    def _tries(self, tick: int) -> int:
        """Return how many trials there were in the last WITHIN_S."""
        self._tried = [each for each in self._tried if tick - each < self._within]
        return len(self._tried)

    def _suspected(self, axes: int) -> bool:
        """Return whether motion and force have grown together, as of a device that its motors drive."""
        at, forces = self._at, self._force_n
        last = [at[-1][axis] - at[-2][axis] for axis in range(axes)]
        size = hypot(*last)
        if size < self._least_m:
            return False
        along = [part / size for part in last]
        newest = 0.0
        for axis in range(axes):
            newest += along[axis] * forces[-1][axis]
        if newest < max(LEAST_N, FIRST * self._peak_n) or newest < ALONG * hypot(*forces[-1]):
            return False
        if all(abs(along[axis]) < MAIN or axis in self.proved for axis in range(axes)):
            return False
        ratio = SLOW if newest >= LATER * self._peak_n or self._driven else QUICK
        self._moved, self._pushed_n = along, newest
        push, step, growths = newest, size, []
        for back in (2, 3):
            before_n = before_m = 0.0
            for axis in range(axes):
                before_n += along[axis] * forces[-back][axis]
                before_m += along[axis] * (at[-back][axis] - at[-back - 1][axis])
            if not (0.0 < ratio * before_n <= push and 0.0 < ratio * before_m <= step):
                return False
            growths.append(step / before_m)
            push, step = before_n, before_m
        self._gain_m = size * (1.0 - 1.0 / growths[0])
        block_s = self._n * self._tick_s
        share = self._mass_kg * self._gain_m / (newest * block_s * block_s)
        if share <= HEAVY:
            return True
        return share <= LIGHT and growths[1] >= SUDDEN and growths[0] >= STEADY * growths[1]

    def _try(self, tick: int) -> Step:
        self._left -= 1
        if self._left:
            return ""
        moved, at = self._moved, self._at
        gained = sum(part * (at[-1][axis] - 2.0 * at[-2][axis] + at[-3][axis]) for axis, part in enumerate(moved))
        block_s = self._n * self._tick_s
        ratio = self._mass_kg * (gained - self._gain_m) / (block_s * block_s * self._pushed_n)
        self.ratios.append(ratio)
        axes = [axis for axis in range(len(moved)) if abs(moved[axis]) >= MAIN]
        if ratio > PUSHED:
            self.proved.update(axes)
            self._driven.clear()
            self.most_n = inf
        elif ratio < -DRIVEN:
            self._driven = [each for each in self._driven if tick - each[0] < self._within] + [(tick, max(-1.0, ratio))]
            self.most_n = PROBATION * self._peak_n
            if sum(each[1] for each in self._driven) <= -EVIDENCE:
                self.fault = self._cause(axes)
        self.forget()
        return "pushed" if ratio > PUSHED else "end"

    def _cause(self, axes: Sequence[int]) -> str:
        names = [AXES[axis] for axis in axes]
        if len(names) == 1:
            what = f"along {names[0]}, so the sign of its motor or of its encoder there is wrong"
        else:
            named = f"{', '.join(names[:-1])} and {names[-1]}"
            what = f"along {named} at once, so these axes are swapped, or their signs are wrong"
        return f"the device runs with its force {what}; see `cogrip devices conform` and docs/devices.md, then re-arm"
