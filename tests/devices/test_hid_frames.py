"""HID reports byte by byte in both directions, the choice among devices on the bus, and the addresses of the family."""

from math import inf, nan
from struct import pack, unpack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.device import DeviceError
from cogrip.devices.family.hid import family, make
from cogrip.devices.hid.enumeration import MOST_LISTED, USAGE, VARIANTS, Found, choose
from cogrip.devices.hid.frames import CODECS
from cogrip.devices.hid.models import NAMES
from cogrip.devices.settings import parse_address

from tests.devices.held_device import refused

INT16 = st.integers(-32768, 32767)
NOTHING = "00" + 14 * "00"


def frame(text: str) -> bytes:
    return bytes.fromhex(text)


def read(variant: str, report: bytes):
    codec = CODECS[variant]()
    [reading] = codec.feed(report)
    assert codec.skipped == 0
    return reading


def test_a_report_begins_with_the_counts() -> None:
    reading = read("mbed14", frame("90 01 d4 fe 38 18 2e 27 0c 00 fb ff 01 00"))
    assert (reading.raw, reading.error, reading.rejected, reading.model) == ((400, -300, 6200), "", False, "")
    assert (reading.gimbal, reading.buttons) == ((30, 12, -5), 1)


@pytest.mark.parametrize(
    ("d", "count", "buttons"), [(5000, 5000, 0), (5001, -4999, 1), (-5000, -5000, 0), (10000, 0, 1), (15000, 5000, 1)]
)
def test_both_sides_of_the_count_that_says_that_the_button_is_down(d: int, count: int, buttons: int) -> None:
    reading = read("mbed14", pack("<7h", 0, 0, 0, d, 1, 2, 0))
    assert (reading.gimbal, reading.buttons) == ((count, 1, 2), buttons)


def test_requests() -> None:
    codec = CODECS["mbed14"]()
    assert codec.encode((0, 0, 0)) == frame(NOTHING)
    assert codec.load((0.0, 0.0, 6000.0, 0.0, 0.0, 0.0)) == frame("00 00 00 00 00 00 00 01 00 00 00 00 00 70 17")
    assert codec.encode((-1143, 578, 358)) == frame("00 89 fb 42 02 66 01") + bytes(8)
    assert codec.encode((1.9, -1.9, 0.5)) == codec.encode((1, -1, 0)), "truncated towards zero"


def test_a_teensy_has_the_same_in_64_bytes() -> None:
    short, long = CODECS["mbed14"](), CODECS["teensy64"]()
    for ask in (lambda codec: codec.encode((1, -2, 3)), lambda codec: codec.load((7, 8, 9, 1, 2, 3))):
        assert ask(long) == ask(short) + bytes(50)
    report = frame("90 01 d4 fe 38 18 2e 27 0c 00 fb ff 01 00")
    assert read("teensy64", report + b"\xa5" * 50) == read("mbed14", report)


def test_the_firmware_of_2016_is_read_but_never_driven() -> None:
    codec = CODECS["mbed8"]()
    for commands in ((0, 0, 0), (-1143, 578, 358), (6000, 6000, 6000), (nan, inf, 0.0)):
        assert codec.encode(commands) == bytes(9)
    assert codec.load((0, 0, 6000, 0, 0, 0)) is None
    # its encoders count the other way round
    assert read("mbed8", pack("<3hH", 10, -20, 30, 65535)).raw == (-10, 20, -30)


@given(st.tuples(*[INT16] * 7))
def test_what_the_firmware_sends_is_what_is_read(sent: tuple[int, ...]) -> None:
    assert read("mbed14", pack("<7h", *sent)).raw == sent[:3]


@given(st.tuples(INT16, INT16, INT16))
def test_what_is_asked_for_is_what_the_firmware_reads(values) -> None:
    codec = CODECS["mbed14"]()
    assert unpack("<B7h", codec.encode(values)) == (0, *values, 0, 0, 0, 0)
    assert unpack("<B7h", codec.load((*values, 0, 30, -7))) == (0, 0, 30, -7, 1, *values)


@pytest.mark.parametrize("value", [32768, -32769, 1e300, nan, inf, -inf])
def test_what_no_report_can_hold_is_an_error_and_never_another_force(value: float) -> None:
    codec = CODECS["mbed14"]()
    for values in ((0, value, 0), (0, value, 0, 0, 0, 0), (0, 0, 0, 0, value, 0)):
        ask = codec.encode if len(values) == 3 else codec.load
        with pytest.raises(DeviceError, match="-32768 to 32767"):
            ask(values)
    for value_inside in (32767, -32768):
        assert len(codec.encode((0, value_inside, 0))) == 15


