"""The Haply driver on the emulated board, in virtual time: positions, forces, the pose, faults."""

import re
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from itertools import product
from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from cogrip.devices import DeviceError, make
from cogrip.devices.arm.driver import HEADROOM
from cogrip.devices.emulated.emulated_device import Notebook
from cogrip.devices.emulated.emulated_line import EmulatedLine
from cogrip.devices.emulated.faults import VERBS, Faults
from cogrip.devices.emulated.haply_firmware import HaplyFirmware, Joint
from cogrip.devices.emulated.mechanics import HeldTip, Mechanics
from cogrip.devices.family.haply import drive
from cogrip.devices.haply.frames import HaplyCodec
from cogrip.devices.haply.haply_device import HaplyDevice
from cogrip.devices.haply.models import MODELS, HaplySettings, model_of
from cogrip.devices.settings import parse_address, read_settings
from cogrip.protocol.settings.rates import due_ns

from tests.extent import every

RATE_HZ = 1024
CENTRE = (0.0, 0.0)
every_model = pytest.mark.parametrize("name", sorted(MODELS))


@dataclass
class Bench:
    """One board with its arm in a hand, and whatever drivers come and go. at: the loop's tick."""

    name: str = "2diy"
    hand: str = "hold"
    homed: bool = True
    keys: str = ""
    start_m: tuple[float, ...] = CENTRE
    seed: int = 1
    notes: Notebook = field(default_factory=Notebook)
    at: int = 0

    def __post_init__(self) -> None:
        query = parse_address(f"haply:x?model={self.name}{self.keys}").query
        model = model_of(read_settings(HaplySettings, query, "bench"), "bench")
        keys = {"resolution_m": 0.0, "friction_n": 0.0, "peak_force_n": 100.0, "x0_m": self.start_m}
        body = make(f"sim:phantom?hand={self.hand}", axes=3, **keys)
        a, b = (Joint(port, ccw) for port, ccw in zip(model.wiring.ports, model.wiring.ccw, strict=True))
        self.firmware = HaplyFirmware((a, b), Mechanics(model, HeldTip(body)), Faults(self.seed), homed=self.homed)

    def opened(self, pose: str = "home", **keys: int) -> HaplyDevice:
        device = self.driver(pose, **keys)
        device.open(RATE_HZ)
        return device

    def driver(self, pose: str = "home", axes: int = 2, number: int = 0) -> HaplyDevice:
        address = parse_address(f"haply:bench?model={self.name}&pose={pose}{self.keys}")
        port = EmulatedLine("haply:bench", self.firmware)
        return drive(port, "haply:bench", self.notes, address, axes, number=number)

    def tick(self, device: HaplyDevice, force_n: tuple[float, ...] = (0.0, 0.0)):
        self.at += 1
        self.firmware.advance(due_ns(0, self.at, RATE_HZ))
        sample = device.read(self.at)
        device.write(force_n)
        return sample

    @property
    def tip_m(self) -> tuple[float, ...]:
        return self.firmware.mechanics.body.position_m


WIRINGS = ("", "&motors=near", "&dir=-1,1", "&motor_dir=1,-1&dir=-1,-1", "&home_deg=150,30")


@pytest.mark.parametrize(("name", "keys"), every(3, product(sorted(MODELS), WIRINGS)))
def test_positions_are_the_bodys_within_two_counts(name: str, keys: str) -> None:
    bench = Bench(name, "sine&amplitude_m=0.02&frequency_hz=1.5&direction=1,-0.7", keys=keys)
    device = bench.opened()
    moved = before = 0.0
    for _ in range(1024):
        was = bench.tip_m
        sample = bench.tick(device)
        if bench.at < 3:
            continue
        assert sample.age_ticks == 1
        assert sample.velocity_mps is None
        assert sample.position_m == pytest.approx(was[:2], abs=2.0 * device.capability.resolution_m)
        moved, before = moved + abs(sample.position_m[0] - before), sample.position_m[0]
    assert moved > 0.05
    assert device.counts == {}


@given(
    name=st.sampled_from(sorted(MODELS)),
    force=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    at=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
    keys=st.sampled_from(["", "&motors=near", "&dir=-1,1", "&motor_dir=1,-1"]),
)
@settings(max_examples=60)
def test_the_hand_gets_minus_the_force(name: str, force: tuple[float, ...], at: tuple[float, ...], keys: str) -> None:
    bench = Bench(name, "hold&hand_stiffness_npm=100000&hand_damping_nspm=100", keys=keys, start_m=at)
    device = bench.opened()
    for _ in range(4):
        bench.tick(device, force)
    pushed = bench.firmware.mechanics.force_n
    ratio = MODELS[name].drive.capstan_m[0]
    least_m = 0.02  # lever arm: one step of the 12 bits, and of the commands, at each joint; and a count of angle
    slack = 2.0 * (0.123 / 4095 + 1e-5) / ratio / least_m + 0.004
    assert pushed[:2] == pytest.approx((-force[0], -force[1]), abs=slack)
    assert pushed[2] == 0.0
    device.close()
    assert bench.firmware.torque_nm == (0.0, 0.0)


