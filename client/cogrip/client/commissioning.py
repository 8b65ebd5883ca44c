"""Commissioning of a device: what moves a hand is tried from 5 % of the peak force upward, against the device's record.

Nobody holds the device, a hand is on its power switch. Three parts, in this order; the first fault ends all of it. The device
is opened anew for each, so that it is not held while somebody thinks:

    rest     no force for REST_S: samples come, are no older than they say, and the device stays where it is
    pushes   at each share of the peak force in SHARES, to and fro along one axis after the other (`devices.response`)
    quiet    nudged, with a damper of the largest impedance that the client would render on it: it comes to rest

A push with the force F moves a mass m by 2 F s^2 / m there and back, s the length of a stroke; s is such that this is TRAVEL_M,
but at least LEAST_TICKS, so that a light and strong device is tried with less than its peak. What may be wrong is found at
shares below FOUND_SHARE: a device that has not moved by then, or that something else moves, does not pass.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from math import hypot, isfinite, sqrt

from cogrip.client.hand.velocity import largest_impedance, observer_for
from cogrip.client.safety.oscillation import OscillationDetector
from cogrip.devices.commissioning_sheet import PUSH, QUIET, REST, Step
from cogrip.devices.device import Capability, Device, DeviceError, Sample
from cogrip.devices.response import AXES, MOST_GAIN, SILENT_TICKS, STROKE_TICKS, Clock, Response, push_along
from cogrip.machine.addition import add_floats

RATE_HZ = 1024
SHARES = (0.05, 0.1, 0.15, 0.3, 0.5, 0.75, 1.0)
FOUND_SHARE = 0.2  # share below which whatever is wrong is found
LAST_SHARE = max(share for share in SHARES if share < FOUND_SHARE)
TRAVEL_M = 0.012  # travel of a push there and back, for a device of its record's mass
LEAST_TICKS = 6  # shortest stroke, in which a motor still follows
WARM_TICKS = 350  # An arm takes up its own weight in this time after it was opened.
REST_S = 1.0
MOST_DRIFT_M = 0.003  # largest motion at rest: beyond, its own weight moves it, or somebody
LEAST_SAMPLED = 0.9  # least share of ticks with a new sample, of a device that gives one a tick
NUDGE_SHARE, NUDGE_TICKS = 0.05, 40
QUIET_S, SETTLED_S = 1.5, 0.5
MOST_SHAKE_N = 0.15  # largest rms of the damper's force in the last SETTLED_S: a hand does not feel less
MOST_AWAY_M = 0.04  # distance from where the quiet part began at which it ends
HELD = 1.2  # A drag of more than this times the force of the push is that of a hand, or hides how it moves.
LOSS_DOUBT = 0.5  # fraction of the drag that a record states which has to be found


class Stopped(Exception):  # noqa: N818 (somebody wants to leave)
    """An answer of the operator that ends the procedure before its end."""


Allow = Callable[[str, float], None]
"""Function that is called before each part, with what comes and its force [N]; raises Stopped where that is not to be."""
Open = Callable[[], AbstractContextManager[tuple[Device, Clock]]]
"""Function that opens the device anew, with its clock, and closes it at the end."""


def commission(record: Capability, open_device: Open, allow: Allow) -> Iterator[Step]:
    """Try a device part by part; no force is left, however it ends. Raises DeviceError and Stopped."""
    if record.rate_hz < RATE_HZ:
        raise DeviceError(
            f"its record has rate_hz = {record.rate_hz}, and its pushes are timed in ticks of {RATE_HZ} Hz"
        )
    allow("without force: it is read alone", 0.0)
    with _freed(open_device) as (device, clock, tick):
        yield (rest := _rest(device, clock, tick))
    if rest.faults:
        return
    for share in SHARES:
        force_n = share * record.peak_force_n
        if _stroke_ticks(record, force_n) is None:
            found = f"more than {_most_n(record):.3g} N is not tried: so light a device would go too far"
            yield Step(PUSH, share, force_n, found)
            break
        allow(f"{100 * share:.0f} % of its peak force", force_n)
        failed = False
        with _freed(open_device) as (device, clock, tick):
            for axis in range(min(len(AXES), len(record.workspace_m))):
                step, tick = _pushed(device, clock, tick, axis, share)
                yield step
                failed = failed or bool(step.faults)
        if failed:
            return
    allow("a nudge, then a damper", NUDGE_SHARE * record.peak_force_n)
    with _freed(open_device) as (device, clock, tick):
        quiet = _quiet(device, clock, tick)
        device.write((0.0,) * record.axes)  # before whoever is told takes time
        yield quiet


@contextmanager
def _freed(open_device: Open) -> Iterator[tuple[Device, Clock, int]]:
    """Give the open device, its clock and the newest tick, once it has taken up its own weight; leave no force."""
    with open_device() as (opened, clock):
        device = _Finite(opened)
        zero, tick = (0.0,) * device.capability.axes, -1
        try:
            while tick < WARM_TICKS:
                tick = clock(tick + 1)
                device.read(tick)
                device.write(zero)
            yield device, clock, tick
        finally:
            device.write(zero)


class _Finite:
    """A device whose places are numbers, or it is lost: a limit of a force lets what is none through."""

    def __init__(self, inner: Device) -> None:
        self._inner = inner
        self.open, self.write, self.close, self.counts = inner.open, inner.write, inner.close, inner.counts

    @property
    def capability(self) -> Capability:
        return self._inner.capability

    def read(self, tick: int) -> Sample | None:
        sample = self._inner.read(tick)
        if sample is not None and not all(map(isfinite, (*sample.position_m, *(sample.velocity_mps or ())))):
            raise DeviceError(f"a sample of it is no number: {sample.position_m}; correct its driver")
        return sample


def _most_n(record: Capability) -> float:
    """Return the largest force with which the shortest stroke moves the device by TRAVEL_M [N]."""
    return 0.5 * TRAVEL_M * record.apparent_mass_kg * (RATE_HZ / LEAST_TICKS) ** 2


def _stroke_ticks(record: Capability, force_n: float) -> int | None:
    """Return the length of a stroke; None where even the shortest goes too far."""
    ticks = RATE_HZ * sqrt(0.5 * TRAVEL_M * record.apparent_mass_kg / force_n)
    return None if ticks < LEAST_TICKS else min(STROKE_TICKS, round(ticks))


def _rest(device: Device, clock: Clock, tick: int) -> Step:
    """Read for REST_S without force."""
    zero = (0.0,) * device.capability.axes
    places: list[Sequence[float]] = []
    last, oldest = tick + round(REST_S * RATE_HZ), 0
    while tick < last:
        tick = clock(tick + 1)
        sample = device.read(tick)
        device.write(zero)
        if sample is not None:
            places.append(sample.position_m[: len(AXES)])
            oldest = max(oldest, sample.age_ticks)
    asked = round(REST_S * RATE_HZ)
    share = len(places) / asked
    drift_m = max((max(column) - min(column) for column in zip(*places, strict=True)), default=0.0)
    faults = []
    if share < LEAST_SAMPLED:
        faults.append(f"samples came in {100 * share:.0f} % of the ticks: see to its cable, and `cogrip doctor`")
    if drift_m > MOST_DRIFT_M:
        why = "its own weight moves it, or somebody does: hang it on a thread, or let go of it"
        faults.append(f"it moved by {1e3 * drift_m:.1f} mm without force: {why}")
    found = f"samples in {100 * share:.0f} % of the ticks, at most {oldest} ticks old; moved by {1e3 * drift_m:.2f} mm"
    return Step(REST, 0.0, 0.0, found, tuple(faults))


def _pushed(device: Device, clock: Clock, tick: int, axis: int, share: float) -> tuple[Step, int]:
    """Push along one axis with this share of the peak force, again where something else moved the device meanwhile."""
    record, name = device.capability, AXES[axis]
    force_n = share * record.peak_force_n
    stroke_ticks = _stroke_ticks(record, force_n)
    assert stroke_ticks is not None
    answer, tick = push_along(device, clock, tick, axis, force_n, stroke_ticks)
    if not answer.known:  # somebody may have touched it
        answer, tick = push_along(device, clock, tick, axis, force_n, stroke_ticks)
    held = answer.known and _drag_n(answer, record, force_n, stroke_ticks) > HELD * force_n
    if share < LAST_SHARE and (held or not answer.known):
        what = "moved by something else, or by steps of its encoders" if answer.moved else "not moved, as by friction"
        what = "held, by a hand or by friction" if held else what
        return Step(PUSH, share, force_n, f"nothing can be said yet: {what}", axis=name), tick
    faults = [*answer.faults(record), *_weak(answer, name), *_drag_faults(answer, record, force_n, stroke_ticks)]
    if not answer.known:
        return Step(PUSH, share, force_n, "nothing can be said", tuple(faults), axis=name), tick
    gain, drag_n = answer.gains[axis], _drag_n(answer, record, force_n, stroke_ticks)
    found = f"gain {gain:.2f}, {answer.late_ticks} ticks later, drag {drag_n:.2f} N, {1e3 * answer.travel_m:.1f} mm"
    return Step(
        PUSH, share, force_n, found, tuple(faults), name, gain, answer.late_ticks, drag_n, answer.travel_m
    ), tick  # fmt: skip


def _weak(answer: Response, name: str) -> Iterator[str]:
    """Say where it moves less than its record's mass would, as one whose motors give less force, or that is heavier."""
    gain = answer.gains[answer.axis] if answer.known else 1.0
    if 0.0 < gain < 1.0 / MOST_GAIN and max(map(abs, answer.gains)) == gain:
        cause = "its motor gain or position gain is too small, or its record's mass"
        yield f"{name}: it moves {gain:.2g} times as far as its record's mass would: {cause}"