@given(st.binary(max_size=80))
def test_reports_of_another_length_are_skipped_and_counted(data: bytes) -> None:
    for name, variant in VARIANTS.items():
        codec = CODECS[name]()
        readings = codec.feed(data)
        assert len(readings) == (len(data) == variant.report_bytes)
        assert codec.skipped == (len(data) not in (0, variant.report_bytes))
        codec.reset()


def listed(serial: str = "1", **own) -> Found:
    facts = {"path": f"/dev/hidraw{serial}", "usb_id": (0x1234, 0x0006), "serial": serial, "product": "HID DEVICE"}
    return Found(**{**facts, "usage": USAGE, **own})


def pick(*found: Found, variant: str = "mbed14", **asked: str) -> Found:
    return choose(found, VARIANTS[variant], "hid:woodenhaptics", **asked)


def test_the_only_one_is_chosen_whatever_else_is_plugged_in() -> None:
    mouse = listed("9", usb_id=(0x046D, 0xC077))
    keys = listed("1", usage=(1, 6), path="/dev/hidraw8")
    assert pick(mouse, keys, listed("1")) == listed("1")
    assert pick(listed("1"), listed("1")) == listed("1")  # hidapi lists one node once for every usage it has


def test_one_of_several_is_chosen_by_serial_or_path() -> None:
    both = listed("1"), listed("2")
    with refused("2 devices 1234:0006", "hidraw1 serial=1; path=/dev/hidraw2 serial=2; choose by serial="):
        pick(*both)
    assert pick(*both, serial="2") == both[1]
    assert pick(*both, path="/dev/hidraw1") == both[0]
    alike = listed("1"), listed("1", path="/dev/hidraw2")  # mbed boards all have the same serial number
    with pytest.raises(DeviceError, match="choose by path="):
        pick(*alike, serial="1")
    with pytest.raises(DeviceError, match=r"none of the devices 1234:0006 has serial=3; there are: path=/dev/hidraw1"):
        pick(*both, serial="3")
    with pytest.raises(DeviceError, match="path=/dev/hidraw1 serial=2"):
        pick(*both, path="/dev/hidraw1", serial="2")


def test_another_mbed_board_is_refused_by_its_product_string() -> None:
    with pytest.raises(DeviceError, match=r"'Balance Toy', not 'HID DEVICE'"):
        pick(listed(product="Balance Toy"))
    assert pick(listed(product="")).serial == "1"  # libusb cannot read it before it may open the device
    teensy = listed(product="Teensyduino RawHID", usb_id=(0x16C0, 0x0486))
    assert pick(teensy, variant="teensy64") == teensy


@pytest.mark.parametrize("tells", [True, False])
def test_a_teensys_debug_interface_is_left_alone(tells: bool) -> None:
    ours, debug = (
        listed(path=path, usb_id=(0x16C0, 0x0486), usage=usage if tells else (0, 0), interface=number)
        for number, path, usage in ((0, "1-2:1.0", USAGE), (1, "1-2:1.1", (0xFFC9, 0x0004)))
    )
    assert pick(debug, ours, variant="teensy64") == ours
    with pytest.raises(DeviceError, match="no device 16c0:0486"):
        pick(debug, variant="teensy64")


def test_none_there_names_the_cure() -> None:
    with pytest.raises(DeviceError, match=r"hid:woodenhaptics: no device 1234:0006 is there; plug it in.*udev"):
        pick()


def test_a_long_list_is_cut() -> None:
    many = [listed(str(number)) for number in range(100)]
    with pytest.raises(DeviceError, match=f"100 devices.*and {100 - MOST_LISTED} more; choose") as caught:
        pick(*many)
    assert len(str(caught.value)) < 600


def made(text: str):
    return make(parse_address(text), 3, {})


def test_every_arm_of_the_family_is_made_without_touching_hardware() -> None:
    assert {"woodenhaptics", "polhem"} <= set(NAMES)
    assert make(parse_address("hid:polhem"), 3, {}).model.home_counts == (8327, -10926, 27140)
    for address in family().examples:
        record = made(address).capability
        assert (record.family, record.axes, record.latency_ticks) == ("hid", 3, 1)


def test_the_read_only_variant_promises_no_force() -> None:
    record = made("hid:woodenhaptics?variant=mbed8").capability
    assert 0.0 < record.continuous_force_n == record.peak_force_n < 1e-6
    assert made("hid:woodenhaptics").capability.peak_force_n == 5.0
