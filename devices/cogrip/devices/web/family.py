"""The family `web:`: `web:pointer`, which a page moves, and `web:idle`, which nobody moves."""

from collections.abc import Mapping

from cogrip.devices.device import Device, DeviceError
from cogrip.devices.registry import Family
from cogrip.devices.settings import MOST_AXES, Address, Setting, keys_of, read_settings, unknown
from cogrip.devices.web.device import PointerLink, WebDevice, WebSettings
from cogrip.devices.web.hand import PointerSettings

NAMES = ("idle", "pointer")


def family() -> Family:
    """Return the family `web:`, for the registry."""
    what = "a pointer in a browser: `cogrip join LINK --device web`"
    return Family(what, make, ("web:pointer",), stand_ins=("web:idle",), real=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """Return a device. Raises DeviceError for an unknown name or key, or a value out of bounds."""
    where = repr(address.text)
    if address.name not in NAMES:
        raise unknown("web device", address.name, NAMES, where)
    if not 1 <= axes <= MOST_AXES:
        raise DeviceError(f"{where}: axes={axes} is out of 1 to {MOST_AXES}")
    query: dict[str, Setting] = {**defaults, **address.query}
    query.pop("hand", None)  # a simulated hand of the settings: here it is the pointer's
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
