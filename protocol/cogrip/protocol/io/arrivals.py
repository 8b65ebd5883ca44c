"""Datagrams of a socket with the time at which each arrived, as the kernel says where it does (Linux: SO_TIMESTAMPNS).

A loop drains its socket once a step, so the time of its own clock says nothing of when a datagram came.
"""

import socket
import struct
from typing import Any

from cogrip.protocol.io.platform import system, time

_SO_TIMESTAMPNS = 35  # the same on every architecture but Alpha, PA-RISC and SPARC; its message has two native longs
_TIMESPEC = struct.Struct("@ll")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) if hasattr(socket, "CMSG_SPACE") else 0


class Arrivals:
    """Receiving end of a socket."""

    def __init__(self, receiver: socket.socket) -> None:
        self._socket = receiver
        self._stamped = system.stamped(receiver, _SO_TIMESTAMPNS)
        self._newest_ns = 0  # time of the newest arrival: none is earlier than one before it

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