@every_model
def test_force_above_the_record_is_scaled_to_it_and_counted(name: str) -> None:
    bench = Bench(name, "hold&hand_stiffness_npm=100000&hand_damping_nspm=100")
    device = bench.opened()
    for _ in range(10):
        bench.tick(device, (-30.0, 40.0))
    most = HEADROOM * device.capability.peak_force_n
    assert bench.firmware.mechanics.force_n[:2] == pytest.approx((0.6 * most, -0.8 * most), rel=0.02)
    assert device.counts == {"force limited to the motors": 10}
    assert all(abs(torque) <= 0.123 for torque in bench.firmware.torque_nm)


def at_home(name: str = "2diy") -> Bench:
    model = MODELS[name]
    home = model.five_bar.forward(model.drive.angles(model.home_counts))
    return Bench(name, "reach&amplitude_m=0.04&stroke_s=0.5&hand_stiffness_npm=3000", homed=False, start_m=home)


@every_model
def test_pose_home_is_where_the_arm_stands_at_the_first_opening_only(name: str) -> None:
    bench = at_home(name)
    device = bench.opened("home")
    for _ in range(400):
        bench.tick(device)
    device.close()
    device.open(RATE_HZ)  # away from home: the counters go on
    sample = bench.tick(device) or bench.tick(device)
    assert sample.position_m == pytest.approx(bench.tip_m[:2], abs=3e-4)
    assert abs(sample.position_m[0]) < 0.1


@every_model
def test_stored_calibration_holds_in_another_process_until_something_else_sets_the_board_up(name: str) -> None:
    bench = at_home(name)
    with pytest.raises(DeviceError, match="its pose is not known"):
        bench.opened("stored")
    bench.notes.keep(bench.driver("stored", number=3).calibrate("today"))
    bench.firmware.advance(500_000_000)
    bench.at = 600
    device = bench.opened("stored", number=8)
    bench.tick(device, (0.3, 0.0))
    was = bench.tip_m
    sample = bench.tick(device, (0.3, 0.0))
    assert sample.position_m == pytest.approx(was[:2], abs=3.0 * device.capability.resolution_m)
    assert bench.firmware.torque_nm != (0.0, 0.0)
    device.close()
    bench.opened("none").close()  # sets the board up anew, wherever the arm is
    for _ in range(2):  # and it is refused for good, not once
        with pytest.raises(DeviceError, match="does not answer to its setup"):
            device.open(RATE_HZ)
        assert bench.firmware.torque_nm == (0.0, 0.0)


def test_stored_calibration_ends_with_the_power() -> None:
    bench = at_home()
    bench.notes.keep(bench.driver("stored").calibrate("today"))
    bench.firmware.fault("unplug")
    device = bench.driver("stored")
    with pytest.raises(DeviceError, match="plug it in"):
        device.open(RATE_HZ)
    bench.firmware.mend()
    with pytest.raises(DeviceError, match="without power"):
        device.open(RATE_HZ)
    bench.notes.keep(device.calibrate("again"))
    device.open(RATE_HZ)


def test_calibration_of_another_program_is_refused() -> None:
    """Its id, 5, is none that a calibration can have."""
    bench = at_home()
    bench.notes.keep(replace(bench.driver("stored").calibrate("today"), stamp="plugging 1 id 5"))
    with pytest.raises(DeviceError, match="was plugged in again since it was calibrated"):
        bench.opened("stored")


@pytest.mark.parametrize("pose", ["home", "stored"])
def test_torque_that_a_program_before_left_on_is_gone_also_where_the_pose_is_refused(pose: str) -> None:
    bench = at_home()
    bench.notes.keep(bench.driver("stored").calibrate("today"))
    codec = HaplyCodec(MODELS["2diy"].wiring, 5)
    for frame in (codec.wiring.setup(5), codec.encode((9000, -9000))):
        bench.firmware.receive(frame, 0)
    assert bench.firmware.torque_nm != (0.0, 0.0)
    with pytest.raises(DeviceError, match="does not answer") if pose == "stored" else nullcontext():
        bench.opened(pose)
    assert bench.firmware.torque_nm == (0.0, 0.0)


