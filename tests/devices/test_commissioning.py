"""Commissioning: a device that is well passes up to its peak, each fault is found below 20 % of it, and a seat is refused.

Rehearsed on emulated arms with their drivers, and on the drivers of two vendors with a mass of a test's own under the
library: faults are of that mass, behind the vendor's library, where no line of the driver knows of them.
"""

import dataclasses
import json
import re
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.cli.devices.tried_response import read_sheet
from cogrip.cli.main import main
from cogrip.cli.terminal.problem import Problem
from cogrip.client.commissioning import FOUND_SHARE, RATE_HZ, SHARES, Stopped, commission
from cogrip.devices.commissioning_sheet import PUSH, QUIET, Sheet, Step, unit_of
from cogrip.devices.device import Device, DeviceError
from cogrip.devices.io.calibration_store import FOLDER
from cogrip.devices.io.sheet_store import KEY_FILE, SheetStore
from cogrip.devices.registry import make
from cogrip.devices.response import Clock

from tests.devices.faulty_device import FAULTS, MOTOR_GAIN, POSITION_GAIN, POSITION_SIGN, SIGN, SWAP, FaultyDevice
from tests.devices.vendor_bench import VendorBench
from tests.extent import every

ARMS = tuple(f"emulated:{name}" for name in ("vintage", "woodenhaptics", "polhem", "inverse3", "2diy", "pantograph"))
HUNG = "hold&hand_stiffness_npm=60&hand_damping_nspm=1"  # a thread, on which an arm without balance hangs
WEAK, OFF, HEAVY = "half the force", "no force", "three times the mass"
WORDS = {
    SIGN: "it moves against its force",
    POSITION_SIGN: "it moves against its force",
    SWAP: "these axes are swapped",
    MOTOR_GAIN: "times as far",
    POSITION_GAIN: "times as far",
    WEAK: "times as far as its record's mass would: its motor gain or position gain is too small",
    HEAVY: "times as far as its record's mass would: its motor gain or position gain is too small",
    OFF: "did not move under",
}


class Watched:
    """A device, and what was asked of it."""

    def __init__(self, inner: Device) -> None:
        self._inner, self.asked = inner, [(0.0,)]
        self.read, self.open, self.close, self.counts = inner.read, inner.open, inner.close, inner.counts

    @property
    def capability(self) -> Any:
        return self._inner.capability

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        self.asked.append(tuple(force_n))
        return self._inner.write(force_n)


def tried(arm: str, fault: str = "", late_ticks: int = 0, hand: str = HUNG) -> tuple[list[Step], float]:
    """Return the steps with an emulated arm, and the largest force along an axis as a share of its peak; none is left."""
    axes = 2 if arm.endswith(("2diy", "pantograph")) else 3
    devices: list[Watched] = []

    @contextmanager
    def opened() -> Iterator[tuple[Device, Clock]]:
        device = Watched(FaultyDevice(make(f"{arm}?hand={hand}", axes=axes), fault, late_ticks))
        devices.append(device)
        device.open(RATE_HZ)
        yield device, lambda tick: tick
        device.close()

    record = make(arm, axes=axes).capability
    steps = list(commission(record, opened, lambda what, force_n: None))
    assert not any(any(device.asked[-1]) for device in devices)
    return steps, max(abs(part) for device in devices for row in device.asked for part in row) / record.peak_force_n


def faults_of(steps: Sequence[Step]) -> str:
    return "; ".join(fault for step in steps for fault in step.faults)


@pytest.mark.parametrize("arm", ARMS)
def test_an_arm_that_is_well_passes(arm: str) -> None:
    steps, most = tried(arm)
    assert faults_of(steps) == ""
    assert steps[-1].what == QUIET
    assert most <= 1.001
    gains = [step.gain for step in steps if step.gain is not None]
    assert gains == pytest.approx([1.0] * len(gains), abs=0.12)
    assert most > 0.7, "also the force that a hand will feel"


@pytest.mark.parametrize(("arm", "fault"), every(5, product(ARMS, FAULTS)))
def test_each_fault_is_found_below_a_fifth_of_the_peak_force(arm: str, fault: str) -> None:
    steps, most = tried(arm, fault)
    assert WORDS[fault] in faults_of(steps)
    assert most < FOUND_SHARE


@pytest.mark.parametrize(("arm", "late_ticks"), every(4, product(ARMS, (2, 3, 4, 8))))
def test_samples_that_are_late_are_found_below_a_fifth_of_the_peak_force(arm: str, late_ticks: int) -> None:
    steps, most = tried(arm, late_ticks=late_ticks)
    assert re.search(r"its samples are \d ticks later than they say", faults_of(steps))
    assert most < FOUND_SHARE


