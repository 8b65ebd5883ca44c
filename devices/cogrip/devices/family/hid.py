"""The family `hid:` and its query keys: `hid:woodenhaptics?variant=mbed14&backend=hidraw&serial=...`."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.exchange import ByteLine, RequestExchange
from cogrip.devices.arm.model import ArmModel, ArmSettings
from cogrip.devices.arm.pose import Store
from cogrip.devices.device import Device
from cogrip.devices.hid.enumeration import VARIANTS
from cogrip.devices.hid.frames import CODECS
from cogrip.devices.hid.models import ARMS, NAMES
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query, unknown

NO_FORCE_N = 1e-9  # least force that a record can state, for a device that gives none
NO_LIMIT_MA = (0.0, 0.0, 0.0)


class HidSettings(ArmSettings, frozen=True, kw_only=True):
    """Query keys. variant: its firmware; "mbed8" is read only.

    backend       hidapi's; "auto" is hidraw on Linux, and elsewhere the one there is
    path, serial  which one, where there are several
    """

    variant: Literal["mbed14", "teensy64", "mbed8"] = "mbed14"
    backend: Literal["auto", "hidraw", "libusb"] = "auto"
    path: str = ""
    serial: str = ""


IDENTITY = ("variant", "path", "serial")
"""Keys that tell one device from another, so its calibration is kept under them."""


def family() -> Family:
    """The family `hid:`, for the registry."""
    what = "arms over USB HID (Polhem, WoodenHaptics): hid:woodenhaptics?variant=mbed14, teensy64, mbed8"
    return Family(
        what,
        make,
        tuple(f"hid:{name}" for name in NAMES),
        real=True,
        stand_ins=tuple(f"emulated:{model.record.model}" for model in ARMS.values()),
    )


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; the device is not looked for yet. Raises DeviceError for unknown names and keys, and values out of bounds."""
    from cogrip.devices.io.calibration_store import CalibrationStore
    from cogrip.devices.io.hid_line import HidLine

    settings = _settings(address)
    marks = [f"{key}={address.query[key]}" for key in IDENTITY if key in address.query]
    name = f"hid:{address.name}{'?' if marks else ''}{'&'.join(marks)}"
    line = HidLine(name, VARIANTS[settings.variant], settings.backend, settings.path, settings.serial)
    return drive(line, name, CalibrationStore(), address, axes)


def drive(line: ByteLine, name: str, store: Store, address: Address, axes: int) -> ArmDevice:
    """The driver on a line of whatever kind."""
    where = repr(address.text)
    check_axes(axes, where)
    settings = _settings(address)
    model = ARMS[address.name].with_settings(settings, where)
    if not VARIANTS[settings.variant].gives_force:
        model = _without_force(model)

    # a report does not say what arm it comes from: whatever it is, it is the one of the address
    return ArmDevice(
        name, axes, RequestExchange(line, CODECS[settings.variant]()), lambda _: model, settings.pose, model, store
    )


def _settings(address: Address) -> HidSettings:
    where = repr(address.text)
    if address.name not in NAMES:
        raise unknown("HID arm", address.name, NAMES, where)
    return read_query(HidSettings, address.query, where)


def _without_force(model: ArmModel) -> ArmModel:
    """Return an arm whose reports have neither force nor handle.

    Whoever reads the record knows that no force will come, and the driver counts what is asked for nevertheless.
    """
    record = replace(
        model.record, peak_force_n=NO_FORCE_N, continuous_force_n=NO_FORCE_N, buttons=0, gives_orientation=False
    )
    return replace(model, drive=replace(model.drive, limit_ma=NO_LIMIT_MA), record=record)
