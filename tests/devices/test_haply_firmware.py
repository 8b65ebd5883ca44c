"""The emulated board, held to what is known of its firmware; no driver is involved."""

import struct

import pytest

from cogrip.devices import make
from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.haply_firmware import HaplyFirmware, Joint
from cogrip.devices.emulated.mechanics import HeldTip, Mechanics
from cogrip.devices.haply.models import MODELS

MS = 1_000_000
JOINTS = (Joint(2, True), Joint(1, True))
SETUP = bytes.fromhex("01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45")
ZERO = bytes.fromhex("02 05 00 00 00 00 00 00 00 00")
TORQUES = bytes.fromhex("02 05 cd cc 4c 3d cd cc cc bc")  # +0.05 at port 1, -0.025 at port 2


def board(hand: str = "hold", **keys: object) -> HaplyFirmware:
    body = HeldTip(make(f"sim:phantom?hand={hand}", axes=3, resolution_m=0.0, friction_n=0.0, **keys))
    return HaplyFirmware(JOINTS, Mechanics(MODELS["2diy"], body), Faults())


def ask(firmware: HaplyFirmware, frame: bytes, at_ms: int) -> bytes:
    firmware.receive(frame, at_ms * MS)
    return b"".join(firmware.due(at_ms * MS))


def pushing() -> HaplyFirmware:
    """A board that was set up, and asked for torques."""
    firmware = board()
    ask(firmware, SETUP, 1)
    ask(firmware, TORQUES, 2)
    return firmware


def test_only_a_torque_frame_is_answered_with_id_and_angles_in_port_order() -> None:
    firmware = board()
    assert ask(firmware, b"\0\0", 1) == b""
    assert ask(firmware, SETUP, 2) == b""
    answer = ask(firmware, ZERO, 3)
    assert answer[0] == 5
    # cut to whole counts
    assert struct.unpack("<ff", answer[1:]) == pytest.approx((360 * 162 / 4880, 360 * 2277 / 4880))


def test_torques_go_to_the_motors_of_their_ports_within_twelve_bits_and_there_is_no_watchdog() -> None:
    firmware = pushing()
    held = firmware.torque_nm
    assert held == pytest.approx((-0.025, 0.05), abs=0.123 / 4095)
    assert abs(held[0]) <= 0.025
    firmware.advance(60_000 * MS)
    assert firmware.torque_nm == held
    assert firmware.mechanics.force_n != (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("asked_nm", "given_nm"),
    [
        (0.123, 0.123), (0.2, 0.123), (-50.0, -0.123), (float("inf"), 0.123), (float("-inf"), -0.123),
        (float("nan"), 0.0), (1e-5, 0.0),
    ],
)  # fmt: skip
def test_torque_is_clamped(asked_nm: float, given_nm: float) -> None:
    firmware = board()
    ask(firmware, SETUP, 1)
    ask(firmware, struct.pack("<BBff", 2, 5, asked_nm, 0.0), 2)
    assert firmware.torque_nm == pytest.approx((0.0, given_nm))


def test_neither_reset_nor_setup_takes_the_torque_away_but_zero_does() -> None:
    firmware = pushing()
    held = firmware.torque_nm
    assert ask(firmware, b"\0\5", 3) == b""
    assert firmware.torque_nm == held
    assert ask(firmware, ZERO, 4) == b"\5"  # it has forgotten its setup: no motor has this id
    assert firmware.torque_nm == held
    ask(firmware, SETUP, 5)
    assert firmware.torque_nm == held
    assert len(ask(firmware, ZERO, 6)) == 9
    assert firmware.torque_nm == (0.0, 0.0)
    assert firmware.mechanics.force_n == (0.0, 0.0, 0.0)


def test_zero_frame_of_another_id_erases_the_setup() -> None:
    """Its torques are read as four resets."""
    firmware = board()
    ask(firmware, SETUP, 1)
    assert ask(firmware, bytes((2, 6)) + bytes(8), 2) == b"\6"
    assert ask(firmware, ZERO, 3) == b"\5"


