"""The emulated HID firmware by itself, and the driver on it, in virtual time."""

from math import hypot
from struct import pack, unpack

import pytest

from cogrip.devices.arm.models import MODELS
from cogrip.devices.arm.pose import Calibration
from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.emulated_device import EmulatedDevice, Notebook
from cogrip.devices.emulated.emulated_line import EmulatedLine
from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.hid_firmware import BYTES, WATCHDOG_NS, HidFirmware
from cogrip.devices.emulated.mechanics import HeldTip, Mechanics
from cogrip.devices.family.hid import drive
from cogrip.devices.hid.models import ARMS, NAMES
from cogrip.devices.registry import make
from cogrip.devices.settings import parse_address

from tests.devices.arm_bench import least_force_n
from tests.devices.held_device import hold

RATE_HZ = 1000
NOTHING = bytes(15)
MODEL = MODELS["woodenhaptics"]


def firmware(variant: str = "mbed14", full_scale_a: float = 3.0, name: str = "woodenhaptics", **body) -> HidFirmware:
    """An arm that was powered up in its home pose; then a hand took its tip to the middle of the workspace."""
    keys = {"resolution_m": 0.0, "peak_force_n": 100.0, "mass_kg": 0.075, **body}
    mechanics = Mechanics(ARMS[name], HeldTip(make("sim:phantom", axes=3, **keys)))
    return HidFirmware(mechanics, Faults(reports=True), variant, full_scale_a)


def emulated(arm: HidFirmware, keys: str = "pose=home", notebook=None, name: str = "woodenhaptics") -> EmulatedDevice:
    address = parse_address(f"hid:{name}?variant={arm.variant}&{keys}")
    port = EmulatedLine(f"hid:{name}", arm, reports=True)
    return EmulatedDevice(drive(port, f"hid:{name}", notebook or Notebook(), address, 3), arm)


def request(a: int, b: int, c: int, command: int = 0, x: int = 0, y: int = 0, z: int = 0) -> bytes:
    return pack("<B7h", 0, a, b, c, command, x, y, z)


def answer(arm: HidFirmware, data: bytes) -> tuple[int, ...]:
    arm.receive(data, arm.now_ns)
    [report] = arm.due(arm.now_ns)
    return unpack("<7h", report)


def test_the_first_report_is_filled_at_power_up_and_there_is_no_second_without_a_request() -> None:
    arm = firmware()
    arm.mechanics.slip(0, 50)  # the arm moves on
    [first] = arm.due(10**9)
    assert unpack("<7h", first)[0] == arm.mechanics.counters[0] - 50
    arm.advance(10**9)
    assert arm.due(10**9) == []
    assert answer(arm, NOTHING)[0] == arm.mechanics.counters[0]
    assert arm.due(2 * 10**9) == []


@pytest.mark.parametrize("variant", BYTES)
def test_each_request_has_one_report_of_the_same_length(variant: str) -> None:
    arm = firmware(variant)
    for count in (1, 1, 5, 2):
        for _ in range(count):
            arm.receive(bytes(1 + BYTES[variant]), arm.now_ns)
    reports = arm.due(0)
    assert len(reports) == 1 + 9
    assert {len(report) for report in reports} == {BYTES[variant]}


def test_other_lengths_and_report_numbers_are_ignored_and_feed_no_watchdog() -> None:
    arm = firmware()
    arm.due(0)
    for ignored, data in enumerate((b"", bytes(14), bytes(16), bytes(65), b"\1" + bytes(14)), 1):
        arm.receive(data, 0)
        assert arm.due(0) == []
        assert not arm.enabled
        assert arm.ignored == ignored


def test_the_watchdog_lets_go_after_half_a_second() -> None:
    arm = firmware()
    arm.receive(request(300, 0, 0), 0)
    assert arm.enabled
    assert arm.duty[0] == pytest.approx(0.54)
    arm.advance(WATCHDOG_NS)
    assert arm.enabled
    assert hypot(*arm.mechanics.force_n) > 0.1
    arm.advance(WATCHDOG_NS + 1)
    assert not arm.enabled
    assert arm.duty == [0.5] * 3
    assert arm.mechanics.force_n == (0.0, 0.0, 0.0)
    arm.receive(bytes(14), arm.now_ns)
    assert not arm.enabled
    arm.receive(NOTHING, arm.now_ns)
    assert arm.enabled


