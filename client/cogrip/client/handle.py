"""The device as a core holds it: what fails in it becomes a latched fault, and re-arming opens it anew."""

from __future__ import annotations

from collections.abc import Sequence

from cogrip.client.core import ClientCore
from cogrip.devices.device import Device, DeviceError, Sample


class Handle:
    """One device in one core's hand. Only `open` raises."""

    def __init__(self, device: Device, core: ClientCore, rate_hz: int) -> None:
        self.device = device
        self._core = core
        self._rate_hz = rate_hz
        self._failed = False

    def open(self) -> None:
        """A device may know its limits only once it is open; then safety goes by those. Raises DeviceError."""
        before = self.device.capability
        self.device.open(self._rate_hz)
        if self.device.capability != before:
            self._core.equip(self.device.capability)

    def read(self, tick: int) -> Sample | None:
        """The sample at `tick`, None where there is none."""
        try:
            return self.device.read(tick)
        except DeviceError as error:
            self._fail(error)
            return None

    def write(self, force_n: Sequence[float]) -> None:
        """Also in a fault: a device that can still be reached takes the force that fades out."""
        try:
            acting = self.device.write(force_n)
            if acting is not None:
                self._core.acted(tuple(acting))
        except DeviceError as error:
            self._fail(error)

    def rearm(self) -> str:
        """Leave a latched fault; a device that failed is opened anew first. Returns why that cannot be, "" if it could."""
        if self._failed:
            self.device.close()
            try:
                self.open()
            except DeviceError as error:
                return str(error)
            self._failed = False
        self._core.rearm()
        return ""

    def _fail(self, error: DeviceError) -> None:
        self._failed = True
        if self._core.safety.state != "fault":
            self._core.fail(f"device: {error}")
