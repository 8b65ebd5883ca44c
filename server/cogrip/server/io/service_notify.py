"""Telling systemd how the service is (sd_notify(3)). Where nobody asked to be told, nothing happens.

https://www.freedesktop.org/software/systemd/man/latest/sd_notify.html
"""

import os
import socket
import sys
from collections.abc import Mapping


class ServiceNotifier:
    """Datagrams to the socket that $NOTIFY_SOCKET names. None of them waits or raises; `failed` counts those not sent.

    watchdog_every_ns: how often `watchdog` should be called, half of what the service manager allows; None where it
    does not watch.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        self.failed = 0
        self.watchdog_every_ns = _watchdog_every_ns(environ)
        self._address = environ.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if sys.platform == "win32" or self._address[:1] not in ("/", "@"):
            return
        if self._address.startswith("@"):  # an abstract name: no file
            self._address = "\0" + self._address[1:]
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    @property
    def listened_to(self) -> bool:
        return self._socket is not None

    def _say(self, *lines: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto("\n".join(lines).encode("utf-8", "replace"), self._address)
        except OSError:  # full, or the manager is being replaced
            self.failed += 1

    def ready(self, status: str = "") -> None:
        """The service listens: after the start, and after every `reloading`."""
        self._say("READY=1", *_status(status))

    def status(self, text: str) -> None:
        """One line for `systemctl status`."""
        self._say(*_status(text) or ("STATUS=",))

    def reloading(self, monotonic_ns: int) -> None:
        """The service reads its files anew, since `monotonic_ns` of the steady clock; `ready` ends it."""
        self._say("RELOADING=1", f"MONOTONIC_USEC={monotonic_ns // 1000}")

    def stopping(self, status: str = "") -> None:
        self._say("STOPPING=1", *_status(status))

    def watchdog(self) -> None:
        """The loop runs. Say it from the loop itself."""
        self._say("WATCHDOG=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _status(text: str) -> tuple[str, ...]:
    return (f"STATUS={' '.join(text.split())}",) if text else ()  # a line break would begin another assignment


def _watchdog_every_ns(environ: Mapping[str, str]) -> int | None:
    """Half of $WATCHDOG_USEC, where it is meant for this process (sd_watchdog_enabled(3))."""
    usec, pid = environ.get("WATCHDOG_USEC", ""), environ.get("WATCHDOG_PID", "")
    if not (usec.isascii() and usec.isdigit() and int(usec) > 0) or (pid and pid != str(os.getpid())):
        return None
    return int(usec) * 500
