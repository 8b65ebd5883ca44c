"""The line of an emulated device in virtual time: the firmware's clock is whatever it was last advanced to."""

from collections import Counter

from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.firmware import Firmware


class EmulatedLine:
    """See `ByteLine`. Waiting looks ahead: what would come within `wait_s` is there. reports: one report a read."""

    def __init__(self, name: str, firmware: Firmware, *, reports: bool = False) -> None:
        self.name = name
        self.counts: Counter[str] = Counter()
        self._firmware = firmware
        self._reports = reports
        self._open = False
        self._plugging = 0
        self._came: list[bytes] = []

    def open(self) -> None:
        if self._open:
            raise DeviceError(f"{self.name}: is open already; close it first")
        if not self._firmware.plugged:
            raise DeviceError(f"{self.name}: is not there; plug it in")
        self._plugging = self._firmware.plugging
        self._came.clear()
        self._firmware.connect()
        self._open = True

    def write(self, frame: bytes) -> None:
        self._need()
        self._firmware.receive(frame, self._firmware.now_ns)

    def read(self, wait_s: float = 0.0) -> bytes:
        self._need()
        firmware = self._firmware
        self._came += firmware.due(firmware.now_ns + round(wait_s * 1e9))
        if self._reports and self._came:  # the newest report is what counts
            if len(self._came) > 1:
                self.counts["report replaced by a newer one"] += len(self._came) - 1
            del self._came[:-1]
        data = b"".join(self._came)
        self._came.clear()
        return data

    def close(self) -> None:
        self._open = False

    def stamp(self) -> str:
        return f"plugging {self._firmware.plugging}"

    def _need(self) -> None:
        if not self._open:
            raise DeviceError(f"{self.name}: is closed; open it first")
        if not self._firmware.plugged or self._firmware.plugging != self._plugging:
            raise DeviceError(f"{self.name}: lost: it was unplugged; plug it in again, then re-arm")
