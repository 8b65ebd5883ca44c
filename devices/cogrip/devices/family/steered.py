"""The families `spacemouse:` and `gamepad:`, and their query keys."""

from collections.abc import Mapping

from cogrip.devices.device import Device
from cogrip.devices.io.line_names import EVENT_FILE, HID_DEVICE
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, keys_of, read_settings, unknown
from cogrip.devices.steered import gamepad, spacemouse
from cogrip.devices.steered.steered_device import ControllerBytes, SteeredDevice, SteeredSettings
from cogrip.devices.web.hand import PointerSettings

IDLE = "idle"


def spacemouse_family() -> Family:
    """The family `spacemouse:`, for the registry."""
    which = f", or ?path={HID_DEVICE}" if HID_DEVICE else ""
    what = f"3Dconnexion SpaceMouse and its like, by hidapi: spacemouse: for the only one{which}"
    example = f"spacemouse:{HID_DEVICE}"
    return Family(what, make, (example,), stand_ins=(f"spacemouse:{IDLE}",), real=True, input_only=True)


def gamepad_family() -> Family:
    """The family `gamepad:`, for the registry."""
    which = f", or gamepad:{EVENT_FILE}" if EVENT_FILE else ""
    what = f"gamepads and joysticks of Linux: gamepad: for the first one{which}"
    examples = (f"gamepad:{EVENT_FILE}",) if EVENT_FILE else ()  # no other system has one
    return Family(what, make, examples, stand_ins=(f"gamepad:{IDLE}",), real=True, input_only=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A device; its controller is not looked for yet. Raises DeviceError for unknown keys, and values out of bounds."""
    where = repr(address.text)
    check_axes(axes, where)
    query: dict[str, Setting] = {**defaults, **address.query}
    ours, hands = keys_of(SteeredSettings), keys_of(PointerSettings)
    for key in query:
        if key not in ours and key not in hands:
            raise unknown("key", key, (*ours, *hands), where)
    settings = read_settings(SteeredSettings, {key: query[key] for key in query if key in ours}, where)
    pointer = read_settings(PointerSettings, {key: query[key] for key in query if key in hands}, where)
    buttons = gamepad.BUTTONS if address.scheme == "gamepad" else spacemouse.MOST_BUTTONS
    return SteeredDevice(address.scheme, settings, pointer, axes, buttons, _link(address, settings))


def _link(address: Address, settings: SteeredSettings) -> ControllerBytes | None:
    name = f"{address.scheme}:{address.name}"
    if address.name == IDLE:
        return None
    if address.scheme == "gamepad":
        from cogrip.devices.io.event_file import EventFile

        return EventFile(name, address.name or settings.path)
    from cogrip.devices.io.hid_reports import HidReports

    return HidReports(name, address.name or settings.path, settings.serial)
