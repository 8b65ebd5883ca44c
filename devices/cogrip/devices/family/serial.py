"""The family `serial:` and its query keys."""

from collections.abc import Mapping
from typing import Literal

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.exchange import ByteLine, RequestExchange
from cogrip.devices.arm.model import ArmModel, ArmSettings
from cogrip.devices.arm.models import MODELS
from cogrip.devices.arm.pose import Store
from cogrip.devices.device import Device, DeviceError
from cogrip.devices.io.line_names import SERIAL_LINE
from cogrip.devices.registry import Family
from cogrip.devices.serial.frames import MODELS as NUMBERS
from cogrip.devices.serial.frames import BracketCodec
from cogrip.devices.settings import Address, Setting, check_axes, read_query


class SerialSettings(ArmSettings, frozen=True, kw_only=True):
    """Query keys. model: what the device must say that it is; without one it is asked, and believed."""

    model: Literal["", "polhem", "vintage", "woodenhaptics-serial"] = ""


def family() -> Family:
    """The family `serial:`, for the registry."""
    what = f"arms on a serial line (hfab protocol: Polhem, vintage Phantom, WoodenHaptics): serial:{SERIAL_LINE}?model=vintage"
    examples = tuple(f"serial:{SERIAL_LINE}?model={name}" for name in NUMBERS.values())
    return Family(what, make, examples, real=True, stand_ins=tuple(f"emulated:{name}" for name in NUMBERS.values()))


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; the line is not opened yet. Raises DeviceError for unknown keys and values out of bounds."""
    from cogrip.devices.io.calibration_store import CalibrationStore
    from cogrip.devices.io.serial_line import SerialLine

    if not address.name:
        raise DeviceError(
            f"{address.text!r}: name the port, such as serial:{SERIAL_LINE}; `cogrip devices find` lists them"
        )
    return drive(SerialLine(address.name, "serial"), f"serial:{address.name}", CalibrationStore(), address, axes)


def drive(line: ByteLine, name: str, store: Store, address: Address, axes: int) -> ArmDevice:
    """The driver on a line of whatever kind."""
    where = repr(address.text)
    check_axes(axes, where)
    settings = read_query(SerialSettings, address.query, where)

    def known(said: str) -> ArmModel:
        if said not in NUMBERS.values():
            raise DeviceError(
                f"{name}: it says that it is {said}; known are {', '.join(NUMBERS.values())}. Update cogrip or its firmware"
            )
        if settings.model and said != settings.model:
            raise DeviceError(
                f"{name}: it says that it is {said}, not {settings.model}; correct the key model, or the port"
            )
        return MODELS[said].with_settings(settings, where)

    stated = known(settings.model) if settings.model else None
    return ArmDevice(name, axes, RequestExchange(line, BracketCodec()), known, settings.pose, stated, store)
