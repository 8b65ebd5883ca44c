"""The machines that can be emulated: which firmware, on which arm, for which driver."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from cogrip.devices.arm.exchange import ByteLine
from cogrip.devices.arm.model import ArmModel, ArmSettings
from cogrip.devices.arm.models import MODELS
from cogrip.devices.arm.pose import Store
from cogrip.devices.device import Device, DeviceError
from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.emulated.haply_firmware import HaplyFirmware, Joint
from cogrip.devices.emulated.hfab_firmware import HfabFirmware
from cogrip.devices.emulated.hid_firmware import HidFirmware
from cogrip.devices.emulated.inverse_service import MODEL as INVERSE3
from cogrip.devices.emulated.inverse_service import InverseService
from cogrip.devices.emulated.mechanics import HeldTip, Mechanics
from cogrip.devices.family.haply import drive as drive_haply
from cogrip.devices.family.hid import drive as drive_hid
from cogrip.devices.family.inverse import InverseSettings
from cogrip.devices.family.inverse import drive as drive_inverse
from cogrip.devices.family.serial import SerialSettings
from cogrip.devices.family.serial import drive as drive_serial
from cogrip.devices.haply.models import MODELS as HAPLY
from cogrip.devices.haply.models import HaplySettings
from cogrip.devices.hid.models import ARMS as HID_ARMS
from cogrip.devices.registry import make
from cogrip.devices.serial.frames import MODELS as SERIAL_NUMBERS
from cogrip.devices.settings import Address, Setting, keys_of
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.machine.rows import Vector

BODY_AXES = 3


@dataclass(frozen=True, slots=True)
class EmulatedMachine:
    """scheme: of the real device's family. keys: those that are the driver's; all others are the body's and its hand's."""

    scheme: str
    firmware: Callable[[str, HeldTip, int, Vector | None], Firmware]
    drive: Callable[[ByteLine, str, Store, Address, int], Device]
    keys: tuple[str, ...]
    model: ArmModel
    reports: bool = False


def _hfab(name: str, body: HeldTip, seed: int, powered_at_m: Vector | None) -> Firmware:
    number = next(number for number, known in SERIAL_NUMBERS.items() if known == name)
    return HfabFirmware(number, Mechanics(MODELS[name], body, powered_at_m), Faults(seed))


MACHINES: dict[str, EmulatedMachine] = {
    name: EmulatedMachine("serial", _hfab, drive_serial, keys_of(SerialSettings), MODELS[name])
    for name in SERIAL_NUMBERS.values()
}


def _hid(name: str, body: HeldTip, seed: int, powered_at_m: Vector | None) -> Firmware:
    return HidFirmware(Mechanics(MODELS[name], body, powered_at_m), Faults(seed, reports=True))


def _drive_hid(line: ByteLine, name: str, store: Store, address: Address, axes: int) -> Device:
    return drive_hid(line, name, store, replace(address, name=address.name.removesuffix("-hid")), axes)


MACHINES |= {
    model.record.model: EmulatedMachine("hid", _hid, _drive_hid, keys_of(ArmSettings), model, reports=True)
    for model in HID_ARMS.values()
}


def _haply(name: str, body: HeldTip, seed: int, powered_at_m: Vector | None) -> Firmware:
    model = HAPLY[name]
    a, b = (Joint(port, ccw) for port, ccw in zip(model.wiring.ports, model.wiring.ccw, strict=True))
    return HaplyFirmware((a, b), Mechanics(model, body, powered_at_m), Faults(seed), homed=True)


def _drive_haply(line: ByteLine, name: str, store: Store, address: Address, axes: int) -> Device:
    return drive_haply(line, name, store, replace(address, query={**address.query, "model": address.name}), axes)


MACHINES |= {
    name: EmulatedMachine(
        "haply", _haply, _drive_haply, tuple(key for key in keys_of(HaplySettings) if key != "model"), model
    )
    for name, model in HAPLY.items()
}


def _inverse(name: str, body: HeldTip, seed: int, powered_at_m: Vector | None) -> Firmware:
    return InverseService(Mechanics(INVERSE3, body, powered_at_m), Faults(seed, reports=True))


def _drive_inverse(line: ByteLine, name: str, store: Store, address: Address, axes: int) -> Device:
    return drive_inverse(line, name, address.query, axes, repr(address.text))


MACHINES[INVERSE3.record.model] = EmulatedMachine(
    "inverse", _inverse, _drive_inverse, keys_of(InverseSettings), INVERSE3, reports=True
)


def make_firmware(
    name: str, body_keys: Mapping[str, Setting], seed: int = 1, powered_at_m: Vector | None = None
) -> Firmware:
    """The firmware of machine `name`, its arm in the hand that `body_keys` describe (those of sim:phantom).

    powered_at_m: where the tip was when its counters began; in the home pose if not given. Raises DeviceError.
    """
    machine = MACHINES[name]
    keys: dict[str, Setting] = {
        "resolution_m": 0.0,
        "peak_force_n": 100.0,
        "mass_kg": machine.model.record.apparent_mass_kg,
        **body_keys,
    }
    simulated = make("sim:phantom", axes=BODY_AXES, **keys)
    if not isinstance(simulated, SimulatedDevice):
        raise DeviceError("sim:phantom: is no simulated device any more")
    try:
        return machine.firmware(name, HeldTip(simulated), seed, powered_at_m)
    except ValueError as error:
        raise DeviceError(f"{name}: {error}") from None
