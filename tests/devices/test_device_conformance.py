"""Every family of the registry, by whatever stands for it, keeps every promise of `cogrip.devices.conformance`. Virtual time.

A new family is tried as soon as it is in the registry; one that brings nothing to be tried by fails here.
"""

import re
from collections.abc import Callable, Sequence
from math import nan
from pathlib import Path

import pytest

from cogrip.devices import Capability, Device, Sample, conformance, make
from cogrip.devices.conformance import CHECKS, DeviceSubject, UnfitDeviceError
from cogrip.devices.registry import axes_of, is_real, schemes, stand_ins

from tests.devices.held_device import hold, opened
from tests.devices.replayed_hands import replays
from tests.devices.test_simulated_gripper import ADDRESS as FINGERS
from tests.extent import every

HANDS = ("hold", "push", "reach&direction=1", "sine", "tremor&seed=3")
ELSEWHERE = {"replay", "openhaptics", "forcedimension"}  # on recordings, below; on stub libraries, in their own tests
FOUND = sorted({address for addresses in stand_ins().values() for address in addresses})
EVERY = [(FINGERS, 4)] + [
    (held, axes)
    for address in FOUND
    for held in ([f"{address}?hand={hand}" for hand in HANDS] if address.startswith("sim:") else [address])
    for axes in sorted({1, 2, 3, axes_of(address)})
    if axes <= axes_of(address)
]


def acting(device: Device) -> tuple[float, ...]:
    """Return the force with which a simulated or emulated device truly loads its hand."""
    return device.force_n  # type: ignore[attr-defined]


def subject(address: str, axes: int) -> DeviceSubject:
    # a simulated machine limits itself, in its plant; a replay need not
    clamps = not address.startswith(("sim:", "replay:"))
    return DeviceSubject(lambda: make(address, axes=axes), acting=acting, push_n=float("inf") if clamps else 1.0)


def test_every_family_is_tried() -> None:
    for scheme, addresses in stand_ins().items():
        assert addresses or scheme in ELSEWHERE, f"{scheme}: give its Family examples, or stand_ins"
    assert set(stand_ins()) == set(schemes())


def broken(subject: DeviceSubject) -> dict[str, str]:
    """Return what is wrong, by the check that finds it."""
    found = {}
    for check in CHECKS:
        try:
            check(subject)
        except Exception as error:  # noqa: BLE001 (as the command does)
            found[check.__name__] = repr(error)
    return found


@pytest.mark.parametrize(("address", "axes"), every(3, EVERY))
def test_it_keeps_every_promise(address: str, axes: int) -> None:
    assert broken(subject(address, axes)) == {}


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", range(3))
def test_a_replayed_person_keeps_them(kind: int, run: Path, table: Path) -> None:
    assert broken(subject(replays(run, table)[kind], 2)) == {}


SIMULATED = [address for address, axes in EVERY if axes == 1 and not is_real(address)]


@pytest.mark.parametrize("address", every(3, SIMULATED))
def test_same_calls_give_the_same_samples_again(address: str) -> None:
    first, again = (hold(opened(address), 300, lambda tick: (0.3 if tick % 50 < 20 else -0.2,)) for _ in range(2))
    assert first == again


@pytest.mark.parametrize("address", every(3, SIMULATED))
def test_skipped_ticks_hold_the_force(address: str) -> None:
    """An overrun that skips ticks ends where the same force written at each of them would have, within a count."""
    slow, fast = opened(address), opened(address)
    begin = 400  # what rises when a device is opened has risen
    for device, ticks in ((slow, 1), (fast, 40)):
        hold(device, begin)
        hold(device, range(begin, begin + ticks), (0.5,))
        device.read(begin + 40)
    assert slow.position_m == pytest.approx(fast.position_m, abs=2e-5)


@pytest.mark.parametrize("address", SIMULATED)
def test_positive_force_moves_the_device_towards_minus_x(address: str) -> None:
    """The sign of P eq. 9: m x'' = F_hand - F."""
    loaded, free = opened(address), opened(address)
    hold(loaded, 100, (2.0,))
    hold(free, 100)
    assert loaded.position_m[0] < free.position_m[0] - 1e-3


class Liar:
    """A device that is well but for one verb."""

    def __init__(
        self,
        read: Callable[[int, Sample], Sample] | None = None,
        write: Callable[[Sequence[float]], Sequence[float] | None] | None = None,
        address: str = "sim:ideal?hand=sine",
    ) -> None:
        self._device = make(address)
        self._read, self._write = read, write

    @property
    def capability(self) -> Capability:
        return self._device.capability

    def read(self, tick: int) -> Sample | None:
        sample = self._device.read(tick)
        assert sample is not None
        return sample if self._read is None else self._read(tick, sample)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        if self._write is not None and len(force_n) != 1:
            return self._write(force_n)
        self._device.write(force_n)
        return None if self._write is None else self._write(force_n)

    def __getattr__(self, name: str) -> object:
        return getattr(self._device, name)


