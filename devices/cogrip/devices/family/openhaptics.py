"""The family `openhaptics:` and its query keys."""

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.device import Device, at_most
from cogrip.devices.openhaptics.mailbox import Mailbox
from cogrip.devices.openhaptics.models import CAUTIOUS, RECORDS
from cogrip.devices.openhaptics.openhaptics_device import HdDevice, OpenHapticsDevice
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query


class OpenHapticsSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys.

    model         what the device must be; without it any known one will do, within the limits of the weakest
    library       path of the HD library; without it the usual names are tried
    peak_force_n  largest force [N], where less than the model's is wanted
    """

    model: Literal["", "touch", "omni", "desktop", "premium1.0", "premium1.5", "premium3.0"] = ""
    library: str = ""
    peak_force_n: Annotated[float, Meta(gt=0.0, le=40.0)] | None = None


def family() -> Family:
    """The family `openhaptics:`, for the registry."""
    what = "Touch, Phantom Omni, Desktop, Premium (OpenHaptics): openhaptics:NAME?model=touch, NAME the vendor's"
    return Family(what, make, tuple(f"openhaptics:Default Device?model={model}" for model in RECORDS), real=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; the library is not loaded yet. No name is the vendor's default device.

    Raises DeviceError for unknown keys, values out of bounds, or a number of axes not 1 to 3.
    """
    where = repr(address.text)
    check_axes(axes, where)
    settings = read_query(OpenHapticsSettings, {**defaults, **address.query}, where)
    record = at_most(RECORDS[settings.model or CAUTIOUS].first(axes), settings.peak_force_n)

    def connect(mailbox: Mailbox) -> HdDevice:
        from cogrip.devices.io.hd_servo import servo_of

        return servo_of(settings.library).connect(address.name, mailbox)

    return OpenHapticsDevice(f"openhaptics:{address.name}", record, settings.model, connect)
