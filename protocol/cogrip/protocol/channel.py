"""What lies between messages and datagrams: nothing (plain), or a seal (`cogrip.protocol.io.dtls`). One seam for both ends.

A driver feeds what its socket gives, hands on what `receive` returns, and sends what `outbox` holds. An end with many
peers tells them apart by address; an end with one says `PEER`. Nothing here opens a socket or asks a clock.
"""

from collections import deque
from collections.abc import Hashable, Sequence
from typing import Protocol

Address = Hashable
PEER = "peer"  # the address of the only other end


class Channel(Protocol):
    """`outbox` holds (address, datagram) to send, oldest first; `dropped` counts by reason what went no further."""

    outbox: deque[tuple[Address, bytes]]
    dropped: dict[str, int]
    failed: str  # why this channel will never be ready, "" while it may be

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        """Messages that a datagram carried, none to several. Never raises for anything that a network can bring."""
        ...

    def send(self, message: bytes, address: Address) -> bool:
        """Put a message on its way. False, and counted, where there is no channel to that address (yet)."""
        ...

    def ready(self, address: Address) -> bool:
        """Whether a message can be sent there now."""
        ...

    def poll(self, now_ns: int) -> None:
        """Time passes: repeat what a handshake needs, give up what has taken too long. At least every 50 ms."""
        ...

    def close(self, address: Address) -> None:
        """The other end is told, where there is a way, and forgotten."""
        ...


class UnencryptedChannel:
    """Datagrams are messages."""

    def __init__(self) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped: dict[str, int] = {}
        self.failed = ""

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        return (datagram,)

    def send(self, message: bytes, address: Address) -> bool:
        self.outbox.append((address, message))
        return True

    def ready(self, address: Address) -> bool:
        return True

    def poll(self, now_ns: int) -> None:
        """Nothing waits."""

    def close(self, address: Address) -> None:
        """Nothing is kept."""


def place_text(address: Address) -> str:
    """An address for people."""
    if not isinstance(address, tuple) or len(address) < 2:
        return str(address)
    host = str(address[0])
    return f"[{host}]:{address[1]}" if ":" in host else f"{host}:{address[1]}"
