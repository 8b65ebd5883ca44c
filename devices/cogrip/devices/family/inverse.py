"""The family `inverse:` and its query keys."""

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.arm.exchange import ByteLine
from cogrip.devices.device import Device, DeviceError, at_most
from cogrip.devices.inverse.inverse_device import InverseDevice
from cogrip.devices.inverse.messages import Dialect, InverseCodec
from cogrip.devices.inverse.models import CENTRE_M, DEFAULT, RECORD
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query

_Metres = Annotated[float, Meta(ge=-1.0, le=1.0)]


class InverseSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys.

    device, grip  the service's names of the Inverse3 and of the VerseGrip; without, the only one, and the first one
    centre_m      middle of the workspace from the base's origin: toward the user, right, up
    peak_force_n  largest force [N], where less than the record's is wanted
    command       name of the force in its command; auto: by the service's inventory
    uncalibrated  allow: also an Inverse3 that the service calls not calibrated
    """

    device: str = ""
    grip: str = ""
    centre_m: tuple[_Metres, _Metres, _Metres] = CENTRE_M
    peak_force_n: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    command: Dialect = "auto"
    uncalibrated: Literal["refuse", "allow"] = "refuse"


def family() -> Family:
    """The family `inverse:`, for the registry."""
    what = "Haply Inverse3 with VerseGrip, by Haply's Inverse service: inverse: or inverse:HOST:PORT?device=ID"
    return Family(what, make, ("inverse:localhost:10001",), stand_ins=("emulated:inverse3",), real=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; nothing is connected yet. Raises DeviceError for unknown keys and values out of bounds."""
    from cogrip.devices.io.websocket_line import WebsocketLine

    host, port = service_address(address)
    name = f"inverse:{address.name}"
    return drive(WebsocketLine(name, host, port), name, {**defaults, **address.query}, axes, repr(address.text))


def service_address(address: Address) -> tuple[str, int]:
    """Return where the service is. Raises DeviceError."""
    host, colon, port = address.name.rpartition(":") if ":" in address.name else (address.name, "", "")
    if colon and not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
        raise DeviceError(f"{address.text!r}: port {port!r} is not a number from 1 to 65535: inverse:localhost:10001")
    return host or DEFAULT[0], int(port) if colon else DEFAULT[1]


def drive(line: ByteLine, name: str, query: Mapping[str, Setting], axes: int, where: str) -> InverseDevice:
    """The driver on a line of whatever kind. Raises DeviceError."""
    check_axes(axes, where)
    settings = read_query(InverseSettings, query, where)
    codec = InverseCodec(settings.device, settings.grip, settings.command)
    record = at_most(RECORD.first(axes), settings.peak_force_n)
    return InverseDevice(name, record, line, codec, settings.centre_m, uncalibrated=settings.uncalibrated == "allow")
