"""The device as a core holds it: what fails in it becomes a latched fault, and re-arming opens it anew.

fault --rearm: opened anew where it had failed--> arming --samples for SETTLED_S--> live
arming --fails, or not settled within ARMING_S--> fault, and `refusal` says why
"""

from __future__ import annotations

from collections.abc import Sequence

from cogrip.client.core import ClientCore
from cogrip.client.rendered_damper import OverloadError, refusal
from cogrip.devices.device import Capability, Device, DeviceError, Sample

SETTLED_S = 0.03  # samples without a gap for so long: the velocity estimate has forgotten where the hand was before
ARMING_S = 1.0
MOST_GAP_TICKS = 3  # a reply that is missed now and then is no reason


class Handle:
    """One device in one core's hand. Only `open` raises.

    spared: the device is never driven with settings that ask for more than it carries, whatever the server sends.
    """

    def __init__(self, device: Device, core: ClientCore, rate_hz: int, *, spared: bool = False) -> None:
        self.device = device
        self._spared = spared
        self.refusal = ""  # why an arming that had begun came to nothing
        self._core = core
        self._rate_hz = rate_hz
        self._failed = False
        self._arming = False
        self._first = self._last = self._begun = -1  # ticks: of the samples without a gap, and of the arming

    def open(self) -> None:
        """A device may know its limits only once it is open; then safety goes by those. Raises DeviceError."""
        before = self.device.capability
        self._judge(before)
        self.device.open(self._rate_hz)
        if self.device.capability != before:
            self._core.equip(self.device.capability)
            try:
                self._judge(self.device.capability)
            except OverloadError:
                self.device.close()
                raise

    def _judge(self, record: Capability) -> None:
        seat = self._core.seat
        if self._spared and seat is not None and (text := refusal(seat, record)):
            raise OverloadError(text)

    def read(self, tick: int) -> Sample | None:
        """The sample at `tick`, None where there is none."""
        try:
            sample = self.device.read(tick)
        except DeviceError as error:
            self._fail(error)
            return None
        if self._arming:
            self._watch(sample is not None, tick)
        return sample

    def write(self, force_n: Sequence[float]) -> None:
        """Also in a fault: a device that can still be reached takes the force that fades out."""
        try:
            acting = self.device.write(force_n)
            if acting is not None:
                self._core.acted(tuple(acting))
        except DeviceError as error:
            self._fail(error)
        if self._failed and self._core.safety.quiet:
            self.device.close()  # so that whoever sees to it can have it
        if self._arming and self._last - self._first >= SETTLED_S * self._rate_hz:
            self._arming = False
            self._core.rearm()

    def rearm(self) -> str:
        """Begin to leave a latched fault; a device that failed is opened anew first. Returns why that cannot be, "" if it can.

        Force may flow once samples have come for SETTLED_S. Does nothing where there is no fault, or arming has begun.
        """
        if self._arming or self._core.safety.state != "fault":
            return ""
        if self._failed:
            self.device.close()
            try:
                self.open()
            except DeviceError as error:
                return str(error)
            self._failed = False
        self.refusal = ""
        self._arming = True
        self._first = self._last = self._begun = -1
        return ""

    def _watch(self, heard: bool, tick: int) -> None:
        """Samples come again, or they do not."""
        if self._begun < 0:
            self._begun = tick
        if heard:
            if self._first < 0 or tick - self._last > MOST_GAP_TICKS:
                self._first = tick
            self._last = tick
        if tick - self._begun > ARMING_S * self._rate_hz:
            self._arming = False
            self.refusal = (
                f"the device gave no steady samples within {ARMING_S:g} s; check its cable and power, then re-arm"
            )

    def _fail(self, error: DeviceError) -> None:
        self._failed = True
        if self._arming:
            self._arming = False
            self.refusal = str(error)
        if self._core.safety.state != "fault":
            self._core.fail(f"device: {error}")
