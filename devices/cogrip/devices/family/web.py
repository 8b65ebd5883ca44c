"""The family `web:`: names, keys, and the link to a page."""

from collections.abc import Mapping

from cogrip.devices.device import Device, DeviceError
from cogrip.devices.registry import Family
from cogrip.devices.settings import MOST_AXES, Address, Setting, keys_of, read_settings, unknown
from cogrip.devices.web.hand import PointerSettings
from cogrip.devices.web.web_device import PointerLink, WebDevice, WebSettings

NAMES = ("idle", "pointer")


def family() -> Family:
    """Return the family `web:`, for the registry."""
    what = "a pointer in a browser: `cogrip join LINK --device web`"
    return Family(what, make, ("web:pointer",), stand_ins=("web:idle",), real=True, input_only=True)


def public(address: str) -> str:
    """Return a device address without the link of this process, which is nobody else's business."""
    name, mark, query = address.partition("?")
    keys = [key for key in query.split("&") if not key.startswith("fd=")] if name.startswith("web:") else [query]
    return name + mark + "&".join(keys) if any(keys) else name


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """Return a device. Raises DeviceError for an unknown name or key, or a value out of bounds."""
    where = repr(public(address.text))
    if address.name not in NAMES:
        raise unknown("web device", address.name, NAMES, where)
    if not 1 <= axes <= MOST_AXES:
        raise DeviceError(f"{where}: axes={axes} is out of 1 to {MOST_AXES}")
    query: dict[str, Setting] = {**defaults, **address.query}
    ours, hands = keys_of(WebSettings), keys_of(PointerSettings)
    for key in query:
        if key not in ours and key not in hands:
            raise unknown("key", key, (*ours, *hands), where)
    settings = read_settings(WebSettings, {key: query[key] for key in query if key in ours}, where)
    pointer = read_settings(PointerSettings, {key: query[key] for key in query if key in hands}, where)
    link: PointerLink | None = None
    if address.name == "pointer" and settings.fd >= 0:
        from cogrip.devices.io.pointer_socket import PointerSocket  # a socket, only where there is one

        link = PointerSocket(settings.fd, where)
    return WebDevice(settings, pointer, axes, link)