@pytest.mark.parametrize(
    "hand", ["hold&hand_stiffness_npm=50000&hand_damping_nspm=500", "tremor&tremor_m=0.003", "reach"]
)
def test_what_cannot_be_told_does_not_pass(hand: str) -> None:
    steps, most = tried("emulated:vintage", hand=hand)
    assert faults_of(steps) != ""
    assert most < FOUND_SHARE


class Mass:
    """A free mass under a vendor's library: what its motors push, and what its encoders say. fault: what is wrong with it."""

    def __init__(self, bench: VendorBench, mass_kg: float, damping_nspm: float, fault: str, late_ticks: int) -> None:
        self._bench, self._fault = bench, fault
        self._mass_kg, self._damping_nspm = mass_kg * (3.0 if fault == HEAVY else 1.0), damping_nspm
        self._place, self._speed = [0.0] * 3, [0.0] * 3
        self._seen: deque[tuple[float, ...]] = deque([(0.0, 0.0, 0.0)], late_ticks + 1)
        self.most_n = 0.0
        self._tick = -1

    def clock(self, tick: int) -> int:
        """Let a tick pass. At the first one of an opening the mass is put into the middle, at rest."""
        if tick <= self._tick:
            self._place, self._speed = [0.0] * 3, [0.0] * 3
        self._tick = tick
        load = list(self._bench.load())
        self.most_n = max(self.most_n, *map(abs, load))
        if self._fault == SIGN:
            load[0] = -load[0]
        if self._fault == SWAP:
            load[0], load[1] = load[1], load[0]
        gain = {MOTOR_GAIN: 2.0, WEAK: 0.5, OFF: 0.0}.get(self._fault, 1.0)
        for axis in range(3):
            force_n = -gain * load[axis] - self._damping_nspm * self._speed[axis]
            self._speed[axis] += force_n / self._mass_kg / RATE_HZ
            self._place[axis] += self._speed[axis] / RATE_HZ
        x, y, z = self._place
        told = (-x if self._fault == POSITION_SIGN else x, y, z)
        self._seen.append(tuple((2.0 if self._fault == POSITION_GAIN else 1.0) * part for part in told))
        self._bench.place(*self._seen[0])
        self._bench.step()
        return tick


def tried_at(bench: VendorBench, fault: str = "", late_ticks: int = 0) -> tuple[list[Step], float]:
    """Return the steps with a vendor's device, and the largest force as a share of its peak."""
    record = bench.device().capability
    mass = Mass(bench, record.apparent_mass_kg, 0.5, fault, late_ticks)

    @contextmanager
    def opened() -> Iterator[tuple[Device, Clock]]:
        bench.place(0.0, 0.0, 0.0)
        device = bench.device()
        device.open(min(RATE_HZ, record.rate_hz))
        try:
            yield device, mass.clock
        finally:
            device.close()

    return list(commission(record, opened, lambda what, force_n: None)), mass.most_n / record.peak_force_n


@pytest.fixture(params=["sdk", "bench"], ids=["forcedimension", "openhaptics"])
def vendor(request: pytest.FixtureRequest) -> VendorBench:
    found: VendorBench = request.getfixturevalue(request.param)
    return found


def test_a_vendors_device_that_is_well_passes(vendor: VendorBench) -> None:
    steps, most = tried_at(vendor)
    assert faults_of(steps) == ""
    assert steps[-1].what == QUIET
    assert 0.7 < most <= 1.001


@pytest.mark.parametrize("fault", [*FAULTS, WEAK, OFF, HEAVY])
def test_a_fault_behind_a_vendors_library_is_found_below_a_fifth_of_the_peak_force(
    vendor: VendorBench, fault: str
) -> None:
    steps, most = tried_at(vendor, fault)
    assert WORDS[fault] in faults_of(steps)
    assert most < FOUND_SHARE


@pytest.mark.parametrize("late_ticks", [2, 5])
def test_a_vendors_late_samples_are_found_below_a_fifth_of_the_peak_force(vendor: VendorBench, late_ticks: int) -> None:
    steps, most = tried_at(vendor, late_ticks=late_ticks)
    assert "ticks later than they say" in faults_of(steps)
    assert most < FOUND_SHARE