@pytest.mark.parametrize(
    ("ma", "full_scale_a", "duty"),
    [(3000, 3.0, 0.9), (-3000, 3.0, 0.1), (5999, 3.0, 1.2998667), (6000, 6.0, 0.9), (1, 3.0, 0.5001333)],
)
def test_the_duty_is_not_bounded_but_the_amplifier_is(ma: int, full_scale_a: float, duty: float) -> None:
    arm = firmware(full_scale_a=full_scale_a)
    arm.receive(request(ma, 0, 0), 0)
    assert arm.duty == pytest.approx([duty, 0.5, 0.5], abs=1e-6)
    assert abs(arm.mechanics.currents_ma[0]) == min(abs(ma), 1000 * full_scale_a)


def test_command_1_loads_the_counters_without_current_and_clears_the_button() -> None:
    arm = firmware()
    arm.due(0)
    arm.press()
    assert answer(arm, request(0, 0, 0))[6] == 1
    assert answer(arm, request(500, 500, 500))[6] == 1  # until they are loaded
    assert answer(arm, request(0, 30, 7, 1, 8327, -10926, 27140)) == (8327, -10926, 27140, 0, 30, 7, 0)
    assert arm.mechanics.currents_ma == (0.0, 0.0, 0.0)
    assert arm.duty == [0.5] * 3
    arm.button = True
    assert answer(arm, NOTHING) == (8327, -10926, 27140, 10000, 30, 7, 0)


def test_both_ends_of_16_bits() -> None:
    arm = firmware()
    arm.due(0)
    for count, sent in ((32767, 32767), (32768, -32768), (-32768, -32768), (-32769, 32767)):
        arm.mechanics.slip(1, count - arm.mechanics.counters[1])
        assert answer(arm, NOTHING)[1] == sent


def test_the_firmware_of_2016_counts_the_other_way_round_and_numbers_its_reports() -> None:
    arm = firmware("mbed8")
    arm.receive(pack("<B3hH", 0, -1143, 578, 358, 0), 0)
    assert bytes.fromhex("0089fb420266010000") == pack("<B3hH", 0, -1143, 578, 358, 0)
    assert arm.mechanics.currents_ma == (-1143, -578, -358)  # some of its motors are wired the other way
    numbers = [unpack("<3hH", report) for report in arm.due(0)]
    a, b, c = arm.mechanics.counters
    assert numbers == [(-a, -b, -c, 1), (-a, -b, -c, 2)]


def test_plugged_in_again_it_begins_anew() -> None:
    arm = firmware()
    arm.due(0)
    answer(arm, request(0, 30, 0, 1, 1, 2, 3))
    arm.press()
    arm.receive(request(1000, 0, 0), 0)
    arm.fault("unplug")
    assert arm.due(0) == []
    assert arm.mechanics.force_n == (0.0, 0.0, 0.0)
    arm.receive(NOTHING, 0)
    arm.mend()
    assert [unpack("<7h", report) for report in arm.due(0)] == [(0,) * 7]


def opened(arm: HidFirmware, name: str = "woodenhaptics") -> EmulatedDevice:
    device = emulated(arm, name=name)
    device.open(RATE_HZ)
    return device


@pytest.mark.parametrize("name", NAMES)
def test_the_tip_is_where_it_is_read_and_the_hand_feels_what_was_asked_for(name: str) -> None:
    arm, force = firmware(name=name), (-0.5, 0.4, 0.3)
    least = least_force_n(arm)
    device = opened(arm, name)
    sample = hold(device, 400, force)[-1]  # until the weight of a Polhem is held too
    assert sample.position_m == pytest.approx(device.position_m, abs=MODEL.record.resolution_m)
    assert device.force_n == pytest.approx(force, abs=least + 1e-3)  # 1 mN: the sample is a tick old
    assert hypot(*force) > 10 * least
    assert device.counts == {}


