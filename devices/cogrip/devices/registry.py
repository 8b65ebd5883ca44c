"""Devices by address. One table of names; the module behind a name is imported when it is asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points

from cogrip.devices.device import Capability, Device, DeviceError, defects_named
from cogrip.devices.settings import MOST_AXES, Address, Setting, parse_address, unknown

FAMILIES: dict[str, str] = {
    "emulated": "cogrip.devices.family.emulated:family",
    "forcedimension": "cogrip.devices.family.forcedimension:family",
    "gamepad": "cogrip.devices.family.steered:gamepad_family",
    "haply": "cogrip.devices.family.haply:family",
    "hid": "cogrip.devices.family.hid:family",
    "inverse": "cogrip.devices.family.inverse:family",
    "openhaptics": "cogrip.devices.family.openhaptics:family",
    "replay": "cogrip.devices.family.replayed:family",
    "serial": "cogrip.devices.family.serial:family",
    "sim": "cogrip.devices.family.simulated:family",
    "spacemouse": "cogrip.devices.family.steered:spacemouse_family",
    "web": "cogrip.devices.family.web:family",
}
"""scheme -> "module:function"; the function takes nothing and gives a `Family`."""

GROUP = "cogrip.devices"


@dataclass(frozen=True, slots=True)
class Family:
    """A device family: what an address scheme stands for.

    make      (address, axes, defaults) -> device; settings in the address win over `defaults`
    axes      address -> how many axes what stands behind it has
    examples  addresses worth listing, each of which `make` accepts
    real      hardware in real time, which no virtual time can hold
    input_only  no force reaches whoever moves it
    stand_ins addresses under which the same driver meets an emulated device in virtual time: what the conformance suite opens
    """

    summary: str
    make: Callable[[Address, int, Mapping[str, Setting]], Device]
    examples: tuple[str, ...]
    axes: Callable[[Address], int] = lambda _: MOST_AXES
    stand_ins: tuple[str, ...] = ()
    real: bool = False
    input_only: bool = False


@dataclass(frozen=True, slots=True)
class Listing:
    """One line of a list of devices."""

    address: str
    summary: str
    capability: Capability


def make(address: str, *, axes: int = 1, **defaults: Setting) -> Device:
    """The device at `address` (`scheme:name?key=value&...`), made but not opened.

    `defaults` are query keys used where the address is silent, checked the same way. Raises DeviceError, with the
    nearest right name and the list, for an unknown scheme, name or key; with the bound for a value that is out of it.
    """
    parsed = parse_address(address)
    family = _family(parsed.scheme, address)
    with defects_named(repr(address), "make"):
        return family.make(parsed, axes, defaults)


def record_of(device: Device, address: str) -> Capability:
    """The record of a device made of `address`. Raises DeviceError, also where the driver raises something else."""
    with defects_named(repr(address), "capability"):
        return device.capability


def axes_of(address: str) -> int:
    """Return the number of axes of the device at `address`, at most MOST_AXES. Raises DeviceError."""
    parsed = parse_address(address)
    family = _family(parsed.scheme, address)
    with defects_named(repr(address), "axes"):
        return family.axes(parsed)


def families() -> dict[str, str]:
    """scheme -> what it is, for every scheme there is."""
    return {scheme: _family(scheme, scheme).summary for scheme in _whole()}


def stand_ins() -> dict[str, tuple[str, ...]]:
    """scheme -> addresses that can be opened anywhere: its own examples, or its drivers on emulated devices."""
    found = {scheme: _family(scheme, scheme) for scheme in _whole()}
    return {scheme: family.stand_ins if family.real else family.examples for scheme, family in found.items()}


def describe(*, axes: int = 1) -> tuple[Listing, ...]:
    """Every address worth listing with its capability, made with `axes` axes and not opened."""
    return tuple(
        Listing(address, family.summary, make(address, axes=min(axes, axes_of(address))).capability)
        for family in (_family(scheme, scheme) for scheme in _whole())
        for address in family.examples
    )


def is_real(address: str) -> bool:
    """Return whether `address` names hardware, and none of the stand-ins of its driver. Raises DeviceError."""
    parsed = parse_address(address)
    family = _family(parsed.scheme, address)
    return family.real and f"{parsed.scheme}:{parsed.name}" not in family.stand_ins


def is_input_only(address: str) -> bool:
    """Return whether no force reaches the hand at `address`: it only moves a simulated mass. False for an unknown scheme."""
    scheme = parse_address(address).scheme
    return scheme in schemes() and _family(scheme, address).input_only


@cache
def schemes() -> Mapping[str, str]:
    """FAMILIES, and those that other packages name in the entry point group GROUP. Ours cannot be replaced."""
    others = {point.name: point.value for point in entry_points(group=GROUP)}
    return {**others, **FAMILIES}


def _family(scheme: str, where: str) -> Family:
    target = schemes().get(scheme)
    if target is None:
        raise unknown("device scheme", scheme, sorted(schemes()), repr(where))
    module, _, function = target.partition(":")
    try:
        family = getattr(import_module(module), function)()
    except ModuleNotFoundError as error:
        raise DeviceError(f"{where!r}: {scheme}: needs the package {error.name!r}, which is not installed") from error
    except Exception as error:
        if scheme in FAMILIES:
            raise
        raise DeviceError(
            f"{where!r}: the driver {target} fails as it is loaded: {error!r}; mend or remove its package"
        ) from error
    if not isinstance(family, Family):
        raise DeviceError(
            f"{where!r}: the driver {target} gives {type(family).__name__}, not a Family; mend or remove its package"
        )
    return family


def broken() -> dict[str, str]:
    """scheme -> what is wrong with the driver that another package brings under it."""
    found = {}
    for scheme in set(schemes()) - set(FAMILIES):
        try:
            _family(scheme, scheme)
        except DeviceError as error:
            found[scheme] = str(error)
    return found


def _whole() -> list[str]:
    """The schemes whose drivers can be had."""
    return sorted(set(schemes()) - set(broken()))
