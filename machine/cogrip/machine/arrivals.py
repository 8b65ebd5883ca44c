"""Datagrams of a socket with the time at which each arrived, as the kernel says where it does (Linux: SO_TIMESTAMPNS).

A loop drains its socket once a step, so the time of its own clock says nothing of when a datagram came.
"""

import socket
import struct
from collections.abc import Callable
from typing import Any

from cogrip.machine.platform import system, time

_SO_TIMESTAMPNS = 35
"""Option of sockets, the same on every architecture but Alpha, PA-RISC and SPARC; its message has two native longs."""
_TIMESPEC = struct.Struct("@ll")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) if hasattr(socket, "CMSG_SPACE") else 0


class Arrivals:
    """Receiving end of a socket."""

    def __init__(self, receiver: socket.socket) -> None:
        self._socket = receiver
        self._stamped = system.stamped(receiver, _SO_TIMESTAMPNS)
        self._newest_ns = 0  # time of the newest arrival: none is earlier than one before it
        self._check: Callable[[], object] | None = None  # tells whether there is something to receive

    def poll(self, most_bytes: int, now_ns: int) -> tuple[bytes, Any, int] | None:
        """Return what `receive` does, None where there is nothing: cheaper than a `receive` that raises for it."""
        check = self._check = self._check or system.arrival_check(self._socket)
        if not check():
            return None
        try:
            return self.receive(most_bytes, now_ns)
        except BlockingIOError:
            return None

    def receive(self, most_bytes: int, now_ns: int) -> tuple[bytes, Any, int]:
        """Return a datagram, its sender's address, and when it came on the clock of `now_ns`: not after that.

        Raises BlockingIOError where there is none, OSError as `recvfrom` does.
        """
        if self._stamped is None:
            datagram, address = self._socket.recvfrom(most_bytes)
            return datagram, address, now_ns
        datagram, ancillary, _, address = self._stamped(most_bytes, _ANCILLARY_BYTES)
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(data) == _TIMESPEC.size:
                seconds, ns = _TIMESPEC.unpack(data)
                age_ns = time.time_ns() - (seconds * 1_000_000_000 + ns)  # the kernel's stamps are UTC
                arrived_ns = time.monotonic_ns() - age_ns
                self._newest_ns = min(now_ns, max(self._newest_ns, arrived_ns))
                return datagram, address, self._newest_ns
        return datagram, address, now_ns
