"""Trial of a device by small forces: whether it moves as its record says, and where it does not, how.

A known force pushes it to and fro, an axis at a time, while nobody holds it, or somebody does lightly. Nobody else pushes just
so: what moves with the force is what the force moves.

Symbols: F force that loads the hand along axis j [N], x_i place along axis i [m], m apparent mass [kg] and L age of a sample
[ticks] by the record, g_i gain of the motion along i (1 for i = j and 0 else if all is well), l ticks by which samples are
later than they say, B and K damping [N s/m] and stiffness [N/m] of whoever holds it, c friction [N], p a polynomial of degree
DEGREE for slow forces.

    m x_i'' = -g_i F - B x_i' - K x_i - c sgn x_i' + p''(t)      and, twice integrated,
    x_i = -g_i u / m - B / m int x_i - K / m int int x_i - c / m int int sgn x_i' + p

with u'' = F, u taken l ticks later. g_i by least squares, l that of the best fit. Motor gain, position gain and mass act alike
on g_i: a gain of 2 says that one of them is twice, or half, of what it should be. A single tick of l is told apart from
friction only where the device has little.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cogrip.devices.device import Capability, Device

RATE_HZ = 1024
FIRST_N = 0.2
MOST_SHARE = 0.2  # A trial pushes with this share of the peak force at most.
MOST_N = 1.0
STROKE_TICKS = 36
PATTERN = (1, -1, -1, 1, -1, 1, 1, -1)  # directions of the strokes: after each four the device is where it was, at rest
BEFORE_TICKS, AFTER_TICKS = 60, 20  # ticks without force before and after the strokes
WARMS_TICKS = 350  # An arm takes up its own weight in this time after it was opened.
SURER, SAFE_M = 4.0, 0.015  # A last push is at most so many times as strong, and moves the device by at most so much.
MOST_AWAY_M = 0.03  # distance from where a push began beyond which it ends
SILENT_TICKS = 40
DEGREE = 4
SMOOTHS = 9  # samples over which a speed is averaged before its sign is taken
LATEST_TICKS = 12  # largest l that is tried
MOVED_COUNTS = 30.0  # motion there and back that a push has to make; where it makes less, more force is tried
EXPLAINED = 0.75  # least share of the motion beside p that the push explains where it moves the device
QUIET = 0.95  # value of EXPLAINED where nothing else moves the device, so that its delay can be told
DOUBT, DOUBT_OF_ONE = 1.4, 3.0
"""A fit with samples as old as they say, worse than the best by more than this factor, proves that they are later: by
more than a tick, or by one."""
CROSS = 0.5  # An axis is swapped where its own gain is less than this fraction of the largest gain.
MOST_GAIN = 1.5
AXES = "xyz"

Clock = Callable[[int], int]
"""Tick -> the newest tick that is due, once that tick is."""


@dataclass(frozen=True, slots=True)
class Response:
    """Motion under pushes along one axis. gains: g_i, of each axis; late_ticks: l; pushed_n: largest force.

    travel_m  how far the push alone moved it, there and back [m]
    damping_nspm, friction_n   B and c along the axis, by the record's mass
    moved   False where too little moved with the force for anything to be said
    quiet   False where something else moved it so much that nothing can be said of its delay
    """

    axis: int
    pushed_n: float
    moved: bool
    gains: tuple[float, ...] = ()
    late_ticks: int = 0
    quiet: bool = True
    travel_m: float = 0.0
    damping_nspm: float = 0.0
    friction_n: float = 0.0

    @property
    def known(self) -> bool:
        """Return whether anything can be said: it moved, and nothing else moved it."""
        return self.moved and self.quiet

    def faults(self, record: Capability) -> list[str]:
        """Return what is not as the record says, each with what to look at; none where all is well."""
        name, gains = AXES[self.axis], self.gains
        if not self.moved:
            what = f"did not move under {self.pushed_n:.2g} N: it is held, stuck or at a stop, or its motors are off"
            return [f"{name}: {what}; let go of it in mid-range, see to its power"]
        if not self.quiet:
            return [
                f"{name}: something else moved it meanwhile, so nothing can be said: let go of it, or hold it still"
            ]
        largest = max(range(len(gains)), key=lambda axis: abs(gains[axis]))
        own, found = gains[self.axis], []
        if abs(own) < CROSS * abs(gains[largest]):
            other = AXES[largest]
            found.append(
                f"{name}: a push along it moves the device along {other}: these axes are swapped, of motors or positions"
            )
        elif own < 0.0:
            found.append(
                f"{name}: it moves against its force: the sign of its motor or of its position there is wrong; a damper would"
                " drive the hand"
            )
        if abs(gains[largest]) > MOST_GAIN:
            found.append(
                f"{name}: it moves {abs(gains[largest]):.2g} times as far as {self.pushed_n:.2g} N move"
                f" {record.apparent_mass_kg:g} kg: its motor gain or position gain is too large, or its record's mass"
            )
        if self.late_ticks:
            late = f"its samples are {self.late_ticks} ticks later than they say"
            found.append(f"{name}: {late}: correct latency_ticks and age_ticks of its driver")
        return found


@dataclass(slots=True)
class _Course:
    """Ticks of one axis: forces [N] of each, and samples as (tick at which they were taken, place [m])."""

    forces: list[float] = field(default_factory=list)
    samples: list[tuple[int, Sequence[float]]] = field(default_factory=list)


def most_push_n(record: Capability) -> float:
    """Return the largest force of a trial [N]."""
    return min(MOST_N, MOST_SHARE * record.peak_force_n)


def respond(device: Device, clock: Clock, first_tick: int = 0) -> list[Response]:
    """Push an open device along each of its places; no force is left. Raises DeviceError."""
    record = device.capability
    axes = min(len(AXES), len(record.workspace_m))
    most_n = most_push_n(record)
    zero, answers = (0.0,) * record.axes, []
    tick = first_tick - 1
    try:
        for _ in range(WARMS_TICKS):
            tick = clock(tick + 1)
            device.read(tick)
            device.write(zero)
        for axis in range(axes):
            push_n = min(FIRST_N, most_n)
            while True:
                course, tick = _push(device, clock, tick, axis, push_n)
                answer = _judge(course, axis, axes, push_n, record)
                if (answer.moved and answer.quiet) or push_n >= most_n:
                    break
                push_n = min(most_n, 2.0 * push_n)
            if not answer.faults(record) and push_n < most_n:  # fit for more force, which tells a delay from friction
                push_n = min(most_n, push_n * min(SURER, SAFE_M / answer.travel_m))
                course, tick = _push(device, clock, tick, axis, push_n)
                more = _judge(course, axis, axes, push_n, record)
                answer = more if more.moved and more.quiet else answer
            answers.append(answer)
    finally:
        device.write(zero)
    return answers


def faults(device: Device, clock: Clock) -> list[str]:
    """Return what an open device does other than its record says, none where all is well. Raises DeviceError."""
    return [found for answer in respond(device, clock) for found in answer.faults(device.capability)]


def push_along(
    device: Device, clock: Clock, tick: int, axis: int, push_n: float, stroke_ticks: int = STROKE_TICKS
) -> tuple[Response, int]:
    """Push an open device to and fro along one place; return how it moved, and the newest tick. Raises DeviceError."""
    record = device.capability
    course, tick = _push(device, clock, tick, axis, push_n, stroke_ticks)
    return _judge(course, axis, min(len(AXES), len(record.workspace_m)), push_n, record), tick


def _push(
    device: Device, clock: Clock, tick: int, axis: int, push_n: float, stroke_ticks: int = STROKE_TICKS
) -> tuple[_Course, int]:
    """Push along an axis, and return what came of it, with the newest tick."""
    course, count = _Course(), device.capability.axes
    begun: Sequence[float] | None = None
    first = tick + 1
    ticks = BEFORE_TICKS + len(PATTERN) * stroke_ticks + AFTER_TICKS
    silent = 0
    away = False
    while tick - first + 1 < ticks:
        before, tick = tick, clock(tick + 1)
        course.forces += [course.forces[-1] if course.forces else 0.0] * (
            tick - before - 1
        )  # held over ticks that were missed
        sample = device.read(tick)
        if sample is not None:
            place = sample.position_m
            begun = begun or place
            course.samples.append((tick - sample.age_ticks - first, place))
            away = away or any(abs(x - y) > MOST_AWAY_M for x, y in zip(place, begun, strict=True))
            silent = 0
        else:
            silent += 1
        stroke = (tick - first - BEFORE_TICKS) // stroke_ticks
        pushes = 0 <= stroke < len(PATTERN) and not away and silent < SILENT_TICKS
        force = push_n * PATTERN[stroke] if pushes else 0.0
        asked = tuple([force if each == axis else 0.0 for each in range(count)])
        acting = device.write(asked)
        course.forces.append(force if acting is None else float(acting[axis]))
    return course, tick


def _judge(course: _Course, axis: int, axes: int, push_n: float, record: Capability) -> Response:
    """Fit the motion of each axis."""
    forces = np.array(course.forces)
    tick_s = 1.0 / RATE_HZ
    speed = np.concatenate(([0.0], np.cumsum(forces)[:-1])) * tick_s
    u = np.concatenate(([0.0], np.cumsum(speed * tick_s + 0.5 * tick_s * tick_s * forces)))
    still = Response(axis, push_n, moved=False)
    if len(course.samples) < len(forces) // 2:
        return still
    ticks = np.array([at for at, _ in course.samples])
    places = np.array([place[:axes] for _, place in course.samples])
    kept = (ticks >= LATEST_TICKS) & (ticks < len(u))
    ticks, places = ticks[kept], places[kept] - places[kept][0]
    if len(ticks) < len(forces) // 2:
        return still
    time = 2.0 * (ticks - ticks[0]) / (ticks[-1] - ticks[0]) - 1.0
    slow = np.vander(time, DEGREE + 1)
    steps = np.diff(ticks, prepend=ticks[0]) * tick_s
    once = np.cumsum(places * steps[:, None], axis=0)
    twice = np.cumsum(once * steps[:, None], axis=0)
    rates = np.gradient(np.array([np.convolve(row, np.ones(SMOOTHS) / SMOOTHS, "same") for row in places.T]).T, axis=0)
    rubbing = np.where(np.abs(rates) > 0.1 * np.ptp(rates, axis=0), np.sign(rates), 0.0)
    rubbed = np.cumsum(np.cumsum(rubbing * steps[:, None], axis=0) * steps[:, None], axis=0)
    fits = []
    for late in range(LATEST_TICKS + 1):
        pushed = u[ticks - late]
        rows, error = [], 0.0
        for each in range(axes):
            held = np.column_stack((once[:, each], twice[:, each], rubbed[:, each], slow))
            with_push = np.column_stack((pushed, held))
            answer, *_ = np.linalg.lstsq(with_push, places[:, each], rcond=None)
            without, *_ = np.linalg.lstsq(held, places[:, each], rcond=None)
            rest = places[:, each] - with_push @ answer
            rest_before = places[:, each] - held @ without
            made = answer[0] * pushed
            gain, damping, friction = -record.apparent_mass_kg * answer[[0, 1, 3]]
            rows.append((gain, np.ptp(made), rest @ rest, rest_before @ rest_before, damping, friction))
            error += rest @ rest
        fits.append((error, late, rows))
    count_m = max(record.resolution_m, 1e-7)
    best = min(fits, key=lambda fit: fit[0])
    noise = 0.25 * axes * len(ticks) * count_m * count_m / 12.0
    _, late, rows = best if fits[0][0] > (DOUBT if best[1] > 1 else DOUBT_OF_ONE) * (best[0] + noise) else fits[0]
    _, _, rest, before, *_ = max(best[2], key=lambda row: row[1])
    travel_m = max(row[1] for row in rows)
    quiet = bool(rest <= (1.0 - QUIET) * before)
    gains = []
    moved = False
    for gain, made_m, rest, before, *_ in rows:
        seen = bool(made_m >= MOVED_COUNTS * count_m and rest <= (1.0 - EXPLAINED) * before)
        moved = moved or seen
        gains.append(float(gain) if seen else 0.0)
    if not moved:
        return still
    *_, damping, friction = rows[axis]
    late = late if quiet else 0
    return Response(axis, push_n, moved, tuple(gains), late, quiet, float(travel_m), float(damping), float(friction))
