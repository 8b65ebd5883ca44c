"""Functions of the operating system for drivers and emulators, beyond `cogrip.machine.platform`.

Windows has no port that two processes share, so no guard process: Haply's boards are refused. It has no pseudo-terminal and no
local socket that keeps messages apart, so no emulated device on a wire: `emulated:NAME` stands for both.
"""

import os
import select
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from serial import Serial

MOST_BYTES = 1 << 16  # most bytes taken in at once
SEQUENCED = hasattr(socket, "AF_UNIX") and hasattr(socket, "SOCK_SEQPACKET")
"""Local sockets that keep messages apart."""

LINUX = sys.platform == "linux"
HD_LIBRARIES = {"win32": ("HD.dll",), "darwin": ("libHD.dylib",)}.get(
    sys.platform, ("libHD.so", "libHD.so.3.4", "libHD.so.3.5")
)
"""Usual names of the OpenHaptics HD library."""

if sys.platform == "win32":
    NOT_A_LINE: tuple[type[Exception], ...] = (OSError, ValueError)  # raised by what is no serial line
    CAN_SHARE = False  # a port between two processes
    PSEUDO_TERMINALS = False
    IGNORED_BY_GUARD: tuple[signal.Signals, ...] = ()

    def low_latency(line: "Serial") -> None:
        """Do nothing: the driver's latency is a setting of the port."""

    def await_bytes(line: "Serial", wait_s: float) -> bytes:
        """Return the bytes that come within `wait_s`."""
        if line.timeout != wait_s:
            line.timeout = wait_s
        first: bytes = line.read(1)
        return first + line.read(line.in_waiting) if first else b""

    def write_some(line: "Serial", frame: bytes) -> int:
        """Write, and return the number of bytes taken."""
        return line.write(frame) or 0

    def open_pseudo_terminal() -> tuple[int, int, str]:
        """Raise OSError."""
        raise OSError("Windows has no pseudo-terminal that other programs open as a serial port")

    def local_socket() -> socket.socket:
        """Raise OSError."""
        raise OSError("Windows has no local socket that keeps messages apart")

    def open_without_waiting(path: str, access: int) -> int:
        """Raise OSError."""
        raise OSError("Windows has no event files")

    def control(descriptor: int, request: int, data: bytes) -> bytes:
        """Raise OSError."""
        raise OSError("Windows has no ioctl")

    def config_folder() -> Path:
        """Return the folder of this user's settings."""
        return Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")

else:
    import fcntl
    import termios
    import tty

    NOT_A_LINE = (OSError, ValueError, termios.error)
    CAN_SHARE = True
    PSEUDO_TERMINALS = True
    IGNORED_BY_GUARD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)

    def low_latency(line: "Serial") -> None:
        """Ask the driver to pass bytes on at once, where it can."""
        with suppress(OSError, ValueError, NotImplementedError, AttributeError):
            line.set_low_latency_mode(True)  # a pty has none, an ACM port may have none

    def await_bytes(line: "Serial", wait_s: float) -> bytes:
        """Return the bytes that come within `wait_s`; a new timeout would set the whole line up anew. Raises OSError."""
        return awaited(line.fileno(), wait_s)

    def awaited(descriptor: int, wait_s: float) -> bytes:
        """Return the bytes that come within `wait_s`. Raises OSError where the other end has gone.

        A terminal whose other end closes says so before an ioctl on it fails: to ask it how much waits would find nothing
        amiss. Nothing to read, without that, means that somebody else has read it: a guard.
        """
        if not select.select([descriptor], [], [], wait_s)[0]:
            return b""
        try:
            data = os.read(descriptor, MOST_BYTES)
        except BlockingIOError:
            data = b""
        if not data and _hung_up(descriptor):
            raise OSError("the other end has hung up")
        return data

    def _hung_up(descriptor: int) -> bool:
        watch = select.poll()
        watch.register(descriptor, 0)  # a hang-up is told in any case
        return any(events & select.POLLHUP for _, events in watch.poll(0))

    def write_some(line: "Serial", frame: bytes) -> int:
        """Write, and return the number of bytes taken. pyserial itself would retry for ever while the buffer is full."""
        try:
            return os.write(line.fileno(), frame)
        except BlockingIOError:
            return 0

    def open_pseudo_terminal() -> tuple[int, int, str]:
        """Return both ends of a raw pseudo-terminal, ours without waiting, and the path of the other. Raises OSError."""
        master, slave = os.openpty()
        tty.setraw(master)
        tty.setraw(slave)
        os.set_blocking(master, False)
        return master, slave, os.ttyname(slave)

    def local_socket() -> socket.socket:
        """Return a local socket that keeps messages apart. Raises OSError."""
        return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def open_without_waiting(path: str, access: int) -> int:
        """Return a descriptor whose reads do not wait. Raises OSError."""
        return os.open(path, access | os.O_NONBLOCK | os.O_CLOEXEC)

    def control(descriptor: int, request: int, data: bytes) -> bytes:
        """Return what a device driver answers to an ioctl. Raises OSError."""
        return fcntl.ioctl(descriptor, request, data)

    def config_folder() -> Path:
        """Return the folder of this user's settings."""
        return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")


def asleep_s() -> float | None:
    """Return how long this computer has been suspended or in hibernation since it was started; None where that is not known."""
    if sys.platform == "linux":
        return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)
    return None
