"""Detection of connected devices from the system's own lists: no device is opened, so nothing moves."""

import os
import socket
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from cogrip.devices.device import DeviceError
from cogrip.devices.haply.models import MODELS as HAPLY_MODELS
from cogrip.devices.hid.enumeration import VARIANTS, Found, Variant, choose
from cogrip.devices.hid.models import NAMES as HID_NAMES
from cogrip.devices.inverse.models import DEFAULT as INVERSE_SERVICE
from cogrip.devices.io.event_file import found_gamepads
from cogrip.devices.io.hid_line import found_devices, load_hidapi
from cogrip.devices.io.hid_reports import MULTI_AXIS
from cogrip.devices.io.platform import LINUX
from cogrip.devices.steered.spacemouse import USB_IDS
from cogrip.protocol.texts import shown

BY_ID = Path("/dev/serial/by-id")
TEENSY_SERIAL = (0x16C0, 0x0483)
LOOK_S = 0.2  # longest wait for a service on this machine
INPUT_ONLY = "input only, no force reaches the hand"
USUAL_HID = "woodenhaptics"
ARDUINO_VID = 0x2341
HAPLY_BOARDS = {0x003E: "Arduino Due", 0x804D: "Arduino Zero", 0x804E: "Arduino M0 Pro", 0x804F: "Arduino M0"}
"""Product numbers of the native ports that Haply's boards have; most Arduinos with them are something else."""


@dataclass(frozen=True, slots=True)
class PluggedIn:
    """One device. address: what to name it by; "" where it is not known to be one of ours."""

    address: str
    text: str


def plugged_in_lines(ports: Iterable[ListPortInfo], links: Mapping[str, str]) -> list[PluggedIn]:
    """The devices among serial ports. links: device node -> a name for it that stays when others are plugged in."""
    return [
        _plugged_in(port, links.get(port.device, port.device)) for port in sorted(ports, key=lambda port: port.device)
    ]


def _plugged_in(port: ListPortInfo, path: str) -> PluggedIn:
    number = "" if port.vid is None else f" {port.vid:04x}:{port.pid or 0:04x}"
    said = shown(f"{port.product or 'serial port'}{number} at {port.device}") + (
        f", serial number {shown(port.serial_number)}" if port.serial_number else ""
    )
    if (port.vid, port.pid) == TEENSY_SERIAL:
        return PluggedIn(
            f"serial:{path}", f"{said}: a Teensy; if it is an arm with hfab firmware it says which when it is opened"
        )
    if port.vid == ARDUINO_VID and port.pid in HAPLY_BOARDS:
        models = " or ".join(HAPLY_MODELS)
        return PluggedIn(
            f"haply:{path}",
            f"{said}: an {HAPLY_BOARDS[port.pid]}, as Haply's boards are; it does not say which arm it drives:"
            f" add ?model={models}",
        )
    return PluggedIn("", f"{said}: unknown device; only you can say whether it is one of ours")


def hid_devices(found: Iterable[Found]) -> list[PluggedIn]:
    """The arms among HID interfaces: one line a device, with the key that tells it from its like."""
    lines = {each.path: _hid(each, variant) for each in found for variant in _variants(each)[:1]}
    return [lines[path] for path in sorted(lines)]


def _variants(each: Found) -> list[str]:
    """The firmwares it may have, the usual one first."""
    return [name for name, variant in VARIANTS.items() if _may_be(each, variant)]


def _may_be(each: Found, variant: Variant) -> bool:
    try:
        choose([each], variant, "hid")
    except DeviceError:
        return False
    return True


def _hid(each: Found, variant: str) -> PluggedIn:
    key = f"serial={shown(each.serial)}" if each.serial else f"path={each.path}"
    older = [f"variant={name}" for name in _variants(each)[1:]]
    said = shown(f"{each.product or 'HID device'} {VARIANTS[variant].usb_text} at {each.path}")
    text = f"{said}: reports as a WoodenHaptics has; which arm it is only you can say: {', '.join(HID_NAMES)}" + (
        f"; old firmware wants {' or '.join(older)}" if older else ""
    )
    return PluggedIn(f"hid:{USUAL_HID}?variant={variant}&{key}", text)


def stable_names(folder: Path = BY_ID) -> dict[str, str]:
    """Device node -> its link in `folder`, which does not change with the order of plugging in. Linux; elsewhere none."""
    try:
        links = sorted(folder.iterdir())
    except OSError:
        return {}
    return {os.path.realpath(link): str(link) for link in links}


def _find_serial() -> list[PluggedIn]:
    """List serial ports without those of the mainboard, behind which nothing can be detected."""
    ports = [port for port in list_ports.comports() if port.vid is not None or not LINUX]
    return plugged_in_lines(ports, stable_names())


def _find_hid() -> list[PluggedIn]:
    """Raises DeviceError where hidapi cannot be had."""
    hidapi = load_hidapi("auto", "hid")
    usb_ids = dict.fromkeys(variant.usb_id for variant in VARIANTS.values())
    return hid_devices(each for usb_id in usb_ids for each in found_devices(hidapi, usb_id))


def spacemice(found: Iterable[Found]) -> list[PluggedIn]:
    """The SpaceMouse devices among HID interfaces."""
    lines = {
        each.path: PluggedIn(
            f"spacemouse:{each.path}",
            shown(f"{each.product or USB_IDS[each.usb_id]} at {each.path}") + f": {INPUT_ONLY}",
        )
        for each in found
        if each.usage in ((0, 0), MULTI_AXIS)
    }
    return [lines[path] for path in sorted(lines)]


def _find_spacemice() -> list[PluggedIn]:
    """Raises DeviceError where hidapi cannot be had."""
    hidapi = load_hidapi("auto", "spacemouse")
    return spacemice(each for usb_id in USB_IDS for each in found_devices(hidapi, usb_id))


def _find_gamepads() -> list[PluggedIn]:
    return [PluggedIn(f"gamepad:{path}", f"{shown(name)}: {INPUT_ONLY}") for path, name in found_gamepads()]


def _find_service() -> list[PluggedIn]:
    """The Inverse service that listens here: nothing is asked of it."""
    host, port = INVERSE_SERVICE
    try:
        socket.create_connection((host, port), LOOK_S).close()
    except OSError:
        return []
    return [PluggedIn("inverse:", f"something listens at {host}:{port}, as Haply's Inverse service does")]


FINDERS: dict[str, Callable[[], list[PluggedIn]]] = {
    "serial ports": _find_serial,
    "HID devices": _find_hid,
    "SpaceMouse": _find_spacemice,
    "gamepads": _find_gamepads,
    "Inverse service": _find_service,
}
"""Kinds of devices, and the function that finds each. It may raise DeviceError, which says why it cannot."""