def test_the_operator_ends_it_before_any_part() -> None:
    for last in (0, 1, 2, 4):
        asked: list[float] = []

        def allow(what: str, force_n: float, last: int = last, asked: list[float] = asked) -> None:
            if len(asked) == last:
                raise Stopped(what)
            asked.append(force_n)

        @contextmanager
        def opened() -> Iterator[tuple[Device, Clock]]:
            device = make(f"emulated:vintage?hand={HUNG}", axes=3)
            device.open(RATE_HZ)
            yield device, lambda tick: tick
            device.close()

        record, steps = make("emulated:vintage", axes=3).capability, list[Step]()
        with pytest.raises(Stopped):
            steps.extend(commission(record, opened, allow))
        assert max((step.force_n for step in steps), default=0.0) <= max(asked, default=0.0)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    return tmp_path


ADDRESS = f"emulated:pantograph?hand={HUNG}"


def run(*words: str) -> int:
    return main([*words])


def words_of(said: list[str]) -> Callable[[str], None]:
    return said.append


def test_the_command_leaves_a_sheet_that_a_seat_reads(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("devices", "commission", ADDRESS, "--by", "A. Tester", "--yes", "--json", "-") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["passed"], told["faults"], told["by"]) == (True, [], "A. Tester")
    assert told["tried_n"] == pytest.approx(make(ADDRESS, axes=2).capability.peak_force_n)
    said: list[str] = []
    assert "tried with up to 2.28 N: as its record says" in read_sheet(ADDRESS, words_of(said))
    assert said == [f"{ADDRESS}: {SheetStore().find(ADDRESS).text}"]  # type: ignore[union-attr]
    assert (folder / KEY_FILE).stat().st_mode & 0o077 == 0
    assert run("devices", "commission", ADDRESS, "--show") == 0


def sheet(*steps: Step, ended: str = "", unit: str = "") -> Sheet:
    return Sheet(ADDRESS, unit, "A. Tester", "2026-01-02T03:04:05+00:00", "0", steps, ended)


WELL = Step(PUSH, 0.05, 0.1, "gain 1.00", axis="x", gain=1.0)
WRONG = Step(PUSH, 0.05, 0.1, "gain -1.00", ("x: it moves against its force",), "x", -1.0)


def test_a_seat_is_refused_where_the_sheet_says_that_it_is_not_fit(folder: Path) -> None:
    unit = current_unit()
    SheetStore().keep(sheet(WELL, WRONG, unit=unit))
    with pytest.raises(Problem, match=r"refused: .*NOT fit: x: it moves against its force; mend it and cogrip devices"):
        read_sheet(ADDRESS, lambda text: None)


def current_unit() -> str:

    return unit_of(make(ADDRESS, axes=2).capability, b"")


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        (
            lambda unit: sheet(WELL, ended="ended by the operator before 10 %", unit=unit),
            "up to 0.1 N only: ended by the operator",
        ),
        (lambda unit: sheet(WELL, unit=unit), "up to 0.1 N only: it did not come to its end"),
        (lambda unit: sheet(WRONG, unit="another record"), "has changed since it was commissioned"),
    ],
    ids=["ended", "cut", "other record"],
)
def test_what_is_not_known_of_a_device_is_a_warning(folder: Path, kept: Callable[[str], Sheet], words: str) -> None:
    SheetStore().keep(kept(current_unit()))
    said: list[str] = []
    read_sheet(ADDRESS, words_of(said))
    assert len(said) == 1
    assert said[0].startswith("warning: ")
    assert words in said[0]


def test_a_sheet_that_was_changed_is_none(folder: Path) -> None:
    path = SheetStore().keep(sheet(WRONG, unit=current_unit()))
    table = json.loads(path.read_text("utf-8"))
    table["steps"][0] |= {"faults": [], "gain": 1.0}
    path.write_text(json.dumps(table), "utf-8")
    with pytest.raises(DeviceError, match="was changed since it was signed"):
        SheetStore().find(ADDRESS)
    with pytest.raises(Problem, match="commission it again"):
        read_sheet(ADDRESS, lambda text: None)
    path.write_text("{", "utf-8")
    with pytest.raises(DeviceError, match="cannot be read as a sheet"):
        SheetStore().find(ADDRESS)


def test_a_sheet_of_another_device_or_key_is_none(folder: Path) -> None:
    path = SheetStore().keep(sheet(WELL))
    other = SheetStore().path_of("emulated:2diy")
    other.write_bytes(path.read_bytes())
    with pytest.raises(DeviceError, match="another device's"):
        SheetStore().find("emulated:2diy")
    (folder / KEY_FILE).write_bytes(bytes(32))
    with pytest.raises(DeviceError, match="was changed since it was signed"):
        SheetStore().find(ADDRESS)
    (folder / KEY_FILE).write_bytes(b"short")
    with pytest.raises(DeviceError, match="is no key of 32 bytes"):
        SheetStore().find(ADDRESS)