class SlowClock:
    """Virtual: every read takes `took_ns`."""

    def __init__(self, took_ns: int) -> None:
        self.now_ns, self._took_ns = 0, took_ns

    def read(self, tick: int, sample: Sample) -> Sample:
        self.now_ns += self._took_ns
        return sample


def reads(change: Callable[[int, Sample], dict[str, object]], **keys: str) -> Callable[[], Liar]:
    """A device whose samples are changed so, by tick and sample."""
    return lambda: Liar(lambda tick, sample: sample.replaced(**change(tick, sample)), **keys)


def writes(write: Callable[[Sequence[float]], Sequence[float] | None]) -> Callable[[], Liar]:
    return lambda: Liar(write=write)


MILLIMETRES = "sim:ideal?hand=hold&x0_m=0.1"
LIES: list[tuple[str, str, Callable[[], Liar]]] = [
    ("samples_are_metres", "inside the workspace",
     reads(lambda t, s: {"position_m": (1000.0 * s.position_m[0],)}, address=MILLIMETRES)),
    ("handle_is_as_the_record_says", "0 buttons", reads(lambda t, s: {"buttons": 1})),
    ("handle_is_as_the_record_says", "a plain int", reads(lambda t, s: {"buttons": False})),
    ("handle_is_as_the_record_says", "a unit quaternion, or none", reads(lambda t, s: {"orientation": (1.0, 0.0, 0.0, 0.0)})),
    ("handle_is_as_the_record_says", "a grip within None m, or none", reads(lambda t, s: {"grip_m": 0.0})),
    ("ages_stay_small", "an age of 0 or a few ticks", reads(lambda t, s: {"age_ticks": t})),
    ("ages_stay_small", "an age of 0 or a few ticks", reads(lambda t, s: {"age_ticks": -1000})),
    ("ages_stay_small", "newer than those before", reads(lambda t, s: {"age_ticks": t % 4})),
    ("positions_do_not_jump", "without jumps", reads(lambda t, s: {"position_m": (s.position_m[0] + 0.03 * (t > 100),)})),
    ("velocity_agrees_with_position", "agree with the positions",
     reads(lambda t, s: {"position_m": (0.01,), "velocity_mps": (0.1,)})),
    ("velocity_agrees_with_position", "agree with the positions",
     reads(lambda t, s: {"position_m": (0.01,), "velocity_mps": (0.4 * (-1) ** t,)})),
    ("velocity_agrees_with_position", "agree with the positions",
     reads(lambda t, s: {"velocity_mps": (1000.0 * s.velocity_mps[0],)})),
    ("write_tells_what_acts", "write tells a part of", writes(lambda f: (-50.0 * f[0],))),
    ("write_tells_what_acts", "write tells a part of", writes(lambda f: (nan,))),
    ("write_tells_what_acts", "write tells a part of", writes(lambda f: (f[0], f[0]))),
    ("raises_device_errors_alone", "refused with DeviceError, not with IndexError", writes(lambda f: [][0])),
    ("raises_device_errors_alone", "refused with DeviceError", writes(lambda f: None)),
]  # fmt: skip


@pytest.mark.parametrize(("check", "words", "lying"), LIES)
def test_a_driver_that_lies_is_found(check: str, words: str, lying: Callable[[], Liar]) -> None:
    with pytest.raises(UnfitDeviceError, match=re.escape(words)):
        getattr(conformance, check)(DeviceSubject(lying))  # type: ignore[arg-type]
    getattr(conformance, check)(DeviceSubject(Liar))  # type: ignore[arg-type]  # the same, without the lie


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        ("", False),
        ("short@0.05+0.002", False),
        ("short@0.05+0.1", True),
        ("silence@0.05+0.1", True),
    ],
)
@pytest.mark.parametrize("model", ["vintage", "woodenhaptics", "2diy"])
def test_answers_that_are_half_a_line_are_found(model: str, fault: str, found: bool) -> None:
    line = subject(f"emulated:{model}?faults={fault}" if fault else f"emulated:{model}", 2)
    if found:
        with pytest.raises(UnfitDeviceError, match=r"answers that are whole: at .* ticks it counted .*reply missed"):
            conformance.answers_come_whole(line)
    else:
        conformance.answers_come_whole(line)


@pytest.mark.parametrize(("took_ns", "fits"), [(970_000, True), (980_000, False), (30_000_000, False)])
def test_a_driver_whose_reads_block_is_found(took_ns: int, fits: bool) -> None:
    clock = SlowClock(took_ns)
    subject = DeviceSubject(lambda: Liar(clock.read), clock=lambda: clock.now_ns)  # type: ignore[arg-type, return-value]
    if fits:
        conformance.calls_do_not_block(subject)
    else:
        with pytest.raises(UnfitDeviceError, match=r"read and write within a tick of 0\.98 ms: "):
            conformance.calls_do_not_block(subject)
