"""SpaceMouse and gamepads by their bytes: reports over a local socket, events over a socket pair or pipe. Virtual time."""

import os
import socket
import struct
from itertools import pairwise
from math import hypot
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.devices import DeviceError
from cogrip.devices.hid.enumeration import Found
from cogrip.devices.io import event_file, hid_reports
from cogrip.devices.io.event_file import EventFile, found_gamepads
from cogrip.devices.io.platform import SEQUENCED
from cogrip.devices.io.plugged_in import INPUT_ONLY, spacemice
from cogrip.devices.registry import is_input_only
from cogrip.devices.steered import gamepad
from cogrip.devices.steered.gamepad import (
    ABS_RY,
    ABS_RZ,
    ABS_X,
    ABS_Y,
    BTN_GAMEPAD,
    EV_ABS,
    EV_KEY,
    EV_SYN,
    GamepadDecoder,
)
from cogrip.devices.steered.spacemouse import REPEAT_S, SpaceMouseDecoder
from cogrip.devices.steered.steered_device import MOST_MPS, Decoder, SteeredDevice, SteeredSettings
from cogrip.devices.web.hand import STRETCH_N, PointerSettings

from tests.devices.held_device import RATE_HZ, hold, opened, refused

RIGHT, TOWARD, DOWN = (350, 0, 0), (0, 350, 0), (0, 0, 350)
RANGES = {ABS_X: (0, 255), ABS_Y: (-32768, 32767), ABS_RY: (-32768, 32767)}


def report(x: int, y: int, z: int, more: bytes = b"") -> bytes:
    return struct.pack("<B3h", 1, x, y, z) + more


def event(kind: int, code: int, value: int) -> bytes:
    return struct.pack("@llHHi", 12, 34, kind, code, value)


class Held:
    """A link whose messages a test gives. shaken: strengths that were rumbled."""

    def __init__(self, decoder: Decoder) -> None:
        self.decoder = decoder
        self.waiting: list[bytes] = []
        self.shaken: list[float] = []
        self.gone = self.closed = False

    def open(self) -> Decoder:
        return self.decoder

    def receive(self) -> list[bytes]:
        if self.gone:
            raise DeviceError("spacemouse:: unplugged; plug it in again, then re-arm")
        waiting, self.waiting = self.waiting, []
        return waiting

    def rumble(self, strength: float) -> None:
        self.shaken.append(strength)

    def close(self) -> None:
        self.closed = True


def steered(decoder: Decoder, axes: int = 3, keys: SteeredSettings | None = None) -> tuple[SteeredDevice, Held]:
    link = Held(decoder)
    device = SteeredDevice("spacemouse", keys or SteeredSettings(), PointerSettings(), axes, 32, link)
    device.open(RATE_HZ)
    return device, link


def steer(device: SteeredDevice, link: Held, ticks: int, message: bytes) -> None:
    """So many ticks in each of which the device sends this."""
    for tick in range(ticks):
        link.waiting = [message]
        hold(device, range(tick, tick + 1))


@pytest.mark.parametrize(
    ("raw", "deflection"), [(RIGHT, (0.0, 1.0, 0.0)), (TOWARD, (1.0, 0.0, 0.0)), (DOWN, (0.0, 0.0, -1.0)),
                            ((-700, 35, 0), (0.1, -1.0, 0.0))],
)  # fmt: skip
@pytest.mark.parametrize("more", [b"", bytes(6)])
def test_a_cap_s_axes_are_ours(raw: tuple[int, int, int], deflection: tuple[float, ...], more: bytes) -> None:
    """Older models send 7 bytes, newer ones 13 with the rotations."""
    decoder = SpaceMouseDecoder()
    decoder.feed(report(*raw, more))
    assert decoder.deflection == pytest.approx(deflection)


