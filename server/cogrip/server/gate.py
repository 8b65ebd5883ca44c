"""Who may cost the server how much: sizes and budgets, before anything is decoded, deciphered or kept.

Budgets are token buckets. Those of addresses lie in a table of fixed size, by a keyed hash: a flood from a million forged
addresses takes no memory, and evicts nobody. Two addresses may fall into the same bucket; nobody outside knows which.
"""

import hashlib
import ipaddress
from array import array
from typing import NamedTuple

from cogrip.protocol.channel import Address
from cogrip.protocol.messages import MAX_DATAGRAM_BYTES

SECOND_NS = 1_000_000_000


class Budget(NamedTuple):
    """So many a second, and so many at once."""

    per_second: int
    burst: int


class Limits(NamedTuple):
    """What a server spends on whom."""

    address: Budget = Budget(20, 250)  # first contacts of one address: a laboratory may sit behind one
    contacts: Budget = Budget(300, 600)  # first contacts of all
    handshakes: Budget = Budget(100, 300)  # handshakes of all, from addresses that have shown they are there
    peer: Budget = Budget(4096, 8192)  # datagrams of one peer that is known


LIMITS = Limits()
ADDRESS_SLOTS = 4096
PEER_SLOTS = 4096


class Gate:
    """Each question takes from a budget and is answered by "", or by the name under which the datagram is dropped."""

    def __init__(self, secret: bytes, limits: Limits = LIMITS) -> None:
        """secret: random bytes, 16 to 64; whoever knows them can aim at a bucket."""
        self._secret = secret
        self._addresses = _Buckets(ADDRESS_SLOTS, limits.address)
        self._peers = _Buckets(PEER_SLOTS, limits.peer)
        self._contacts = _Buckets(1, limits.contacts)
        self._handshakes = _Buckets(1, limits.handshakes)

    def size(self, datagram: bytes) -> str:
        """Asked first, of everything."""
        if len(datagram) > MAX_DATAGRAM_BYTES:
            return "too large"
        return "" if datagram else "empty"

    def peer(self, address: Address, now_ns: int) -> str:
        """A datagram of someone known: seated, or with an association."""
        return "" if self._peers.take(hash((self._secret, address)) % PEER_SLOTS, now_ns) else "flood of a peer"

    def contact(self, address: Address, now_ns: int) -> str:
        """A first word of a stranger, whose address may be forged: a plain hello, a ClientHello without a cookie."""
        if not self._addresses.take(self._slot(address), now_ns):
            return "address budget"
        return "" if self._contacts.take(0, now_ns) else "contact budget"

    def handshake(self, address: Address, now_ns: int) -> str:
        """A handshake is to begin with an address that is not forged: its ClientHello had a cookie."""
        if not self._addresses.take(self._slot(address), now_ns):
            return "address budget"
        return "" if self._handshakes.take(0, now_ns) else "handshake budget"

    def _slot(self, address: Address) -> int:
        text = network_of(address).encode("utf-8", "replace")
        return int.from_bytes(hashlib.blake2b(text, digest_size=4, key=self._secret).digest(), "big") % ADDRESS_SLOTS


def network_of(address: Address) -> str:
    """What of an address a budget goes by: the IPv4 address, or the /64 of an IPv6 one; never the port."""
    host = str(address[0]) if isinstance(address, tuple) and address else str(address)
    if ":" not in host:
        return host
    try:
        number = ipaddress.IPv6Address(host.partition("%")[0])
    except ValueError:
        return host
    return str(number.ipv4_mapped) if number.ipv4_mapped else number.packed[:8].hex()


class _Buckets:
    """Token buckets, one number each: the time at which the bucket is full again."""

    __slots__ = ("_all_ns", "_each_ns", "_full_ns")

    def __init__(self, count: int, budget: Budget) -> None:
        self._each_ns = SECOND_NS // budget.per_second
        self._all_ns = budget.burst * self._each_ns
        self._full_ns = array("q", [0]) * count

    def take(self, slot: int, now_ns: int) -> bool:
        """Take one out of a bucket; False where it is empty."""
        full_ns = max(self._full_ns[slot], now_ns) + self._each_ns
        if full_ns - now_ns > self._all_ns:
            return False
        self._full_ns[slot] = full_ns
        return True
