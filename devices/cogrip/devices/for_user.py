"""The device a user's settings ask for."""

from cogrip.devices.device import Device, defects_named
from cogrip.devices.first_axes import first_axes
from cogrip.devices.registry import make, record_of
from cogrip.protocol.settings import User

HANDLESS = ("sim:", "emulated:")  # devices that need a simulated hand


def address_of(user: User) -> str:
    """The user's device address; one that no real hand holds gets the user's `hand` (with its own keys)."""
    address = user.device
    if not address.startswith(HANDLESS) or "hand=" in address:
        return address
    return f"{address}{'&' if '?' in address else '?'}hand={user.hand}"


def make_for(user: User, axes: int) -> Device:
    """Made, not opened; the first axes of it, where its driver gives more. Raises DeviceError."""
    address = address_of(user)
    if address.startswith("sim:"):
        return make(address, axes=axes, mass_kg=user.device_mass_kg, damping_nspm=user.device_damping_nspm)
    device = make(address, axes=axes)
    record_of(device, address)
    return first_axes(device, axes)


def try_for(user: User, axes: int, rate_hz: int) -> None:
    """Make, open and close the user's device, to learn before a session whether it can be had. Raises DeviceError."""
    device = make_for(user, axes)
    with defects_named(repr(address_of(user)), "open"):
        device.open(rate_hz)
    with defects_named(repr(address_of(user)), "close"):
        device.close()
