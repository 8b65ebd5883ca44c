"""Safety between the force law and the motors: no force of the law reaches a hand unlimited.

    idle --open--> calibrating --calibrated--> armed --go--> live <--stale / fresh--> degraded
    live --clutch--> clutched --engage--> live    clutched --stale--> degraded
    any but idle --fail--> fault (latched until --rearm--> armed)          any --stop--> idle

A seat is idle until its device is open, calibrating until the device has given a first sample, at which the line begins, and
armed until the next force is made. Only `live` lets force through. On entry to `live` the force is ramped in over RAMP_IN_S;
on leaving it is ramped out over RAMP_OUT_S, after a fault over FAULT_OUT_S. The force is clamped to the device's peak keeping
its direction, as its motors warm to its continuous force (`thermal`); its change is clamped to the device's slope, never
above MOST_SLOPE_NPS; where waves are missing to SOFT_SLOPE_NPS, because a law without its wave jumps (`force_limits`).
Torque, and the force of a gripper, have limits of their own. The energy ledger counts the forces after these limits
(docs/decisions/0004-leaks.md).
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from math import hypot, inf, isfinite, sqrt
from typing import Literal, get_args

from cogrip.client.rows.row_size import surely_below
from cogrip.client.safety.force_limits import ForceBounds, ForceLimits, bounds_of
from cogrip.client.safety.thermal import ThermalLimit
from cogrip.devices.device import Capability
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES

RAMP_IN_S = 0.3
RAMP_OUT_S = 0.1
FAULT_OUT_S = 0.015
STALL_S = 0.02  # time without a sample, in a leaky counter, after which a device has stalled
STALL_DECAY = 0.5  # ticks that each sample takes off the counter of STALL_S
WATCHDOG_S = 0.1  # time without a tick after which the watchdog ends the force: the hand held an old one
LET_GO_S = 0.01
"""Time without any acting force after which a device has let go, and takes the force back by the ramp."""
AT_LIMIT_S = 0.5  # time at its limit after which a force is saturated: a fault
NEAR_THERMAL_LIMIT = "near thermal limit"  # reason that is counted before anything is limited
DERATED_S = 10.0  # time of thermal derating, in a counter that falls while there is none, after which it is a fault

DRIVES = "if the device drives itself, `cogrip devices conform` tells a wrong sign or gain"
"""Advice after a fault that a device with a wrong sign brings about as well as a hand."""
SLOWER = f"slow down, then re-arm; {DRIVES}"

State = Literal["idle", "calibrating", "armed", "live", "clutched", "degraded", "fault"]
Transition = Literal["open", "calibrated", "go", "stale", "fresh", "clutch", "engage", "rearm", "fail", "stop"]
STATES: tuple[State, ...] = get_args(State)
CLUTCH: tuple[Transition, ...] = ("clutch", "engage")
TRANSITIONS: Mapping[tuple[State, Transition], State] = {
    ("idle", "open"): "calibrating", ("calibrating", "calibrated"): "armed", ("armed", "go"): "live",
    ("live", "stale"): "degraded", ("degraded", "fresh"): "live", ("fault", "rearm"): "armed",
    ("live", "clutch"): "clutched", ("clutched", "engage"): "live", ("clutched", "stale"): "degraded",
    ("clutched", "fail"): "fault", ("clutched", "stop"): "idle",
    ("calibrating", "fail"): "fault", ("armed", "fail"): "fault", ("live", "fail"): "fault", ("degraded", "fail"): "fault",
    ("calibrating", "stop"): "idle", ("armed", "stop"): "idle", ("live", "stop"): "idle", ("degraded", "stop"): "idle",
    ("fault", "stop"): "idle",
}  # fmt: skip
IGNORED: frozenset[tuple[State, Transition]] = frozenset({
    ("idle", "stop"), ("idle", "fail"), ("fault", "fail"),  # the first reason is kept
    *((state, "stale") for state in STATES if (state, "stale") not in TRANSITIONS),  # no force is there to be taken
    *((state, "rearm") for state in STATES if state != "fault"),
    # where no force is let through a clutch is held, and let go, without a transition
    *((state, name) for state in STATES for name in CLUTCH if (state, name) not in TRANSITIONS),
})  # fmt: skip
"""Events that change nothing in a state. Every other one that has no transition from it is a defect."""


class Safety:
    """One device's limits and state. `limit` once a tick; forces are shape (axes,) [N].

    gain       of the ramp, 0 to 1
    clamped_n  force of this tick before ramp and slope limit, clamped to the device's peak
    limited    whether a limit held the force of this tick: peak, warm motors or slope; `derated` whether warm motors did
    unstable   how the force was unstable: it oscillated, was not finite, or took energy out without end; "" if it was not
    saturated  how the force sat at the device's limit until it was let go, "" if it did not
    left       how the hand left the device's workspace, "" if it did not
    """

    def __init__(self, capability: Capability, tick_s: float, length_scale: float = 1.0) -> None:
        """length_scale: of the seat, by which the axes after the first three become lengths (`Coupling.length_scale`)."""
        self._length_scale = length_scale
        sizes = (min(capability.axes, PLACES), capability.axes - PLACES)
        self._groups = [
            ForceLimits(bounds, axes, tick_s, self.note)
            for bounds, axes in zip(bounds_of(capability, length_scale), sizes, strict=False)
        ]
        self._translation, self._further = self._groups[0], self._groups[1] if len(self._groups) > 1 else None
        self.set_record(capability)
        self._rise = tick_s / RAMP_IN_S
        self._fall = tick_s / RAMP_OUT_S
        self._fault_fall = tick_s / FAULT_OUT_S
        self._stall_ticks = max(1, round(STALL_S / tick_s))
        self._watchdog_ticks = max(1, round(WATCHDOG_S / tick_s))
        self._limit_ticks = round(AT_LIMIT_S / tick_s)
        self._derated_ticks = round(DERATED_S / tick_s)
        self._let_go_ticks = max(2, round(LET_GO_S / tick_s))
        self.gain = 0.0
        self.clamped_n: Sequence[float] = (0.0,) * capability.axes
        self._absent = 0.0
        self._at_limit = 0
        self._derated = 0
        self._let_go = 0  # ticks in which nothing acted, less those in which something did, and one more
        self.limited = self.derated = False
        self.state: State = "idle"
        self.reason = self.warning = ""
        self.unstable = self.saturated = self.left = ""
        self.counts: Counter[str] = Counter()

    def set_record(self, capability: Capability) -> None:
        """Set the device record."""
        for group, bounds in zip(self._groups, bounds_of(capability, self._length_scale), strict=True):
            group.set_bounds(bounds)
        self._speed_mps = capability.speed_mps
        self._workspace_m = capability.workspace_m

    @property
    def thermal(self) -> ThermalLimit:
        """Thermal limit of the force."""
        return self._translation.thermal

    def note(self, name: str) -> None:
        """Count an event by name."""
        self.counts[name] += 1

    def event(self, name: Transition, reason: str = "") -> bool:
        """Make a transition of TRANSITIONS. Return False for an event of IGNORED. Raises ValueError for any other."""
        after = TRANSITIONS.get((self.state, name))
        if after is None:
            if (self.state, name) not in IGNORED:
                raise ValueError(f"{name!r} has no transition from {self.state!r}")
            return False
        self.state = after
        if reason or after in ("armed", "live"):
            self.reason = reason
        if name == "rearm":
            self.gain = self._absent = 0.0
            self._at_limit = self._derated = 0  # the motors are as warm as they are
        return True

    def ramp_anew(self) -> None:
        """Ramp the force in from 0, because the law has changed while the hand holds the device."""
        self.gain = 0.0
        for group in self._groups:
            group.soften()

    def fail(self, reason: str) -> None:
        """Latch a fault; the first reason is kept."""
        if self.event("fail", reason):
            self.note("fault")

    def at_peak(self) -> bool:
        """Return whether the law's force is above the device's peak (not where warm motors alone limit it)."""
        return self._at_limit > 0

    @property
    def quiet(self) -> bool:
        """True once no force is left on the hand."""
        return self.gain == 0.0 and not any(any(group.out) for group in self._groups)

    def absent(self, ticks: int) -> None:
        """Count `ticks` more ticks without a sample; enough of them are a fault."""
        if not ticks:
            return  # the first tick of a device that answers a request of the tick before
        self._absent += ticks
        self._hold(ticks)
        self.note("absent sample")
        if self._absent >= self._stall_ticks:
            span = f"more than {STALL_S * 1e3:g} ms"
            self.fail(f"device stall: {span} without samples; check its cable and power, then re-arm")

    def check(self, ticks: int, position_m: Sequence[float], velocity_mps: Sequence[float]) -> bool:
        """Check a sample that came `ticks` ticks after the last one. Returns False where it must not be used."""
        if self._absent:
            self._absent = max(0.0, self._absent - STALL_DECAY)
        if ticks > 1:
            self._hold(ticks)
        square = other = 0.0
        if len(velocity_mps) == PLACES:  # as below, without a loop
            (x, y, z), (at_x, at_y, at_z) = velocity_mps, position_m
            square, place = x * x + y * y + z * z, at_x + at_y + at_z
        else:
            place = add_floats(position_m)
            for speed in velocity_mps if self._further is None else velocity_mps[:PLACES]:
                square += speed * speed
        if self._further is not None:
            other = add_floats([speed * speed for speed in velocity_mps[PLACES:]])
        if not isfinite(square + other + place):
            self.note("non-finite sample")
            self.fail("the device gave a number that is not finite; re-arm once it is well")
            return False
        if ticks >= self._watchdog_ticks:
            self.fail(f"watchdog: the loop was away for {ticks} ticks; see `cogrip doctor`, then re-arm")
        if square > self._speed_mps * self._speed_mps:
            self.fail(f"over-speed: {sqrt(square):.2f} m/s is above {self._speed_mps:g} m/s; {SLOWER}")
        if self._further is not None:
            self._check_further(self._further.bounds, sqrt(other), position_m[-1])
        for axis, (low, high) in enumerate(self._workspace_m):  # angles have none
            place = position_m[axis]
            if not low <= place <= high:
                self.left = self.left or f"the hand left the workspace at {place:.4g} m"
        return True

    def _check_further(self, bounds: ForceBounds, speed_mps: float, last_m: float) -> None:
        """Check the axes after the first three: their speed, and the opening of a gripper."""
        if speed_mps > bounds.speed_mps:
            speeds, unit = [speed / bounds.per_unit for speed in (speed_mps, bounds.speed_mps)], bounds.rate_unit
            self.fail(f"over-speed: {speeds[0]:.2f} {unit} is above {speeds[1]:g} {unit}; {SLOWER}")
        if bounds.range_m is not None and not bounds.range_m[0] <= last_m <= bounds.range_m[1]:
            low, at, high = [1e3 / bounds.per_unit * each for each in (bounds.range_m[0], last_m, bounds.range_m[1])]
            self.note("implausible opening")
            self.fail(
                f"the gripper's opening of {at:.4g} mm is out of {low:.4g} to {high:.4g} mm; check its sensor, then re-arm"
            )

    def coming_gain(self, wished: bool = True) -> float:
        """Return the gain of the next `limit`. wished: whether the force law gives a force."""
        if self.state == "live" and wished:
            return min(1.0, self.gain + self._rise)
        return max(0.0, self.gain - (self._fault_fall if self.state == "fault" else self._fall))

    def limit(self, force_n: Sequence[float] | None, gap: bool = False) -> tuple[float, ...]:
        """Return the force for the motors. force_n: the law's, or None; gap: whether the law's wave is missing."""
        gain = self.gain
        if self._let_go:
            self._let_go -= 1
        if gain != 1.0 or self.state != "live" or force_n is None:
            self.gain = gain = self.coming_gain(force_n is not None)
        translation, further = self._translation, self._further
        translation.limited = translation.derated = translation.over = False
        if further is not None:
            further.limited = further.derated = further.over = False
        if force_n is not None:
            if further is None and surely_below(force_n, translation.thermal.limit_n):
                self.clamped_n = force_n
            else:
                self._clip(force_n)
        out = tuple(self.clamped_n) if gain == 1.0 else tuple([gain * value for value in self.clamped_n])
        fall = self._fault_fall if self.state == "fault" else 0.0  # also for a fault that this call has found
        if further is None:
            out = translation.follow(out, gap, fall)
            over, self.limited, self.derated = translation.over, translation.limited, translation.derated
            warm = translation.thermal.warm
        else:
            out = translation.follow(out[:PLACES], gap, fall) + further.follow(out[PLACES:], gap, fall)
            over = translation.over or further.over
            self.limited, self.derated = translation.limited or further.limited, translation.derated or further.derated
            warm = translation.thermal.warm or further.thermal.warm
        if over:
            self._clipped(gain)
        else:
            self._at_limit = 0
        if warm or self.warning or self.derated or self._derated:
            self._warm()
        return out

    def _clip(self, force_n: Sequence[float]) -> None:
        """Set `clamped_n`, the law's force within the limits of peak and warm motors; one that is not finite is a fault."""
        size_n = hypot(*force_n) if len(force_n) > 1 else abs(force_n[0])
        if not size_n < inf:  # nan, too
            self.note("non-finite force")
            self.unstable = self.unstable or "the force law gave a number that is not finite"
            self.fail("the force law gave a number that is not finite; re-arm")
        elif self._further is None:
            self.clamped_n = self._translation.clip(force_n, size_n)
        else:
            force, rest = force_n[:PLACES], force_n[PLACES:]
            self.clamped_n = [*self._translation.clip(force, hypot(*force)), *self._further.clip(rest, hypot(*rest))]

    def _parts(self, force_n: Sequence[float]) -> Sequence[Sequence[float]]:
        """Return the part of a force of each group of axes."""
        return (force_n,) if len(self._groups) == 1 else (force_n[:PLACES], force_n[PLACES:])

    def applied(self, force_n: tuple[float, ...]) -> None:
        """Set the force that the device applies in place of the one that `limit` returned: slope and heat go by this one.

        Once the force has ramped out the slope goes by what `limit` returned: a device whose cable is out reports its last
        force for ever, and must be asked for zero all the same.

        A device that applies nothing for LET_GO_S has let go: its force comes back by the ramp, and not at once.
        """
        self.note("force limited by the device")
        nothing = not any(force_n) and any(any(group.out) for group in self._groups)
        for group, part in zip(self._groups, self._parts(force_n), strict=True):
            group.correct(tuple(part), self.gain > 0.0)
        if nothing:
            self._let_go = min(self._let_go + 2, self._let_go_ticks + 1)
            if self._let_go > self._let_go_ticks:
                if self.gain > self._rise:
                    self.note("device let go")
                self.gain = 0.0

    def _hold(self, ticks: int) -> None:
        """Heat the motors' model by ticks that were skipped: the last force was held over them, too."""
        for _ in range(1, min(ticks, self._watchdog_ticks)):
            for group in self._groups:
                group.enter()

    def _warm(self) -> None:
        """Warn before warm motors limit the force; fail where they do for long."""
        if warm := [group.bounds for group in self._groups if group.thermal.warm]:
            if not self.warning:
                self.note(NEAR_THERMAL_LIMIT)
                least = warm[0].shown(warm[0].continuous_n)
                self.warning = f"the motors get warm: soon no more than {least}; hold less, or rest"
        else:
            self.warning = ""
        if self.derated:
            self.note("thermally limited")
            self._derated += 1
            if self._derated > self._derated_ticks:
                bounds = next(group.bounds for group in self._groups if group.derated)
                most = bounds.shown(bounds.continuous_n)
                asked = f"the motors were asked for more than their {most} for {DERATED_S:g} s while warm"
                self.fail(f"{asked}; hold less and let them cool, then re-arm")
        elif self._derated:
            self._derated -= 1

    def _clipped(self, gain: float) -> None:
        self.note("force clipped")
        self._at_limit = self._at_limit + 1 if gain == 1.0 else 0  # a force that is ramped is not at its limit
        if self._at_limit > self._limit_ticks:
            bounds = next(group.bounds for group in self._groups if group.over)
            reason = f"the force sat at its limit of {bounds.shown(bounds.peak_n)} for {AT_LIMIT_S:g} s"
            self.saturated = self.saturated or reason
            self.fail(f"{reason}; press less or lower coupling.stiffness_npm, then re-arm")
