"""A serial line (USB CDC, or a pty of an emulated device), by pyserial."""

import os
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar

from cogrip.devices.device import DeviceError
from cogrip.devices.io import platform
from cogrip.devices.io.plugging import stamp_of

if TYPE_CHECKING:
    from serial import Serial

BAUD = 115200  # baud rate: the devices ignore it, but 0 would mean hang-up
_Answer = TypeVar("_Answer")


class SerialLine:
    """See `ByteLine`. 8N1, raw, no flow control, exclusive."""

    def __init__(self, path: str, scheme: str) -> None:
        self.path = path
        self.name = f"{scheme}:{path}"
        self.counts: Counter[str] = Counter()
        self._line: Serial | None = None

    def open(self) -> None:
        """Raises DeviceError where the port is not there, not ours to open, or in use."""
        if self._line is not None:
            raise DeviceError(f"{self.name}: is open already; close it first")
        from serial import Serial  # not for a list of devices, which opens none

        try:
            line = Serial(self.path, BAUD, timeout=0, write_timeout=0, exclusive=True)
        except platform.NOT_A_LINE as error:  # SerialException is an OSError
            raise DeviceError(f"{self.name}: cannot be opened: {_reason(error)}; {_cure(self.path, error)}") from None
        platform.low_latency(line)
        self._line = line

    def write(self, frame: bytes) -> None:
        sent = self._try(lambda line: platform.write_some(line, frame))
        if sent != len(frame):
            raise DeviceError(
                f"{self.name}: took {sent} of {len(frame)} bytes: the device does not read; check it, then re-arm"
            )

    def read(self, wait_s: float = 0.0) -> bytes:
        return self._try(lambda line: _read(line, wait_s))

    def _try(self, verb: "Callable[[Serial], _Answer]") -> _Answer:
        if self._line is None:
            raise DeviceError(f"{self.name}: is closed; open it first")
        try:
            return verb(self._line)
        except (OSError, TypeError) as error:  # pyserial: TypeError where another thread has closed the port
            raise DeviceError(f"{self.name}: lost: {_reason(error)}; plug it in again, then re-arm") from None

    def close(self) -> None:
        line, self._line = self._line, None
        if line is not None:
            with suppress(OSError):
                line.close()

    def stamp(self) -> str:
        return stamp_of(os.path.realpath(self.path))


def _read(line: "Serial", wait_s: float) -> bytes:
    waiting = line.in_waiting
    if not waiting and wait_s > 0.0:
        return platform.await_bytes(line, wait_s)
    data: bytes = line.read(waiting) if waiting else b""
    return data


def _reason(error: Exception) -> str:
    text = getattr(error, "strerror", None) or str(error)
    return text.splitlines()[0] if text else type(error).__name__


def _cure(path: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == 13:
        return "give yourself the right to it (configs/99-cogrip.rules, or the group dialout)"
    if number in (16, 11):
        return "close the program that uses it"
    if number == 2 or not os.path.exists(path):
        return "plug the device in, and look for its name with `cogrip devices find`"
    return "check its cable and power"