def test_a_cap_s_buttons_are_bits() -> None:
    decoder = SpaceMouseDecoder()
    decoder.feed(bytes([3, 0b10, 0, 0, 0x80]))
    assert decoder.buttons == 1 << 1 | 1 << 31
    decoder.feed(bytes([3, 0]))
    assert decoder.buttons == 0
    for short in (b"", b"\x01\x00", b"\x03", bytes([1] * 6)):
        decoder.feed(short)
    assert decoder.refused == 4
    decoder.feed(bytes([2, 9, 9, 9, 9, 9, 9]))
    decoder.feed(bytes([23, 100]))  # a battery's
    assert decoder.refused == 4
    assert decoder.deflection == (0.0, 0.0, 0.0)


def test_a_stick_s_axes_are_ours_over_the_range_that_the_system_tells() -> None:
    decoder = GamepadDecoder(RANGES)
    decoder.feed(event(EV_ABS, ABS_X, 255) + event(EV_ABS, ABS_Y, 32767) + event(EV_ABS, ABS_RY, 32767))
    assert decoder.deflection == (1.0, 1.0, -1.0)
    decoder.feed(event(EV_ABS, ABS_X, 0) + event(EV_SYN, 0, 0))
    assert decoder.deflection == (1.0, -1.0, -1.0)
    decoder.feed(event(EV_KEY, BTN_GAMEPAD + 3, 1) + event(EV_KEY, BTN_GAMEPAD, 1) + event(EV_KEY, BTN_GAMEPAD, 0))
    assert decoder.buttons == 1 << 3
    decoder.feed(event(EV_KEY, 30, 1) + event(EV_ABS, 0x10, 1))  # a keyboard's, a hat's
    assert decoder.buttons == 1 << 3
    decoder.feed(event(EV_SYN, gamepad.SYN_DROPPED, 0))
    assert (decoder.deflection, decoder.buttons, decoder.dropped) == ((0.0, 0.0, 0.0), 0, 1)
    decoder.feed(event(EV_ABS, ABS_X, 255)[:-1])
    assert decoder.deflection == (0.0, 0.0, 0.0)
    assert decoder.refused == 2


def test_a_right_stick_that_is_told_as_rz_moves_the_third_axis() -> None:
    decoder = GamepadDecoder({ABS_X: (0, 255), ABS_Y: (0, 255), ABS_RZ: (0, 255)})
    decoder.feed(event(EV_ABS, ABS_RZ, 255))
    assert (decoder.deflection, decoder.lacks) == ((0.0, 0.0, -1.0), {})
    trigger = GamepadDecoder({**RANGES, ABS_RZ: (0, 255)})
    trigger.feed(event(EV_ABS, ABS_RZ, 255))
    assert trigger.deflection == (0.0, 0.0, 0.0)


def test_a_pad_without_a_right_stick_is_refused_where_the_third_axis_is_needed() -> None:
    pad = {ABS_X: (0, 255), ABS_Y: (0, 255)}
    with refused("nothing of it would move z: it has no ABS_RY or ABS_RZ", "object.axes = 2"):
        steered(GamepadDecoder(pad))
    steered(GamepadDecoder(pad), axes=2)


@pytest.mark.parametrize("sticks", [(ABS_X, ABS_Y), (ABS_X, ABS_Y, ABS_RZ), (ABS_X, ABS_Y, ABS_RY, ABS_RZ)])
def test_axes_that_there_are_not_have_a_range_of_0_to_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sticks: tuple[int, ...]
) -> None:
    """As EVIOCGABS answers."""
    monkeypatch.setattr(event_file, "LINUX", True)

    def control(file: int, request: int, data: bytes) -> bytes:
        return struct.pack("@6i", 0, 0, 255 if (request & 0xFF) - 0x40 in sticks else 0, 0, 0, 0)

    monkeypatch.setattr(event_file, "control", control)
    path = tmp_path / "event5"
    path.touch()
    link = EventFile("gamepad:", str(path))
    assert list(link.open().lacks) == ([] if len(sticks) > 2 else [2])
    link.close()