def test_a_passed_sheet_has_all_parts() -> None:
    quiet = Step(QUIET, 0.05, 0.1, "comes to rest")
    assert sheet(WELL, quiet).passed
    for other in (sheet(WELL), sheet(WELL, WRONG, quiet), sheet(WELL, quiet, ended="by Ctrl-C"), sheet()):
        assert not other.passed
    assert msgspec.json.decode(msgspec.json.encode(sheet(WELL, quiet)), type=Sheet) == sheet(WELL, quiet)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("sim:phantom", "--by", "A"), "has no motors: there is nothing to commission"),
        (("emulated:pantograph",), "--by '': give the name of whoever commissions it"),
        (("emulated:pantograph", "--show"), "was never commissioned"),
    ],
)
def test_what_cannot_be_commissioned_says_so(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], text: str
) -> None:
    assert run("devices", "commission", *words) != 0
    told = capsys.readouterr()
    assert text in " ".join((told.out + told.err).split())


class Silenced(Watched):
    """A device that gives no sample, or one that is none, from a tick of an opening on."""

    def __init__(self, inner: Device, at_tick: int, gives: float | None) -> None:
        super().__init__(inner)
        inner_read = inner.read

        def read(tick: int) -> Any:
            sample = inner_read(tick)
            if tick < at_tick or sample is None:
                return sample
            return None if gives is None else sample.replaced(position_m=(gives, *sample.position_m[1:]))

        self.read = read


@pytest.mark.parametrize("gives", [None, float("nan"), float("inf")])
def test_no_force_stands_on_samples_that_are_none(gives: float | None) -> None:
    record, devices, forces, steps = make("emulated:vintage", axes=3).capability, list[Watched](), [], list[Step]()

    @contextmanager
    def opened() -> Iterator[tuple[Device, Clock]]:
        last = len(devices) == len(SHARES) + 1  # the quiet part is the last opening
        device = Silenced(make(f"emulated:vintage?hand={HUNG}", axes=3), 380 if last else 10**9, gives)
        devices.append(device)
        device.open(RATE_HZ)
        yield device, lambda tick: tick
        device.close()

    def take() -> None:
        for step in commission(record, opened, lambda what, force_n: None):
            steps.append(step)
            forces.append(devices[-1].asked[-1])

    if gives is None:
        take()
        assert "no sample came for" in faults_of(steps)
    else:
        with pytest.raises(DeviceError, match="is no number"):
            take()
    quiet = devices[-1].asked
    assert not any(quiet[-1]), "and none is left"
    assert not any(map(any, forces)), "nor held while somebody is told"
    pushed = [row for row in quiet if any(row)]
    assert len(pushed) < 100, "it ends soon"
    assert max(abs(part) for row in pushed for part in row) < FOUND_SHARE * record.peak_force_n


def test_a_device_whose_loop_is_slower_is_not_pushed() -> None:
    slow = dataclasses.replace(make("emulated:vintage", axes=3).capability, rate_hz=512)
    with pytest.raises(DeviceError, match="rate_hz = 512"):
        list(commission(slow, lambda: pytest.fail("it is opened"), lambda what, force_n: None))


def test_a_sheet_that_refuses_is_not_replaced_by_one_that_was_left(folder: Path) -> None:
    SheetStore().keep(sheet(WRONG, unit=current_unit()))
    for typed in ("q\n", "\n\nq\n"):
        subprocess.run(
            [sys.executable, "-P", "-m", "cogrip.cli", "devices", "commission", ADDRESS, "--by", "B"], input=typed, text=True,
            capture_output=True, check=False, timeout=60,
        )  # fmt: skip
        with pytest.raises(Problem, match="NOT fit"):
            read_sheet(ADDRESS, lambda text: None)


def test_a_device_has_one_sheet_by_all_its_names(folder: Path, tmp_path: Path) -> None:
    node = tmp_path / "tty"
    node.touch()
    (tmp_path / "by-id").symlink_to(node)
    one, other = f"serial:{tmp_path}/by-id?model=vintage", f"serial:{node}?model=vintage"
    SheetStore().keep(msgspec.structs.replace(sheet(WRONG), device=one))
    assert SheetStore().find(other).faults == WRONG.faults  # type: ignore[union-attr]
