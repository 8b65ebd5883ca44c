"""Channels between messages and datagrams: unencrypted, or DTLS (`cogrip.protocol.io.dtls`). The same interface at both ends.

A driver feeds datagrams of its socket to `receive`, passes on the messages that it returns, and sends what `outbox` holds. An
end with many peers tells them apart by address; an end with one uses `PEER`. Nothing here opens a socket or reads a clock.
"""

from collections import Counter, deque
from collections.abc import Hashable, Mapping, Sequence
from typing import Protocol

Address = Hashable
PEER = "peer"  # address of the other end at an end that has only one


class Channel(Protocol):
    """Interface of a channel.

    outbox   (address, datagram) to send, oldest first
    dropped  count of dropped datagrams and messages by reason
    failed   why this channel will never be ready, "" while it may be
    """

    outbox: deque[tuple[Address, bytes]]
    failed: str

    @property
    def dropped(self) -> Mapping[str, int]: ...

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        """Return the messages that a datagram carried, none to several. Never raises for anything that a network can bring."""

    def send(self, message: bytes, address: Address) -> bool:
        """Send a message. False, and counted, where there is no channel to that address (yet)."""

    def ready(self, address: Address) -> bool:
        """Return whether a message can be sent there now."""

    def poll(self, now_ns: int) -> None:
        """Run the timers: repeat flights, end handshakes that take too long. Call at least every 50 ms."""

    def close(self, address: Address) -> None:
        """Close the channel to an address and tell the other end where possible."""


class UnencryptedChannel:
    """Channel on which each datagram is one message."""

    def __init__(self) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped: Counter[str] = Counter()
        self.failed = ""

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        return (datagram,)

    def send(self, message: bytes, address: Address) -> bool:
        self.outbox.append((address, message))
        return True

    def ready(self, address: Address) -> bool:
        return True

    def poll(self, now_ns: int) -> None:
        """Do nothing: no handshake is pending."""

    def close(self, address: Address) -> None:
        """Do nothing: no state is kept."""


def place_text(address: Address) -> str:
    """Return an address as text."""
    if not isinstance(address, tuple) or len(address) < 2:
        return str(address)
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in str(host) else f"{host}:{port}"
