"""The family `inverse:` and its query keys."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.arm.exchange import ByteLine
from cogrip.devices.arm.kinematics import Vector
from cogrip.devices.device import Capability, Device, DeviceError, at_most, encoder_record
from cogrip.devices.inverse.inverse_device import InverseDevice
from cogrip.devices.inverse.messages import BUTTONS, Dialect, InverseCodec
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query

DEFAULT = ("localhost", 10001)  # host and port of the service's simulation channel
HALF_M = (0.07, 0.11, 0.08)
RECORD: Capability = replace(
    encoder_record(
        "inverse", "inverse3", tuple((-half, half) for half in HALF_M), (4.0, 1.5), (600.0, 4.0), (5e-5, 0.15),
        rate_hz=1024, speed_mps=1.5, latency_ticks=1,
    ),
    buttons=len(BUTTONS), gives_orientation=True,
)  # fmt: skip
"""Nominal throughout: Haply's pages that we could read state none of it. Forces are well below the 10 N that is said of it."""

CENTRE_M: Vector = (0.15, 0.0, 0.16)
"""Middle of the workspace from the base's origin, in our axes: near the cursor positions in the service's own examples."""

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