@settings(max_examples=60)
@given(st.lists(st.binary(max_size=80), max_size=20))
def test_no_bytes_make_a_decoder_raise_or_leave_the_unit_cube(stream: list[bytes]) -> None:
    for decoder in (SpaceMouseDecoder(), GamepadDecoder(RANGES), GamepadDecoder({ABS_X: (5, 5)})):
        for data in stream:
            decoder.feed(data)
            assert all(-1.0 <= part <= 1.0 for part in decoder.deflection)
            assert 0 <= decoder.buttons < 1 << 32


@pytest.mark.parametrize("speed_mps", [0.01, 0.15, MOST_MPS])
def test_the_mass_goes_as_fast_as_the_cap_says_and_stops_with_it(speed_mps: float) -> None:
    device, link = steered(SpaceMouseDecoder(), keys=SteeredSettings(speed_mps=speed_mps, dead=0.0))
    seconds = min(1.0, 0.05 / speed_mps + 0.25)
    ticks = round(seconds * RATE_HZ)
    steer(device, link, ticks, report(*TOWARD))
    assert device.velocity_mps[0] == pytest.approx(speed_mps, rel=0.03)
    assert device.velocity_mps[1:] == pytest.approx((0.0, 0.0), abs=1e-9)
    link.waiting = [report(0, 0, 0)]
    hold(device, range(ticks, ticks + 1024))
    assert hypot(*device.velocity_mps) < 1e-3


@pytest.mark.parametrize(("part", "moves"), [(27, False), (29, True)])
def test_less_than_the_dead_share_is_no_deflection(part: int, moves: bool) -> None:
    device, link = steered(SpaceMouseDecoder())
    steer(device, link, 200, report(part, 0, 0))
    assert (hypot(*device.position_m) > 0.0) is moves


def test_a_cap_that_falls_silent_while_it_is_deflected_stops_the_mass() -> None:
    device, link = steered(SpaceMouseDecoder())
    link.waiting = [report(*RIGHT)]
    silent = round(REPEAT_S * RATE_HZ) + 1
    hold(device, silent)
    assert device.velocity_mps[1] > 0.1
    assert not device.counts
    hold(device, range(silent, RATE_HZ))
    assert hypot(*device.velocity_mps) < 1e-3
    assert device.counts == {"silent while deflected: stopped": 1}


def test_a_stick_that_is_held_still_says_nothing_and_steers_on() -> None:
    device, link = steered(GamepadDecoder(RANGES))
    link.waiting = [event(EV_ABS, ABS_Y, 16000)]
    hold(device, 600)
    assert device.velocity_mps[0] > 0.05


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.integers(1, 120), st.tuples(*[st.integers(-32768, 32767)] * 3)), min_size=1, max_size=12),
    st.integers(1, 3),
    st.floats(-8.0, 8.0),
)
def test_whatever_the_cap_does_the_hand_is_passive(
    stream: list[tuple[int, tuple[int, int, int]]], axes: int, load_n: float
) -> None:
    """The work that the load takes out is at most the energy that steps of the set-point put in: that of the hand of `web:`."""
    device, link = steered(SpaceMouseDecoder(), axes)
    tick, out_j = 0, 0.0
    for ticks, raw in stream:
        link.waiting = [report(*raw)]
        for _ in range(ticks):
            before_m = device.position_m
            device.read(tick)
            if tick:
                out_j += load_n * sum(now - was for now, was in zip(device.position_m, before_m, strict=True))
            device.write((load_n,) * axes)
            tick += 1
            assert out_j <= device.pointer.entered_j + 1e-9
            low_high = device.capability.workspace_m
            assert all(low <= at <= high for at, (low, high) in zip(device.position_m, low_high, strict=False))


def test_an_unplugged_controller_is_a_fault_by_name() -> None:
    device, link = steered(SpaceMouseDecoder())
    hold(device, 10)
    link.gone = True
    with pytest.raises(DeviceError, match="unplugged; plug it in again, then re-arm"):
        device.read(10)
    device.close()
    assert link.closed


