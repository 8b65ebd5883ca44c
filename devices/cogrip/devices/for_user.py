"""The device a user's settings ask for. One of more axes than the room has is used by its first ones."""

from collections.abc import Mapping, Sequence

from cogrip.devices.device import Capability, Device, DeviceError, Sample, defects_named
from cogrip.devices.registry import make, record_of
from cogrip.protocol.axes import GRIP_AXES
from cogrip.protocol.settings.sections import User
from cogrip.protocol.settings.types import PINCH

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


def first_axes(device: Device, axes: int) -> Device:
    """`device` itself if it has just `axes` axes, else a view of its first ones. Raises DeviceError where it has fewer."""
    record = device.capability
    if axes == GRIP_AXES and record.gripper is None:
        raise DeviceError(
            f'{record.family}:{record.model} has no gripper with force, and the tool "{PINCH}" asks for one; take another'
            " device or tool"
        )
    if record.axes < axes:
        raise DeviceError(
            f"{record.family}:{record.model} has {record.axes} axes, and the room has {axes}; take another device, or set"
            f" object.axes={record.axes}"
        )
    return device if record.axes == axes else FirstAxes(device, axes)


class FirstAxes:
    """Samples are cut to `axes` values, forces filled up with zeros."""

    def __init__(self, device: Device, axes: int) -> None:
        self._device = device
        self._axes = axes
        self._rest = (0.0,) * (device.capability.axes - axes)

    @property
    def capability(self) -> Capability:
        return self._device.capability.first(self._axes)

    @property
    def counts(self) -> Mapping[str, int]:
        return self._device.counts

    def open(self, rate_hz: int) -> None:
        self._device.open(rate_hz)

    def read(self, tick: int) -> Sample | None:
        sample = self._device.read(tick)
        if sample is None:
            return None
        axes, velocity = self._axes, sample.velocity_mps
        return sample.replaced(
            position_m=sample.position_m[:axes], velocity_mps=None if velocity is None else velocity[:axes]
        )

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        acting = self._device.write((*force_n, *self._rest))
        return None if acting is None else acting[: self._axes]

    def close(self) -> None:
        self._device.close()