def _drag_n(answer: Response, record: Capability, force_n: float, stroke_ticks: int) -> float:
    """Return friction and damping at the mean speed: the two cannot be told apart well in one push."""
    return answer.friction_n + answer.damping_nspm * _speed_mps(record, force_n, stroke_ticks)


def _speed_mps(record: Capability, force_n: float, stroke_ticks: int) -> float:
    """Return the mean speed of a push: half of the speed that a stroke ends with."""
    return 0.5 * force_n * stroke_ticks / RATE_HZ / record.apparent_mass_kg


def _drag_faults(answer: Response, record: Capability, force_n: float, stroke_ticks: int) -> Iterator[str]:
    """Say where there is less drag than the record states: its energy ledger would count on what is not there."""
    stated_n = record.own_friction_n + record.own_damping_nspm * _speed_mps(record, force_n, stroke_ticks)
    if (
        answer.known
        and stated_n > 0.1 * force_n
        and _drag_n(answer, record, force_n, stroke_ticks) < LOSS_DOUBT * stated_n
    ):
        yield (
            f"{AXES[answer.axis]}: its drag is less than half of the {stated_n:.2f} N that its record states: "
            "own_damping_nspm and own_friction_n are bounds from below; lower them"
        )


def _quiet(device: Device, clock: Clock, tick: int) -> Step:
    """Nudge it, hold it with the damper of a line, and look whether it comes to rest."""
    record, tick_s = device.capability, 1.0 / RATE_HZ
    axes, impedance = record.axes, largest_impedance(record, tick_s).impedance_nspm
    places = min(len(AXES), len(record.workspace_m))
    observer = observer_for(record, tick_s, [record.apparent_mass_kg] * axes)
    detector = OscillationDetector(axes, tick_s)
    push_n, most_n = NUDGE_SHARE * record.peak_force_n, FOUND_SHARE * record.peak_force_n
    held: Sequence[float] = (0.0,) * axes
    begun: Sequence[float] | None = None
    velocity: Sequence[float] = [0.0] * axes
    first, squares, counted, taken, samples = tick + 1, 0.0, 0, tick, 0
    what = f"damper of {impedance:.3g} N s/m"
    while tick - first < round(QUIET_S * RATE_HZ):
        tick = clock(tick + 1)
        sample = device.read(tick)
        if observer is not None:
            observer.hold(held, 1)
        if sample is None and tick - taken > SILENT_TICKS:
            fault = f"no sample came for {tick - taken} ticks, under force: see to its cable, and `cogrip doctor`"
            return Step(QUIET, NUDGE_SHARE, push_n, what, (fault,))
        if sample is not None:
            samples += 1
            begun = begun or sample.position_m
            if sample.velocity_mps is not None:
                velocity = sample.velocity_mps
            elif observer is not None:
                velocity = observer.update(sample.position_m, max(1, tick - taken))
            taken = tick
            away_m = hypot(*[x - y for x, y in zip(sample.position_m[:places], begun[:places], strict=True)])
            if away_m > MOST_AWAY_M:
                fault = f"it went {1e3 * away_m:.0f} mm away: nothing holds it back; see to its sign, and to its weight"
                return Step(QUIET, NUDGE_SHARE, push_n, what, (fault,))
        damper = [impedance * v if number < places else 0.0 for number, v in enumerate(velocity)]
        nudge = push_n if tick - first < NUDGE_TICKS else 0.0
        asked = [max(-most_n, min(most_n, f + nudge)) if number < places else 0.0 for number, f in enumerate(damper)]
        acting = device.write(asked)
        held = asked if acting is None else acting
        detector.add(held, False, damper)
        if detector.oscillates:
            fault = f"it oscillates under a damper of {impedance:.3g} N s/m: lower damping_nspm, correct its mass or latency"
            return Step(QUIET, NUDGE_SHARE, push_n, what, (fault,))
        if tick - first >= round((QUIET_S - SETTLED_S) * RATE_HZ):
            squares, counted = squares + add_floats(force * force for force in held), counted + 1
    shake_n, share = sqrt(squares / max(1, counted)), samples / (tick - first + 1)
    faults = []
    if shake_n > MOST_SHAKE_N:
        faults.append(f"the force shakes by {shake_n:.2f} N rms, at most {MOST_SHAKE_N:g}: lower damping_nspm")
    if share < LEAST_SAMPLED:
        faults.append(f"samples came in {100 * share:.0f} % of the ticks: see to its cable, and `cogrip doctor`")
    return Step(QUIET, NUDGE_SHARE, push_n, f"{what}: comes to rest, {shake_n:.3f} N rms", tuple(faults))
