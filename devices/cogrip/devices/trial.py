"""Trials of a device in a person's hand, short and weak: which way its axes count, and how stiff a spring feels on it.

Symbols: x tip [m], x_0 where the trial began, d = x - x_0, F force that loads the hand [N], F_m its largest size, K
stiffness [N/m].

    F = K d, at most F_m, and rising over RISE_S             felt: K_f = sum F d / sum d^2, of ticks with the whole force

F is what `write` says acts, so K_f is the driver's, from its encoders to its motors' limits; what a hand feels of an arm's own
friction and mass is not in it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot

from cogrip.devices.device import Capability, Device, Sample
from cogrip.machine.addition import add_floats

RATE_HZ = 1024
AXES = ("x", "y", "z")
TOWARD = ("toward you", "to your right", "up")  # directions in which the axes grow
MOVED_M = 0.02  # least distance by which a tip has been moved, and not only held
SIGN_S = 20.0  # longest wait for a motion along an axis
RISE_S = 0.3
SPRING_S = 5.0
STIFFEST_NPM = 200.0
MOST_N = 1.0
LEAST_MOVED_M = 0.002
SILENT_S = 0.02  # longest time without a sample; after it the spring ends
SPEED_TICKS = 16

Clock = Callable[[int], int]
"""Tick -> the newest tick that is due, once that tick is."""

Show = Callable[[Sample], None]


@dataclass(frozen=True, slots=True)
class Moved:
    """An axis, 0 to 2, along which the tip was moved most, and which way: 1 or -1."""

    axis: int
    sense: int

    def is_right(self, axis: int) -> bool:
        """Return whether it is what a motion along `axis` should be."""
        return self.axis == axis and self.sense > 0


def moved(begun_m: Sequence[float], now_m: Sequence[float]) -> Moved | None:
    """Return the axis along which the tip has moved most, None for less than MOVED_M."""
    away = [now - begun for now, begun in zip(now_m[: len(AXES)], begun_m, strict=False)]
    axis = max(range(len(away)), key=lambda each: abs(away[each]))
    return Moved(axis, 1 if away[axis] > 0.0 else -1) if abs(away[axis]) >= MOVED_M else None


def watch(device: Device, clock: Clock, show: Show) -> Moved | None:
    """Return along which axis somebody moves an open device, None where nobody does for SIGN_S. Without force."""
    begun: Sample | None = None
    none = (0.0,) * device.capability.axes
    tick, last = -1, round(SIGN_S * RATE_HZ)
    while (tick := clock(tick + 1)) < last:
        sample = device.read(tick)
        device.write(none)
        if sample is None:
            continue
        begun = begun or sample
        show(sample)
        if found := moved(begun.position_m, sample.position_m):
            return found
    return None


@dataclass(frozen=True, slots=True)
class FeltSpring:
    """Answer of a spring: stiffness asked for and felt [N/m], 0 where the tip was moved too little; why it ended early."""

    asked_npm: float
    felt_npm: float
    most_m: float
    most_n: float
    ended: str = ""


class Spring:
    """The law of the spring trial. ended: why it gives no force any more."""

    def __init__(self, record: Capability) -> None:
        self.stiffness_npm = min(STIFFEST_NPM, 0.25 * record.stiffness_npm)
        self.most_n = min(MOST_N, record.continuous_force_n, 0.5 * record.peak_force_n)
        self.ended = ""
        self._record = record
        self._begun: tuple[int, tuple[float, ...]] | None = None
        self._passed: list[tuple[int, tuple[float, ...]]] = []
        self._sample_tick = 0
        self._away: tuple[float, ...] = ()
        self._whole = False
        self._work = self._square = self._most_m = self._most_n = 0.0

    def force_n(self, tick: int, sample: Sample | None) -> tuple[float, ...]:
        """Return the force at `tick`."""
        none = (0.0,) * self._record.axes
        self._whole = False
        if sample is None:
            if self._begun and tick - self._sample_tick > SILENT_S * RATE_HZ:
                self.ended = self.ended or "no samples"
            return self._load(tick)
        self._sample_tick = tick
        at = sample.position_m[: len(AXES)]
        self._begun = self._begun or (tick, at)
        self._judge(tick, at)
        self._away = tuple([now - begun for now, begun in zip(at, self._begun[1], strict=True)])
        return self._load(tick) if not self.ended else none

    def _load(self, tick: int) -> tuple[float, ...]:
        if self.ended or not self._begun:
            return (0.0,) * self._record.axes
        rise = (tick - self._begun[0]) / (RISE_S * RATE_HZ)
        asked = self.stiffness_npm * hypot(*self._away)
        share = min(1.0, rise) * (min(1.0, self.most_n / asked) if asked else 1.0)
        self._whole = share == 1.0
        force = [share * self.stiffness_npm * d for d in self._away]
        return (*force, *(0.0,) * (self._record.axes - len(force)))

    def _judge(self, tick: int, at: tuple[float, ...]) -> None:
        """End it where the tip leaves the workspace, or moves as no hand in a trial does."""
        inside = all(low <= x <= high for x, (low, high) in zip(at, self._record.workspace_m, strict=False))
        if not inside:
            self.ended = self.ended or "the tip left the workspace"
        self._passed.append((tick, at))
        then, there = self._passed[0]
        if tick - then >= SPEED_TICKS:
            self._passed.pop(0)
            if hypot(*[x - y for x, y in zip(at, there, strict=True)]) * RATE_HZ > self._record.speed_mps * (
                tick - then
            ):
                self.ended = self.ended or "the tip moved too fast"

    def acted(self, force_n: Sequence[float]) -> None:
        """Take the force that acts since the tick of the last `force_n`."""
        away = self._away
        self._most_n = max(self._most_n, hypot(*force_n))
        if self._whole:
            self._work += add_floats(f * d for f, d in zip(force_n, away, strict=False))
            self._square += add_floats(d * d for d in away)
            self._most_m = max(self._most_m, hypot(*away))

    @property
    def felt(self) -> FeltSpring:
        """Return the answer so far."""
        enough = self._most_m >= LEAST_MOVED_M
        return FeltSpring(
            self.stiffness_npm, self._work / self._square if enough else 0.0, self._most_m, self._most_n, self.ended
        )


def feel(device: Device, clock: Clock, show: Show) -> FeltSpring:
    """Hold an open device with a weak spring for SPRING_S. Raises DeviceError, with no force left to be asked for."""
    spring, none = Spring(device.capability), (0.0,) * device.capability.axes
    tick, last = -1, round(SPRING_S * RATE_HZ)
    try:
        while (tick := clock(tick + 1)) < last and not spring.ended:
            sample = device.read(tick)
            asked = spring.force_n(tick, sample)
            told = device.write(asked)
            spring.acted(asked if told is None else told)
            if sample is not None:
                show(sample)
    finally:
        device.write(none)
    return spring.felt
