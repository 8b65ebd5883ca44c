"""Devices by address. One table of names; the module behind a name is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import cast

from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.settings import Address, Setting, parse_address, unknown

FAMILIES: dict[str, str] = {
    "replay": "cogrip.devices.replayed.family:family",
    "sim": "cogrip.devices.simulated.catalogue:family",
}
"""scheme -> "module:function"; the function takes nothing and gives a `Family`."""


MOST_AXES = 3


@dataclass(frozen=True, slots=True)
class Family:
    """What stands behind a scheme.

    make      (address, axes, defaults) -> device; settings in the address win over `defaults`
    axes      address -> how many axes what stands behind it has
    examples  addresses worth listing, each of which `make` accepts
    """

    summary: str
    make: Callable[[Address, int, Mapping[str, Setting]], Device]
    examples: tuple[str, ...]
    axes: Callable[[Address], int] = lambda _: MOST_AXES


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
    return _family(parsed.scheme, address).make(parsed, axes, defaults)


def axes_of(address: str) -> int:
    """How many axes the device at `address` has, at most MOST_AXES. Raises DeviceError."""
    parsed = parse_address(address)
    return _family(parsed.scheme, address).axes(parsed)


def families() -> dict[str, str]:
    """scheme -> what it is, for every scheme there is."""
    return {scheme: _family(scheme, scheme).summary for scheme in FAMILIES}


def describe(*, axes: int = 1) -> tuple[Listing, ...]:
    """Every address worth listing with its capability, made with `axes` axes and not opened."""
    found = [(_family(scheme, scheme), scheme) for scheme in FAMILIES]
    return tuple(
        Listing(address, family.summary, make(address, axes=axes).capability)
        for family, _ in found
        for address in family.examples
    )


def _family(scheme: str, where: str) -> Family:
    target = FAMILIES.get(scheme)
    if target is None:
        raise unknown("device scheme", scheme, FAMILIES, repr(where))
    module, _, function = target.partition(":")
    try:
        loaded = import_module(module)
    except ModuleNotFoundError as error:
        raise DeviceError(f"{where!r}: {scheme}: needs the package {error.name!r}, which is not installed") from error
    return cast("Callable[[], Family]", getattr(loaded, function))()
