"""The family `openhaptics:` and its query keys."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.device import Device, DeviceError
from cogrip.devices.openhaptics.device import Link, OpenHapticsDevice
from cogrip.devices.openhaptics.mailbox import Mailbox
from cogrip.devices.openhaptics.models import CAUTIOUS, RECORDS
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, keys_of, read_settings, unknown

MAX_AXES = 3


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
    what = (
        "Touch, Phantom Omni, Desktop, Premium (OpenHaptics): openhaptics:NAME?model=touch with the vendor's name of it"
    )
    return Family(what, make, tuple(f"openhaptics:Default Device?model={model}" for model in RECORDS), real=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; the library is not loaded yet. No name is the vendor's default device.

    Raises DeviceError for unknown keys, values out of bounds, or a number of axes not 1 to 3.
    """
    where = repr(address.text)
    if not 1 <= axes <= MAX_AXES:
        raise DeviceError(f"{where}: axes={axes} is out of 1 to {MAX_AXES}")
    query: dict[str, Setting] = {**defaults, **address.query}
    for key in query:
        if key not in keys_of(OpenHapticsSettings):
            raise unknown("key", key, keys_of(OpenHapticsSettings), where)
    settings = read_settings(OpenHapticsSettings, query, where)
    record = RECORDS[settings.model or CAUTIOUS].first(axes)
    if settings.peak_force_n is not None:
        peak = min(settings.peak_force_n, record.peak_force_n)
        record = replace(record, peak_force_n=peak, continuous_force_n=min(peak, record.continuous_force_n))

    def connect(mailbox: Mailbox) -> Link:
        from cogrip.devices.io.hd_servo import servo_of

        return servo_of(settings.library).connect(address.name, mailbox)

    return OpenHapticsDevice(f"openhaptics:{address.name}", record, settings.model, connect)
