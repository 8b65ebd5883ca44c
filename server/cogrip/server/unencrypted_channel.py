"""Channel of an unencrypted server: datagrams are messages; of unauthenticated peers only what looks like a hello passes."""

from collections import deque
from collections.abc import Callable, Sequence

from cogrip.protocol.secure.channel import Address, UnencryptedChannel
from cogrip.protocol.wire.messages import HELLO_BYTES, MAGIC
from cogrip.server.events import ServerEvent
from cogrip.server.rate_limit import RateLimiter

HELLO_BEGINS = b"\x01" + bytes([0xA0 + len(MAGIC)]) + MAGIC.encode()
"""Beginning of a hello: its tag, and the magic as MessagePack text."""

ENCRYPTED_ONLY = (
    "this server is encrypted (DTLS): join by a link that it prints at its start, or `cogrip token new` makes"
)


def looks_like_hello(datagram: bytes) -> bool:
    """Return whether a datagram is as long as a hello and begins as the hello of every protocol version does."""
    if len(datagram) < HELLO_BYTES:
        return False
    first = datagram[0]
    header = 1 if 0x90 <= first <= 0x9F else 3 if first == 0xDC else 0  # of a MessagePack array
    return bool(header) and datagram.startswith(HELLO_BEGINS, header)


class UnencryptedListener(UnencryptedChannel):
    """`Channel` of an unencrypted server. known: says whether an address is bound (`ServerCore.listens_to`)."""

    def __init__(self, rate_limiter: RateLimiter, known: Callable[[Address], bool]) -> None:
        super().__init__()
        self.renewed: deque[Address] = deque()  # not detectable here
        self.events: deque[ServerEvent] = deque()
        self._rate_limiter = rate_limiter
        self._known = known

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        rate_limiter = self._rate_limiter
        reason = rate_limiter.size(datagram)
        if not reason:
            if self._known(address):
                reason = rate_limiter.peer(address, now_ns)
            elif looks_like_hello(datagram):
                reason = rate_limiter.contact(address, now_ns)
            else:
                reason = "unauthenticated"
        if reason:
            self.dropped[reason] = self.dropped.get(reason, 0) + 1
            return ()
        return (datagram,)