def test_frames_come_in_any_parts_and_after_what_is_no_command() -> None:
    firmware = board()
    for place, byte in enumerate(b"\xff\x03" + SETUP + TORQUES):
        firmware.receive(bytes((byte,)), place * MS)
    assert len(b"".join(firmware.due(40 * MS))) == 9
    assert firmware.torque_nm == pytest.approx((-0.025, 0.05), abs=0.123 / 4095)


@pytest.mark.parametrize(("ms", "answered"), [(1002, b""), (1003, b"\5")])
def test_missing_bytes_are_waited_for_a_second(ms: int, answered: bytes) -> None:
    firmware = board()
    ask(firmware, SETUP, 1)
    ask(firmware, TORQUES[:6], 2)
    assert firmware.torque_nm == (0.0, 0.0)
    firmware.advance(ms * MS)
    assert b"".join(firmware.due(ms * MS))[:1] == answered
    assert (firmware.torque_nm[1] > 0.04) == bool(answered)


def test_directions_are_stored_by_running_index_not_by_port() -> None:
    """Motors and encoders at ports 2 and 3: their directions go to 1 and 2."""
    firmware = board()
    setup = bytes((1, 5, 0b110, 0, 1, 0b110, 0, 1, 0, 0)) + struct.pack("<4f", 0.0, 4880.0, 0.0, 4880.0)
    ask(firmware, setup, 1)
    ask(firmware, struct.pack("<BBff", 2, 5, 0.1, 0.0), 2)
    assert firmware.torque_nm[0] == pytest.approx(0.1, abs=1e-4)  # port 2 got the 1 that was meant for port 3
    right = board()
    ask(right, bytes((1, 5, 3, 1, 0, 3, 1, 0, 0, 0)) + setup[10:], 1)
    ask(right, struct.pack("<BBff", 2, 5, 0.0, 0.1), 2)
    assert right.torque_nm[0] == pytest.approx(-0.1, abs=1e-4)


def test_analog_values_stand_before_the_angles_and_pwm_bytes_before_the_torques() -> None:
    firmware = board()
    setup = SETUP[:8] + bytes((1, 54, 1, 13)) + SETUP[10:]
    ask(firmware, setup, 1)
    answer = ask(firmware, TORQUES[:2] + b"\x80" + TORQUES[2:], 2)
    assert len(answer) == 13
    assert struct.unpack("<f", answer[5:9])[0] == pytest.approx(12.0, abs=0.08)
    assert firmware.torque_nm[1] == pytest.approx(0.05, abs=1e-4)


def test_angles_follow_the_arm_from_where_the_setup_found_it() -> None:
    firmware = board("sine&amplitude_m=0.02&direction=1,0.5")
    ask(firmware, SETUP, 1)
    bar, where = MODELS["2diy"].five_bar, firmware.mechanics.body
    before = bar.inverse(where.position_m)
    first = struct.unpack("<ff", ask(firmware, ZERO, 2)[1:])
    last = struct.unpack("<ff", ask(firmware, ZERO, 700)[1:])
    after = bar.inverse(where.position_m)
    turned_deg = [(new - old) * 180.0 / 3.141592653589793 for new, old in zip(after, before, strict=True)]
    assert max(map(abs, turned_deg)) > 2.0
    assert (last[1] - first[1], last[0] - first[0]) == pytest.approx(turned_deg[:2], abs=2 * 360 / 4880)


def test_with_the_power_setup_and_torque_go() -> None:
    firmware = pushing()
    firmware.fault("unplug")
    assert firmware.torque_nm == (0.0, 0.0)
    assert ask(firmware, ZERO, 3) == b""
    firmware.mend()
    assert ask(firmware, ZERO, 4) == b"\5"
