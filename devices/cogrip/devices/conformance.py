"""The conformance suite: what every device promises, as checks. `for check in CHECKS: check(Subject(make_it))`.

A check raises UnfitError, which says what was expected and what was found. The project's own tests run all of them on every
family of the registry; `cogrip devices conform ADDRESS` runs them on any one device.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import hypot, inf, isfinite, nan, pi

from cogrip.devices.device import Capability, Device, DeviceError, Sample
from cogrip.devices.plausibility import AGE, DRIFT, JUMP, OLD, ForceReports, Plausibility
from cogrip.devices.response import RATE_HZ, faults
from cogrip.devices.way_in import into_box
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.settings.rates import LEAST_DEVICE_HZ
from cogrip.protocol.wire.handle import is_unit

FEW_TICKS = 40
JUDGED_TICKS = 160
MOST_AMISS = 0.02  # largest share of ticks at which something may go wrong on the wire
OF_THE_WIRE = ("skipped", "missed", "malformed", "not finite", "reply too many", "device: ")
"""A count whose name contains one of these is a count of replies that did not come, or were none."""
SETTLE_TICKS = 4  # ticks from a write until the motors do what it says


class UnfitError(AssertionError):
    """A device does not keep a promise."""


def _at_once(tick: int) -> None:
    """Virtual time: every tick is now."""


@dataclass(frozen=True, slots=True)
class Subject:
    """The device under test.

    make     a new device, not opened
    pace     waits until a tick is due; a device in virtual time needs none
    acting   what truly acts [N], as F that loads the hand; None where nobody knows
    push_n   largest force that is tried beyond 0 [N]; inf: also more than the device can give
    clock    [ns], by which calls are timed; None in virtual time, where they take none
    yields   whether its own force moves it, and nothing else does: then it is tried how
    """

    make: Callable[[], Device]
    rate_hz: int = 1024
    pace: Callable[[int], None] = _at_once
    acting: Callable[[Device], Sequence[float]] | None = None
    push_n: float = inf
    clock: Callable[[], int] | None = None
    yields: bool = False


def record_is_complete(subject: Subject) -> None:
    """Before it is opened, in SI units, every limit a number above zero."""
    device = subject.make()
    record = device.capability
    _expect(isinstance(record, Capability), f"capability is a Capability, not {type(record).__name__}")
    _expect(bool(record.family) and bool(record.model), "family and model have names")
    bounds = record.workspace_m
    _expect(1 <= record.axes <= GRIP_AXES or record.axes == POSE_AXES, f"axes are 1 to 4, or 6: {record.axes}")
    _expect(len(bounds) == min(record.axes, PLACES), "workspace_m has a (low, high) for each place")
    _expect((record.rotation is None) == (record.axes < POSE_AXES), "a device of six axes has a record of its rotation")
    _expect(all(low < high for low, high in bounds), f"workspace_m is low to high: {bounds}")
    _expect(all(high - low < 5.0 for low, high in bounds), f"workspace_m is in metres: {bounds}")
    forces = (record.continuous_force_n, record.peak_force_n)
    _expect(0.0 < forces[0] <= forces[1] < inf, f"0 < continuous_force_n <= peak_force_n < inf: {forces}")
    for name in ("stiffness_npm", "damping_nspm", "slew_nps", "speed_mps", "apparent_mass_kg"):
        _expect(0.0 < getattr(record, name) < inf, f"{name} is finite and above 0: {getattr(record, name)}")
    _expect(0.0 <= record.resolution_m < 0.01, f"resolution_m is in metres, 0 for exact: {record.resolution_m}")
    _expect(
        record.rate_hz >= LEAST_DEVICE_HZ and record.latency_ticks >= 0,
        f"rate_hz is at least {LEAST_DEVICE_HZ}, latency_ticks at least 0: {record.rate_hz}, {record.latency_ticks}",
    )
    _expect(dict(device.counts) == {}, "nothing has gone wrong before it was opened")


def refuses_while_closed(subject: Subject) -> None:
    """Read and write before open, and after close; closing twice, or before opening, does nothing."""
    device = subject.make()
    _refuses(lambda: device.read(0), "read before open", "open")
    _refuses(lambda: device.write(_zero(device)), "write before open", "open")
    device.close()
    device.open(subject.rate_hz)
    device.close()
    device.close()
    _refuses(lambda: device.read(1), "read after close", "open")
    _refuses(lambda: device.write(_zero(device)), "write after close", "open")


def opens_again(subject: Subject) -> None:
    """A device does not open twice at once, and opens again after it was closed."""
    device = subject.make()
    for _ in range(2):
        device.open(subject.rate_hz)
        try:
            _refuses(lambda: device.open(subject.rate_hz), "a second open", "open already")
            _expect(any(sample is not None for sample in _run(subject, device)), "samples come after open")
        finally:
            device.close()


def refuses_rates(subject: Subject) -> None:
    """0, less than LEAST_DEVICE_HZ, and more than its record says: with the rate asked for and both bounds."""
    device = subject.make()
    most_hz = device.capability.rate_hz
    for rate_hz in (0, LEAST_DEVICE_HZ - 1, most_hz + 1):
        words = f"rate_hz={rate_hz} is out of {LEAST_DEVICE_HZ} to {most_hz}"
        _refuses(lambda rate_hz=rate_hz: device.open(rate_hz), f"open({rate_hz})", words)  # type: ignore[misc]
    device.open(subject.rate_hz)
    device.close()


def samples_are_metres(subject: Subject) -> None:
    """Shape as in the record, finite, inside the workspace; a velocity where the record says so; age not negative."""
    with _opened(subject) as device:
        record = device.capability
        samples = [sample for sample in _run(subject, device) if sample is not None]
        _expect(bool(samples), f"samples come within {FEW_TICKS} ticks")
        for sample in samples:
            _expect(len(sample.position_m) == record.axes, f"a position for each axis: {sample}")
            _expect(
                (sample.velocity_mps is not None) == record.gives_velocity, f"a velocity as the record says: {sample}"
            )
            _expect(all(map(isfinite, sample.position_m + (sample.velocity_mps or ()))), f"finite: {sample}")
            places = zip(sample.position_m, record.workspace_m, strict=False)
            inside = all(low <= at <= high for at, (low, high) in places)
            _expect(inside, _outside(record, sample.position_m))
            turned = hypot(*sample.position_m[PLACES:])
            _expect(turned <= pi * (1.0 + 1e-3), f"a rotation vector turns by at most pi: {turned} rad")
            if record.gripper is not None:
                _expect(sample.grip_m == sample.position_m[-1], f"the opening is the axis behind the places: {sample}")
            _expect(sample.age_ticks >= 0, f"an age of at least 0: {sample.age_ticks}")


def handle_is_as_the_record_says(subject: Subject) -> None:
    """No button beyond those of the record, an orientation or a grip where it says so, and each one that can be."""
    with _opened(subject) as device:
        record = device.capability
        for sample in [sample for sample in _run(subject, device) if sample is not None]:
            _expect(0 <= sample.buttons < 1 << record.buttons, f"{record.buttons} buttons: {sample}")
            _expect(type(sample.buttons) is int, f"a plain int: {sample}")
            turned, grip_m = sample.orientation, sample.grip_m
            _expect(
                turned is None or (record.gives_orientation and is_unit(turned)),
                f"a unit quaternion, or none: {sample}",
            )
            low, high = record.grip_m or (inf, -inf)
            _expect(grip_m is None or low <= grip_m <= high, f"a grip within {record.grip_m} m, or none: {sample}")


def ticks_do_not_fall(subject: Subject) -> None:
    """They may jump after an overrun."""
    with _opened(subject) as device:
        _run(subject, device, (0, 1, 2, 9, 30))
        _refuses(lambda: device.read(29), "read(29) after read(30)", "tick=29")
        subject.pace(31)
        device.read(31)


def refuses_wrong_forces(subject: Subject) -> None:
    """Another number of axes, and numbers that are not finite; and it works on."""
    with _opened(subject) as device:
        axes = device.capability.axes
        device.read(0)
        _refuses(lambda: device.write((0.0,) * (axes + 1)), "a force of one axis more", "axes")
        for wrong in (nan, inf, -inf):
            _refuses(lambda wrong=wrong: device.write((wrong,) * axes), f"a force of {wrong}", "not finite")  # type: ignore[misc]
        _run(subject, device, range(1, 6))


def force_keeps_to_the_record(subject: Subject) -> None:
    """A force beyond the record is cut to what the device can give, in the same direction."""
    if subject.acting is None:
        return
    with _opened(subject) as device:
        record = device.capability
        asked = (min(subject.push_n, 40.0 * record.peak_force_n),) * record.axes
        given: Sequence[float] = _zero(device)
        for tick in range(FEW_TICKS):
            subject.pace(tick)
            device.read(tick)
            device.write(asked)
            given = subject.acting(device)
            _expect(
                hypot(*given) <= record.peak_force_n * 1.01 or subject.push_n < inf,
                f"at most {record.peak_force_n} N: {given}",
            )
        size = hypot(*given)
        _expect(size > 0.0, "force flows after open")
        along = add_floats(a * g for a, g in zip(asked, given, strict=True)) / (hypot(*asked) * size)
        _expect(along > 0.99, f"in the direction asked for, cosine {along:.4f}")


def lets_go_when_closed(subject: Subject) -> None:
    """After close no force is left."""
    if subject.acting is None:
        return
    device = subject.make()
    device.open(subject.rate_hz)
    push = (min(subject.push_n, 0.2 * device.capability.peak_force_n),) * device.capability.axes
    _run(subject, device, range(SETTLE_TICKS + 1), push)
    _expect(hypot(*subject.acting(device)) > 0.0, "force flows after open")
    device.close()
    _expect(not any(subject.acting(device)), f"no force after close: {subject.acting(device)}")


def ages_stay_small(subject: Subject) -> None:
    """A sample is as old as the record says, or a little older, and newer than the one before: an age that grows is a stall."""
    found, samples = _judged(subject)
    _expect(AGE not in found, f"an age of 0 or a few ticks: {found.get(AGE)}")
    _expect(
        3 * len(found.get(OLD, ())) <= samples, f"samples newer than those before: {found.get(OLD, ())[:1]} came again"
    )


def answers_come_whole(subject: Subject) -> None:
    """Answers that do not come, come in part or make no sense are rare, by its own counts."""
    with _opened(subject) as device:
        amiss, before = 0, _wire(device)
        for tick in range(JUDGED_TICKS):
            _run(subject, device, (tick,))
            now = _wire(device)
            amiss += now != before
            before = now
    _expect(
        amiss <= MOST_AMISS * JUDGED_TICKS,
        f"answers that are whole: at {amiss} of {JUDGED_TICKS} ticks it counted {', '.join(before)}; see to its cable, and "
        "to what else uses its port",
    )


def _wire(device: Device) -> dict[str, int]:
    """Return the counts of what went wrong on the wire so far."""
    return {name: count for name, count in device.counts.items() if any(word in name for word in OF_THE_WIRE)}


def positions_do_not_jump(subject: Subject) -> None:
    """A held handle stays near its course from one sample to the next: see `cogrip.devices.plausibility`."""
    found, _ = _judged(subject)
    _expect(JUMP not in found, f"positions without jumps: {found.get(JUMP)}")


def velocity_agrees_with_position(subject: Subject) -> None:
    """Velocities add up to what the positions say. Nothing to see where the device stands still, or gives none."""
    found, _ = _judged(subject)
    _expect(DRIFT not in found, f"velocities that agree with the positions: {found.get(DRIFT)}")


def write_tells_what_acts(subject: Subject) -> None:
    """None, or for each axis a part of the force that was asked for now or lately: finite, not larger, not the other way."""
    with _opened(subject) as device:
        record = device.capability
        reports = ForceReports(record, subject.rate_hz)
        push = min(subject.push_n, 1.5 * record.peak_force_n)
        for tick in range(FEW_TICKS):
            subject.pace(tick)
            device.read(tick)
            asked = (push * ((tick // 8) % 3 - 1),) * record.axes
            reports.asked(asked)
            acting = device.write(asked)
            if acting is not None:
                fits = len(acting) == record.axes and not reports.judge(tuple(acting))
                _expect(fits, f"write tells a part of {asked} N, or of a force before it: {acting}")


def moves_as_its_record_says(subject: Subject) -> None:
    """A small force moves it along its own axis, the right way, by what its mass makes of it, and not later than it says."""
    if not subject.yields or subject.rate_hz != RATE_HZ:
        return

    def due(tick: int) -> int:
        subject.pace(tick)
        return tick

    with _opened(subject) as device:
        found = faults(device, due)
        _expect(not found, f"moves as its record says: {'; '.join(found)}")


def raises_device_errors_alone(subject: Subject) -> None:
    """Whatever it is asked wrongly, and it works on. Any other exception is a defect, and ends the session."""
    _refuses(lambda: subject.make().open(-1), "open(-1)", "rate_hz")
    with _opened(subject) as device:
        axes = device.capability.axes
        subject.pace(0)
        device.read(0)
        _refuses(lambda: device.read(-1), "read(-1)", "tick=-1")
        for count in {0, axes - 1, axes + 2}:
            _refuses(lambda count=count: device.write((0.0,) * count), f"a force of {count} axes", "axes")  # type: ignore[misc]
        _run(subject, device, range(1, 6))


def calls_do_not_block(subject: Subject) -> None:
    """Read and write together take less than a tick, on the average: the loop waits for no device."""
    clock = subject.clock
    if clock is None:
        return
    with _opened(subject) as device:
        took_ns = 0
        for tick in range(FEW_TICKS):
            subject.pace(tick)
            begun_ns = clock()
            device.read(tick)
            device.write(_zero(device))
            took_ns += clock() - begun_ns
        mean_ms, tick_ms = 1e-6 * took_ns / FEW_TICKS, 1e3 / subject.rate_hz
        _expect(mean_ms < tick_ms, f"read and write within a tick of {tick_ms:.2g} ms: {mean_ms:.2g} ms")


CHECKS: tuple[Callable[[Subject], None], ...] = (
    record_is_complete,
    refuses_while_closed,
    opens_again,
    refuses_rates,
    samples_are_metres,
    handle_is_as_the_record_says,
    ticks_do_not_fall,
    refuses_wrong_forces,
    force_keeps_to_the_record,
    lets_go_when_closed,
    ages_stay_small,
    answers_come_whole,
    positions_do_not_jump,
    velocity_agrees_with_position,
    write_tells_what_acts,
    moves_as_its_record_says,
    raises_device_errors_alone,
    calls_do_not_block,
)


@contextmanager
def _opened(subject: Subject) -> Iterator[Device]:
    """A device that is open inside, and closed after, whatever happens."""
    device = subject.make()
    device.open(subject.rate_hz)
    try:
        yield device
    finally:
        device.close()


def _run(
    subject: Subject, device: Device, ticks: Iterable[int] = range(FEW_TICKS), force_n: Sequence[float] | None = None
) -> list[Sample | None]:
    """Samples of these ticks, at each of which `force_n` is written; None: no force."""
    samples = []
    for tick in ticks:
        subject.pace(tick)
        samples.append(device.read(tick))
        device.write(_zero(device) if force_n is None else force_n)
    return samples


def _judged(subject: Subject) -> tuple[dict[str, list[Sample]], int]:
    """The samples of a run that are not plausible, by the name of what is wrong with them, and how many there were in all."""
    found: dict[str, list[Sample]] = {}
    with _opened(subject) as device:
        judge = Plausibility(device.capability, 1.0 / subject.rate_hz)
        samples = _run(subject, device, range(JUDGED_TICKS))
    for tick, sample in enumerate(samples):
        if sample is not None and (wrong := judge.judge(tick, sample)):
            found.setdefault(wrong, []).append(sample)
    return found, len(samples) - samples.count(None)


def _outside(record: Capability, position_m: Sequence[float]) -> str:
    """Return that a position must be inside the workspace, in millimetres, and what to do."""
    box = " x ".join(f"{1e3 * low:z.0f} to {1e3 * high:z.0f}" for low, high in record.workspace_m)
    at = ", ".join(f"{1e3 * part:z.0f}" for part in position_m)
    way = into_box(position_m, record.workspace_m) or "into mid-range"
    return f"inside the workspace of {box} mm, and it is at ({at}) mm: move it {way}, and try again"


def _zero(device: Device) -> tuple[float, ...]:
    return (0.0,) * device.capability.axes


def _expect(kept: bool, promise: str) -> None:
    if not kept:
        raise UnfitError(promise)


def _refuses(call: Callable[[], object], what: str, word: str) -> None:
    """`call` raises DeviceError with `word` in it."""
    try:
        call()
    except DeviceError as error:
        _expect(word in str(error), f"{what} is refused with a word of {word!r}: {error}")
    except Exception as error:
        raise UnfitError(f"{what} is refused with DeviceError, not with {type(error).__name__}: {error}") from error
    else:
        raise UnfitError(f"{what} is refused with DeviceError")
