"""HID reports over a local socket that keeps their borders: an emulated arm's end, and that of a program.

It stands for the bus. A virtual HID device of the system's own (/dev/uhid) needs the superuser and a kernel module; this needs
neither. `HidLine` takes a socket for the path as it takes /dev/hidraw0, and everything above hidapi is the same.
"""

import select
import socket
import stat
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.io.platform import local_socket
from cogrip.devices.io.served_firmware import ServedFirmware

LONGEST = 4096


def is_socket(path: str) -> bool:
    """Return whether a socket is there."""
    try:
        return bool(path) and stat.S_ISSOCK(Path(path).stat().st_mode)
    except OSError:
        return False


class SocketDevice:
    """A program's end, with the verbs of hidapi's device: raises OSError where the other end is gone."""

    def __init__(self, path: str) -> None:
        self._socket = local_socket()
        try:
            self._socket.connect(path)
            self._socket.setblocking(False)
        except OSError:
            self._socket.close()
            raise

    def write(self, report: bytes) -> int:
        return self._socket.send(report)

    def read(self, longest: int, timeout_ms: int = 0) -> list[int]:
        """A report; [] after timeout_ms without one, 0: at once."""
        if timeout_ms > 0:
            select.select([self._socket], [], [], timeout_ms / 1e3)
        try:
            report = self._socket.recv(longest)
        except BlockingIOError:
            return []
        if not report:
            raise OSError("the emulated device has hung up")
        return list(report)

    def close(self) -> None:
        self._socket.close()


class ReportSocket(ServedFirmware):
    """See `ServedFirmware`. One program at a time: another one is hung up on. The newest report waits for whoever comes."""

    def __init__(self, firmware: Firmware, path: Path, say: Callable[[str], None]) -> None:
        super().__init__(firmware, say)
        self.path = str(path)
        self._listener: socket.socket | None = None
        self._host: socket.socket | None = None
        self._waiting: bytes | None = None

    @property
    def plugged(self) -> bool:
        return self._listener is not None

    def plug(self) -> None:
        """Raises OSError; a socket that nobody listens at any more is replaced."""
        listener = local_socket()
        try:
            if is_socket(self.path):
                Path(self.path).unlink()
            listener.bind(self.path)
            Path(self.path).chmod(0o600)
            listener.listen()
            listener.setblocking(False)
        except OSError:
            listener.close()
            raise
        self._listener = listener

    def unplug(self) -> None:
        self._hang_up()
        self._waiting = None
        if self._listener is not None:
            self._listener.close()
            self._listener = None
            Path(self.path).unlink(missing_ok=True)

    def _hang_up(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None

    def sources(self) -> Sequence[int]:
        return [end.fileno() for end in (self._listener, self._host) if end is not None]

    def received(self, ready: Sequence[int]) -> Sequence[bytes]:
        reports: list[bytes] = []
        while self._host is not None:
            try:
                report = self._host.recv(LONGEST)
            except BlockingIOError:
                break
            except OSError:
                report = b""
            if not report:
                self._hang_up()
            else:
                reports.append(report)
        if self._listener is not None and self._listener.fileno() in ready:
            with suppress(OSError):  # after the one before was seen to have gone
                self._meet(self._listener.accept()[0])
        return reports

    def _meet(self, host: socket.socket) -> None:
        if self._host is not None:
            host.close()
            return
        host.setblocking(False)
        self._host = host

    def tell(self, replies: Sequence[bytes]) -> None:
        if self._host is None:
            self._waiting = replies[-1] if replies else self._waiting
            return
        first = [] if self._waiting is None else [self._waiting]
        self._waiting = None
        for report in (*first, *replies):
            with suppress(OSError):  # it does not read, as a system's own queue it is full; or it has gone
                self._host.send(report)