def run(bench: Bench, device: HaplyDevice, ticks: int) -> tuple[str, list[float]]:
    """The first error, and the size of the motors' force after each tick. As a client does it, force fades after an error."""
    failed, sizes, fraction = "", [], 1.0
    for _ in range(ticks):
        try:
            bench.tick(device, (0.8 * fraction, -0.4 * fraction))
        except DeviceError as error:
            failed = failed or str(error)
        if failed:
            fraction = max(0.0, fraction - 0.05)
            with suppress(DeviceError):
                device.write((0.8 * fraction, -0.4 * fraction))
        sizes.append(hypot(*bench.firmware.mechanics.force_n))
    return failed, sizes


@pytest.mark.parametrize(
    ("verb", "counted"),
    [
        ("silence", {"reply late", "reply missed"}),
        ("garbage", {"reply late", "reply missed", "bytes skipped"}),
        ("short", {"reply late", "reply missed", "bytes skipped"}),
        ("split", set()),
        ("merge", {"reply late", "reply too many"}),
        ("model", {"reply late", "reply missed", "bytes skipped"}),
        ("deaf", {"reply late", "reply missed"}),
    ],
)
def test_fault_of_the_wire_is_counted_and_passes(verb: str, counted: set[str]) -> None:
    bench = Bench(hand="sine&amplitude_m=0.005")
    device = bench.opened()
    run(bench, device, 50)
    bench.firmware.fault(verb, 0.3)
    failed, sizes = run(bench, device, 300)
    assert failed == ""
    assert counted <= set(device.counts)
    assert max(sizes) < 0.9 + 0.1
    if verb in ("silence", "garbage", "model", "short"):  # it hears; no good reply comes
        assert sizes[0] > 0.5
        assert not any(sizes[58:]), "51 ticks without a reading, and up to 6 until a request is repeated"
    failed, sizes = run(bench, device, 100)
    was = dict(device.counts)
    assert failed == ""
    assert bench.tick(device).position_m == pytest.approx(bench.tip_m[:2], abs=1e-3)
    run(bench, device, 100)
    assert dict(device.counts) == was
    assert sizes[-1] == pytest.approx((0.8**2 + 0.4**2) ** 0.5, abs=0.02)
    device.close()
    assert bench.firmware.torque_nm == (0.0, 0.0)


FAST = "sine&amplitude_m=0.03&frequency_hz=3&ramp_s=0.1&direction=1,0.3"  # on its way after 180 ticks


@pytest.mark.parametrize(
    ("verb", "text", "hand"),
    [
        ("jump", "encoder a jumped", "sine&amplitude_m=0.005"),
        ("unplug", "plug it in again", "sine&amplitude_m=0.005"),
        ("stuck", "encoder b is stuck|encoder b jumped", FAST),
    ],
)
def test_fault_that_loses_the_pose_is_an_error_until_it_is_set_right(verb: str, text: str, hand: str) -> None:
    bench = Bench(hand=hand)
    device = bench.opened()
    run(bench, device, 180 if hand == FAST else 50)
    bench.firmware.fault(verb)
    failed, sizes = run(bench, device, 200)
    assert re.search(text, failed)
    assert sizes[-1] == 0.0
    assert max(sizes) < 1.0
    bench.firmware.mend()
    device.close()
    for _ in range(2):
        with pytest.raises(DeviceError, match=r"pose|counters"):
            device.open(RATE_HZ)
    assert bench.firmware.torque_nm == (0.0, 0.0)


passing = st.sampled_from([verb for verb in VERBS if verb not in ("unplug", "reversed")])
"""Faults of a wire. Motors that push the other way are no such fault: a trial finds them before a seat is taken."""


@given(st.lists(st.tuples(passing, st.integers(1, 60), st.integers(1, 60)), min_size=1, max_size=5), st.integers(0, 99))
@settings(max_examples=40)
def test_no_sequence_of_faults_makes_more_force_than_was_asked_for(
    faults: list[tuple[str, int, int]], seed: int
) -> None:
    bench = Bench(hand="sine&amplitude_m=0.01&direction=1,1", seed=seed)
    device = bench.opened()
    sizes: list[float] = []
    for verb, lasts_ms, rest_ticks in faults:
        bench.firmware.fault(verb, lasts_ms * 1e-3)
        sizes += run(bench, device, lasts_ms + rest_ticks)[1]
    assert max(sizes) < 1.1
    device.close()
    assert bench.firmware.torque_nm == (0.0, 0.0)