def test_the_report_from_power_up_is_not_where_the_arm_is() -> None:
    arm = firmware()
    arm.due(0)
    arm.faults.send(pack("<7h", 9000, 9000, 9000, 0, 0, 0, 0), 0)  # filled when the arm was elsewhere
    device = opened(arm)
    assert device.driver.reading.raw == arm.mechanics.counters
    assert [sample and sample.age_ticks for sample in hold(device, 3)] == [None, 1, 1]


def test_a_device_that_was_closed_is_opened_again_where_it_is_now() -> None:
    """The answer to the last request of the last session still waits in the device."""
    arm = firmware(hand="tremor")
    device = emulated(arm)
    for begin in (0, 300):
        device.open(RATE_HZ)
        hold(device, range(begin, begin + 200))
        assert device.driver.reading.raw == pytest.approx(arm.mechanics.counters, abs=30)
        device.close()
    assert arm.due(arm.now_ns) != []


@pytest.mark.parametrize(
    ("verb", "count"), [("model", "bytes skipped"), ("short", "bytes skipped"), ("deaf", "reply late")]
)
def test_reports_that_are_none_are_counted_and_take_the_force_off(verb: str, count: str) -> None:
    arm = firmware()
    device = opened(arm)
    hold(device, 20, (1.0, 0.0, 0.0))
    arm.fault(verb)
    samples = hold(device, range(20, 720), (1.0, 0.0, 0.0))
    assert samples[1:] == [None] * 699
    assert device.counts[count] >= 1
    assert arm.mechanics.force_n == (0.0, 0.0, 0.0)


def test_the_firmware_of_2016_is_followed_but_never_pushed() -> None:
    arm = firmware("mbed8", hand="tremor")
    device = opened(arm)
    sample = hold(device, 100, (3.0, 3.0, 3.0))[-1]
    assert sample.position_m == pytest.approx(device.position_m, abs=1e-3)
    assert arm.mechanics.peak_force_n == 0.0
    assert device.counts["force limited to the motors"] >= 99


def test_a_teensy_is_driven_alike() -> None:
    one, other = opened(firmware()), opened(firmware("teensy64"))
    assert hold(one, 50, (1.0, 0.5, 0.0)) == hold(other, 50, (1.0, 0.5, 0.0))
    assert (one.position_m, one.force_n) == (other.position_m, other.force_n)


def test_calibration_of_a_polhem_loads_its_gimbal_s_home_counts_too() -> None:
    """Those of polhem_v3, 0, 30, 0: before, the gimbal's were made zero."""
    for name, gimbal, counters in (
        ("polhem", [0, 30, 0], (8327, -10926, 27140)),
        ("woodenhaptics", [0, 0, 0], MODEL.home_counts),  # of an arm without one they are made zero
    ):
        arm = firmware(name=name)
        arm.mechanics.carry(arm.mechanics.home_m)
        arm.gimbal = [7, -11, 300]
        emulated(arm, "pose=stored", name=name).driver.calibrate("today")
        assert arm.gimbal == gimbal
        assert arm.mechanics.counters == counters


def test_calibration_loads_the_home_counts_and_holds_until_it_is_unplugged() -> None:
    """Powered up somewhere, the arm is wrong by where that was, until it stood in its home pose and was told so."""
    arm = firmware()
    arm.mechanics.load((123.0, -45.0, 6.0))
    notebook = Notebook()
    device = emulated(arm, "pose=stored", notebook=notebook)
    with pytest.raises(DeviceError, match="its pose is not known"):
        device.open(RATE_HZ)
    calibration = device.driver.calibrate("today")
    there = {"device": "hid:woodenhaptics", "model": "woodenhaptics", "home_counts": MODEL.home_counts}
    assert calibration == Calibration(**there, offset_counts=(0, 0, 0), stamp="plugging 1", made="today")
    assert arm.mechanics.counters == MODEL.home_counts
    notebook.keep(calibration)
    arm.fault("unplug")
    arm.mend()
    with pytest.raises(DeviceError, match="plugged in again"):
        device.open(RATE_HZ)
