"""A device of many axes in a room of fewer: the first ones are used, the others get no force."""

from collections.abc import Mapping, Sequence

from cogrip.devices.device import Capability, Device, DeviceError, Sample


def first_axes(device: Device, axes: int) -> Device:
    """`device` itself if it has just `axes` axes, else a view of its first ones. Raises DeviceError where it has fewer."""
    record = device.capability
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
        return Sample(sample.position_m[:axes], None if velocity is None else velocity[:axes], sample.age_ticks)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        acting = self._device.write((*force_n, *self._rest))
        return None if acting is None else acting[: self._axes]

    def close(self) -> None:
        self._device.close()
