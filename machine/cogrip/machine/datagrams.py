"""Datagrams of one bound socket, one system call each; where it is compiled, many in a call (`datagram_batch.pyx`)."""

import importlib
import importlib.util
import socket
from collections import deque
from collections.abc import Hashable
from typing import Any, Protocol

from cogrip.machine.arrivals import Arrivals

BATCH = "cogrip.machine.datagram_batch"


class DatagramEnds(Protocol):
    """Both directions of a socket."""

    def receive(self, most_bytes: int, now_ns: int) -> tuple[bytes, Any, int]:
        """Return a datagram, its sender, and when it came. Raises BlockingIOError where there is none, OSError."""

    def send_all(self, outbox: deque[tuple[Hashable, bytes]]) -> list[str]:
        """Send all (address, datagram) of a queue, and return for each that the system refused why it did."""


class Datagrams:
    """`DatagramEnds` of any system."""

    def __init__(self, own: socket.socket) -> None:
        self.receive = Arrivals(own).receive
        self._socket = own

    def send_all(self, outbox: deque[tuple[Hashable, bytes]]) -> list[str]:
        send, refused = self._socket.sendto, []
        while outbox:
            address, datagram = outbox.popleft()
            try:
                send(datagram, address)  # type: ignore[call-overload]  # addresses are the socket's own
            except OSError as error:
                refused.append(str(error.strerror))
        return refused


def open_datagrams(own: socket.socket) -> DatagramEnds:
    """Return both directions of a bound socket, in batches where that is compiled and the system has stamps."""
    batched = open_batched(own)
    return Datagrams(own) if batched is None else batched


def open_batched(own: socket.socket) -> DatagramEnds | None:
    """Return both directions of a bound socket in batches, None where that is not compiled or the system has no stamps."""
    batched: DatagramEnds | None = _compiled("DatagramBatch", own)
    return batched


def open_arrivals(own: socket.socket) -> Arrivals:
    """Return the receiving end of a socket that has few peers, compiled where it is."""
    compiled: Arrivals | None = _compiled("BatchArrivals", own)
    return Arrivals(own) if compiled is None else compiled


def _compiled(name: str, own: socket.socket) -> Any:
    if importlib.util.find_spec(BATCH) is None:
        return None
    try:
        return getattr(importlib.import_module(BATCH), name)(own)
    except OSError:  # an emulated kernel without stamps
        return None