def test_a_load_is_rumbled_in_proportion_and_not_felt() -> None:
    device, link = steered(GamepadDecoder(RANGES), axes=1)
    hold(device, 100)
    assert link.shaken == []
    hold(device, range(100, 300), (0.5 * STRETCH_N,))
    hold(device, range(300, 500), (4.0 * STRETCH_N,))
    hold(device, range(500, 600))
    assert link.shaken == pytest.approx([0.25, 0.5, 0.0])
    assert all(now != was for now, was in pairwise(link.shaken))


def test_the_effect_and_its_play_have_the_kernel_s_layout() -> None:
    """struct ff_effect: type, id, direction, trigger, replay at 0 to 14; the union at 16, on 48 bytes."""
    effect = gamepad.rumble_effect(-1, 0.5)
    assert len(effect) == 48
    assert struct.unpack_from("@HhHHHHH", effect) == (0x50, -1, 0, 0, 0, 500, 0)
    assert struct.unpack_from("@HH", effect, 16) == (32768, 32768)
    assert gamepad.play(3, 1) == event(gamepad.EV_FF, 3, 1).replace(struct.pack("@ll", 12, 34), bytes(16))
    assert gamepad.EVENT_BYTES == 24


# --- links ------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not SEQUENCED, reason="needs local sockets that keep messages apart")
def test_a_cap_over_a_report_socket(tmp_path: Path) -> None:
    path = str(tmp_path / "cap")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as bus:
        bus.bind(path)
        bus.listen()
        device = opened(f"spacemouse:{path}", axes=2)
        cap, _ = bus.accept()
    with cap:
        device.read(0)
        cap.send(report(*RIGHT))
        cap.send(bytes([3, 1]))
        last = hold(device, range(1, 200))[-1]
    assert last.buttons == 1
    assert last.position_m[1] > 0.005
    with pytest.raises(DeviceError, match=r"spacemouse:.*: unplugged \(.*\); plug it in again, then re-arm"):
        device.read(201)
    device.close()


class Hidapi:
    """The part of the package hidapi that is used. opened: paths; a device reads what `waiting` holds."""

    def __init__(self, *found: tuple[str, str, tuple[int, int]]) -> None:
        self.found = found
        self.opened: list[bytes] = []
        self.waiting: list[list[int]] = []
        self.failure = ""

    def enumerate(self, vendor: int, product: int) -> list[dict[str, object]]:
        return [
            {"path": path.encode(), "vendor_id": vendor, "product_id": product, "serial_number": serial,
             "product_string": "", "usage_page": usage[0], "usage": usage[1], "interface_number": 0}
            for path, serial, usage in self.found
            if (vendor, product) == (0x256F, 0xC635)
        ]  # fmt: skip

    def device(self) -> "Hidapi":
        return self

    def open_path(self, path: bytes) -> None:
        if self.failure:
            raise OSError(self.failure)
        self.opened.append(path)

    def set_nonblocking(self, on: int) -> None:
        assert on == 1

    def read(self, longest: int) -> list[int]:
        if self.failure:
            raise OSError(self.failure)
        return self.waiting.pop(0) if self.waiting else []

    def close(self) -> None:
        self.opened.clear()


CAP, MOUSE = (1, 8), (1, 2)


def test_a_cap_by_hidapi_is_read_and_its_loss_told(monkeypatch: pytest.MonkeyPatch) -> None:
    hidapi = Hidapi(("/dev/hidraw4", "a", MOUSE), ("/dev/hidraw3", "a", CAP))
    monkeypatch.setattr(hid_reports, "load_hidapi", lambda *_: hidapi)
    device = opened("spacemouse:", axes=3)
    assert hidapi.opened == [b"/dev/hidraw3"]
    hidapi.waiting = [list(report(*RIGHT)), [3, 2]]
    assert device.read(0).buttons == 2
    hidapi.failure = "read error"
    with pytest.raises(DeviceError, match=r"spacemouse:: unplugged \(read error\); plug it in again, then re-arm"):
        device.read(1)
    device.close()
    assert hidapi.opened == []
    with pytest.raises(DeviceError, match=r"/dev/hidraw3 cannot be opened .*spacenavd.*configs/99-cogrip\.rules"):
        device.open(RATE_HZ)


