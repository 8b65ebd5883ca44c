"""Notifications to systemd (sd_notify(3)), where it asked for them.

https://www.freedesktop.org/software/systemd/man/latest/sd_notify.html
"""

import os
import socket
from collections.abc import Mapping

from cogrip.machine.server_platform import POSIX, local_socket


class ServiceNotifier:
    """Datagrams to the socket that $NOTIFY_SOCKET names; none waits or raises. failed: those that were not sent.

    watchdog_every_ns: due interval of `watchdog`, half of what the service manager allows; None without a watchdog
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        self.failed = 0
        self.watchdog_every_ns = _watchdog_every_ns(environ)
        self._address = environ.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if not POSIX or self._address[:1] not in ("/", "@"):
            return
        if self._address.startswith("@"):  # an abstract name: no file
            self._address = "\0" + self._address[1:]
        self._socket = local_socket(socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def _say(self, *lines: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto("\n".join(lines).encode("utf-8", "replace"), self._address)
        except OSError:  # full, or the manager is being replaced
            self.failed += 1

    def ready(self, status: str = "") -> None:
        """Notify that the service listens: after the start, and after every `reloading`."""
        # a line break would begin another assignment
        self._say("READY=1", *([f"STATUS={' '.join(status.split())}"] if status else []))

    def reloading(self, monotonic_ns: int) -> None:
        """Notify that files are read again, since `monotonic_ns` of the steady clock; `ready` ends it."""
        self._say("RELOADING=1", f"MONOTONIC_USEC={monotonic_ns // 1000}")

    def stopping(self) -> None:
        self._say("STOPPING=1")

    def watchdog(self) -> None:
        """Notify that the loop runs. Call it from the loop itself."""
        self._say("WATCHDOG=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _watchdog_every_ns(environ: Mapping[str, str]) -> int | None:
    """Return half of $WATCHDOG_USEC, where it is meant for this process (sd_watchdog_enabled(3))."""
    usec, pid = environ.get("WATCHDOG_USEC", ""), environ.get("WATCHDOG_PID", "")
    if not (usec.isascii() and usec.isdigit() and int(usec) > 0) or (pid and pid != str(os.getpid())):
        return None
    return int(usec) * 500
