"""The family `emulated:`: the drivers of real devices on emulated ones, in virtual time.

emulated:vintage?hand=reach&faults=silence@2.5+0.3
"""

from collections.abc import Mapping

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import Device, DeviceError
from cogrip.devices.emulated.emulated_device import EmulatedDevice, Notebook, Planned
from cogrip.devices.emulated.emulated_line import EmulatedLine
from cogrip.devices.emulated.faults import VERBS
from cogrip.devices.emulated.mechanics import Mechanics
from cogrip.devices.family.machines import MACHINES, EmulatedMachine, make_firmware
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, unknown


def family() -> Family:
    """The family `emulated:`, for the registry."""
    what = "drivers of real devices on emulated ones, in virtual time; any hand of sim:, and faults=VERB@BEGIN_S+SECONDS,..."
    return Family(what, make, tuple(f"emulated:{name}" for name in MACHINES), axes)


def axes(address: Address) -> int:
    """Return the number of axes of that arm. Raises DeviceError."""
    return _machine(address).model.record.axes


def make(address: Address, count: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver and its firmware. The arm was powered up in its home pose, unless the key pose says otherwise.

    Raises DeviceError for unknown machines and keys, and values out of bounds.
    """
    where = repr(address.text)
    machine = _machine(address)
    query = dict(address.query)
    planned = [_planned(text, where) for text in query.pop("faults", "").split(",") if text]
    seed = query.pop("seed", "1")
    if not seed.isdigit():
        raise DeviceError(f"{where}: seed={seed!r} is not a whole number from 0 on")
    driver_keys = {key: query.pop(key) for key in machine.keys if key in query}
    if "pose" in machine.keys:
        driver_keys.setdefault("pose", "home")
    firmware = make_firmware(address.name, {**defaults, **query}, int(seed))
    name = f"emulated:{address.name}"
    line = EmulatedLine(name, firmware, reports=machine.reports)
    store = Notebook()
    driver = machine.drive(line, name, store, Address(address.text, address.scheme, address.name, driver_keys), count)
    if driver_keys.get("pose") == "stored" and isinstance(driver, ArmDevice):
        _calibrate(driver, firmware.mechanics, store)
    return EmulatedDevice(driver, firmware, planned, store)


def _machine(address: Address) -> EmulatedMachine:
    machine = MACHINES.get(address.name)
    if machine is None:
        raise unknown("emulated device", address.name, MACHINES, repr(address.text))
    return machine


def _calibrate(driver: ArmDevice, mechanics: Mechanics, store: Notebook) -> None:
    """Before the session: somebody puts the arm into its home pose, and takes it back to where the session begins."""
    start = mechanics.body.position_m
    mechanics.carry(mechanics.home_m)
    store.keep(driver.calibrate("before the session"))
    mechanics.carry(start)


def _planned(text: str, where: str) -> Planned:
    """`silence@2.5+0.3`: from 2.5 s on, for 0.3 s; for ever without the second number."""
    verb, _, times = text.partition("@")
    begin, plus, seconds = times.partition("+")
    if verb not in VERBS:
        raise unknown("fault", verb, VERBS, where)
    try:
        return Planned(verb, float(begin), float(seconds) if plus else float("inf"))
    except ValueError:
        raise DeviceError(f"{where}: faults={text!r}: write VERB@BEGIN_S+SECONDS, such as silence@2.5+0.3") from None