def test_one_of_several_caps_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    hidapi = Hidapi(("/dev/hidraw3", "a", CAP), ("/dev/hidraw5", "b", CAP))
    monkeypatch.setattr(hid_reports, "load_hidapi", lambda *_: hidapi)
    with pytest.raises(DeviceError, match=r"2 are there: path=/dev/hidraw3 serial=a; .*choose by path= or serial="):
        opened("spacemouse:", axes=3)
    for address in ("spacemouse:?serial=b", "spacemouse:/dev/hidraw5"):
        hidapi.opened.clear()
        opened(address, axes=3)
        assert hidapi.opened == [b"/dev/hidraw5"]


@pytest.mark.skipif(os.name != "posix", reason="named pipes are POSIX")
def test_a_gamepad_over_a_pipe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe stands for the event file: it has no ranges to tell, so those of most gamepads hold, and no motors."""
    monkeypatch.setattr(event_file, "LINUX", True)
    path = tmp_path / "event5"
    os.mkfifo(path)
    device = opened(f"gamepad:{path}", axes=3)
    with path.open("wb", buffering=0) as pad:
        pad.write(event(EV_ABS, ABS_Y, 32767) + event(EV_KEY, BTN_GAMEPAD + 1, 1))
        assert hold(device, 300, (4.0 * STRETCH_N, 0.0, 0.0))[-1].buttons == 2
    device.close()


def test_no_gamepad_no_right_and_another_system_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_file, "LINUX", True)
    with pytest.raises(DeviceError, match=r"event5 cannot be opened \(No such file or directory\); plug it in"):
        EventFile("gamepad:", str(tmp_path / "event5")).open()
    monkeypatch.setattr(event_file, "found_gamepads", list)
    with refused("no gamepad is there; plug one in, or name its file: gamepad:/dev/input/event5"):
        EventFile("gamepad:", "").open()

    def refuse(*arguments: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(event_file.os, "open", refuse)
    with refused("may not be opened; give yourself the right to it by a udev rule ", "99-cogrip"):
        EventFile("gamepad:", str(tmp_path / "event5")).open()
    monkeypatch.setattr(event_file, "LINUX", False)
    with pytest.raises(DeviceError, match="read by Linux's event files"):
        EventFile("gamepad:", "").open()


def test_a_cap_that_is_not_there_is_told() -> None:
    with refused("no SpaceMouse of this path and serial number is there, of none; ", "99-cogrip"):
        opened("spacemouse:?serial=none-has-this", axes=3)


LISTING = """I: Bus=0003 Vendor=046d Product=c31c Version=0110
N: Name="A keyboard"
H: Handlers=sysrq kbd event0 leds

I: Bus=0003 Vendor=045e Product=028e Version=0114
N: Name="Microsoft X-Box 360 pad"
P: Phys=usb-0000:00:14.0-2/input0
H: Handlers=event5 js0
"""


def test_gamepads_are_found_in_the_system_s_list(tmp_path: Path) -> None:
    listing = tmp_path / "devices"
    listing.write_text(LISTING)
    assert found_gamepads(listing) == [("/dev/input/event5", "Microsoft X-Box 360 pad")]
    assert found_gamepads(tmp_path / "none") == []


def test_caps_are_found_among_hid_interfaces() -> None:
    cap = Found("/dev/hidraw3", (0x256F, 0xC635), usage=(1, 8))
    (found,) = spacemice([cap, Found("/dev/hidraw4", (0x256F, 0xC635), usage=(1, 2))])  # its mouse interface
    assert found.address == "spacemouse:/dev/hidraw3"
    assert found.text == f"SpaceMouse Compact at /dev/hidraw3: {INPUT_ONLY}"


def test_input_only_is_known_by_the_address() -> None:
    assert all(map(is_input_only, ("spacemouse:", "gamepad:", "web:pointer")))
    assert not any(map(is_input_only, ("inverse:", "sim:phantom", "nothing:")))
