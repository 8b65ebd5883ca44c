"""The family `replay:` and its query keys."""

from collections.abc import Mapping
from typing import Any

from cogrip.devices.device import Device, DeviceError
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query


def family() -> Family:
    """The family `replay:`, for the registry. It has no example: there is no recording everywhere."""
    what = "recorded people: replay:RUN#user=1 or replay:hand.csv#time=t_s&x=x_m, with speed, loop, start_s, stop_s"
    return Family(what, make, (), axes)


def axes(address: Address) -> int:
    """Return the number of recorded axes. Raises DeviceError."""
    if address.name.endswith(".csv"):
        return 1 + max((place for place, key in enumerate("xyz") if key in address.query), default=0)
    from cogrip.devices.simulated.recorded_motion import axes_of, find  # with numpy, as below

    return axes_of(find(address.name, address.query.get("user", "0")))


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A replay; the file is not looked into yet. Raises DeviceError for unknown keys and values out of bounds."""
    where = repr(address.text)
    if not address.name:
        raise DeviceError(f"{where}: name a run folder, a .mcap file or a .csv file, such as replay:runs/my-run#user=0")
    check_axes(axes, where)
    from cogrip.devices.replayed.replayed_device import ReplayedDevice
    from cogrip.devices.replayed.sources import RunSettings, RunSource, TableSettings, TableSource

    table = address.name.endswith(".csv")
    settings: Any = read_query(TableSettings if table else RunSettings, address.query, where)
    source = TableSource(address.name, settings) if table else RunSource(address.name, settings.user)
    return ReplayedDevice(address.text, axes, source, settings)
