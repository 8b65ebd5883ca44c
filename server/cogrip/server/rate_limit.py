"""Rate limits: what each peer may cost the server, checked before anything is decoded, decrypted or kept.

Budgets are token buckets. Those of addresses lie in a table of fixed size, by a keyed hash: a flood from a million forged
addresses takes no memory and evicts nobody. Two addresses may share a bucket; nobody outside knows which.
"""

import hashlib
import ipaddress
from array import array
from typing import NamedTuple

from cogrip.protocol.secure.channel import Address
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES

SECOND_NS = 1_000_000_000


class Budget(NamedTuple):
    """Token bucket: rate [1/s] and burst."""

    per_second: int
    burst: int


class Limits(NamedTuple):
    """Budgets of one server."""

    # budget of one address for first contacts, and one for handshakes: many may sit behind one
    address: Budget = Budget(20, 250)
    contacts: Budget = Budget(300, 600)  # budget for first contacts of all addresses of one class
    handshakes: Budget = Budget(100, 50)  # budget for handshakes of all addresses of one class, 0.4 ms each
    # budget for datagrams and messages of one peer that is known: four times what 128 Hz needs
    peer: Budget = Budget(512, 512)


LIMITS = Limits()
HELLOS = Budget(4, 8)  # budget for hellos of one participant: a client says hello four times a second
SIGNATURES = Budget(600, 16)  # budget for signatures of tokens that are not known yet, of all peers: some 0.16 ms each
ADDRESS_SLOTS = 65536
"""Number of slots: an address that shares one with an attacker's is shut out with it, one in 260 beside 250 of them."""
PEER_SLOTS = 4096
SEATED_NS = 3_600_000_000_000  # time for which an address is SEATED after somebody there had a seat
NEW_NS = 30_000_000_000  # time for which an address that was let through is not NEW
NEVER_NS = -SEATED_NS
REPEATED, NEW, SEATED = range(3)  # classes of addresses; each has budgets of its own


def limits_for(network_hz: int) -> Limits:
    """Return the limits of a server whose fastest room has this rate."""
    return LIMITS._replace(peer=Budget(4 * network_hz, 4 * network_hz))


class RateLimiter:
    """Each query spends from a budget and returns "", or the name under which the datagram is dropped.

    Contacts and handshakes have a budget for each class of addresses: an attacker with some hundreds of addresses spends that
    of addresses that come again and again (REPEATED); one that comes for the first time in NEW_NS has another (NEW), and one
    that had a seat lately a third (SEATED), which nobody can reach without a token.
    """

    def __init__(self, secret: bytes, limits: Limits = LIMITS) -> None:
        """secret: random bytes, 16 to 64; whoever knows them can aim at a bucket."""
        self._secret = secret
        self._addresses = Buckets(ADDRESS_SLOTS, limits.address)
        self._peers = Buckets(PEER_SLOTS, limits.peer)
        self._peer_slots: dict[Address, int] = {}  # of peers that sent something lately
        self._shaking = Buckets(ADDRESS_SLOTS, limits.address)
        self._seated_ns = array("q", [NEVER_NS]) * ADDRESS_SLOTS
        self._contact_ns = array("q", [NEVER_NS]) * ADDRESS_SLOTS  # when one was let through
        self._handshake_ns = array("q", [NEVER_NS]) * ADDRESS_SLOTS
        self._contacts = Buckets(3, limits.contacts)
        self._handshakes = Buckets(3, limits.handshakes)

    def size(self, datagram: bytes) -> str:
        """Check the size of any datagram, before all else."""
        if len(datagram) > MAX_DATAGRAM_BYTES:
            return "too large"
        return "" if datagram else "empty"

    def peer(self, address: Address, now_ns: int) -> str:
        """Check a datagram of a known peer: bound to a session, or with an association."""
        return "" if self._peers.take(self._peer_slot(address), now_ns) else "flood of a peer"

    def contact(self, address: Address, now_ns: int) -> str:
        """Check a first contact, whose address may be forged: an unencrypted hello, or a ClientHello without a cookie."""
        slot = self._slot(address)
        if not self._addresses.take(slot, now_ns):
            return "address budget"
        return "" if self._take(self._contacts, self._contact_ns, slot, now_ns) else "contact budget"

    def handshake(self, address: Address, now_ns: int) -> str:
        """Check a handshake with an address that is not forged: its ClientHello had a cookie."""
        slot = self._slot(address)
        if not self._shaking.take(slot, now_ns):
            return "address budget"
        return "" if self._take(self._handshakes, self._handshake_ns, slot, now_ns) else "handshake budget"

    def _take(self, budgets: "Buckets", let_ns: "array[int]", slot: int, now_ns: int) -> bool:
        """Spend one from the budget of this address's class. let_ns: time of the last one let through, by slot."""
        if now_ns - self._seated_ns[slot] < SEATED_NS:
            return budgets.take(SEATED, now_ns)
        taken = budgets.take(NEW if now_ns - let_ns[slot] >= NEW_NS else REPEATED, now_ns)
        if taken:
            let_ns[slot] = now_ns
        return taken

    def was_seated(self, address: Address, now_ns: int) -> bool:
        """Return whether somebody at this address had a seat lately."""
        return now_ns - self._seated_ns[self._slot(address)] < SEATED_NS

    def seated(self, address: Address, now_ns: int) -> None:
        """Note a session at this address: by a token or a ticket, which nobody gets by a handshake alone."""
        self._seated_ns[self._slot(address)] = now_ns

    def _peer_slot(self, address: Address) -> int:
        slot = self._peer_slots.get(address)
        if slot is None:
            if len(self._peer_slots) >= PEER_SLOTS:
                self._peer_slots.clear()
            slot = self._peer_slots[address] = hash((self._secret, address)) % PEER_SLOTS
        return slot

    def _slot(self, address: Address) -> int:
        text = network_of(address).encode("utf-8", "replace")
        return int.from_bytes(hashlib.blake2b(text, digest_size=4, key=self._secret).digest(), "big") % ADDRESS_SLOTS


def network_of(address: Address) -> str:
    """Return the part of an address that has a budget: the IPv4 address, or the /64 of an IPv6 one; never the port."""
    host = str(address[0]) if isinstance(address, tuple) and address else str(address)
    if ":" not in host:
        return host
    try:
        number = ipaddress.IPv6Address(host.partition("%")[0])
    except ValueError:
        return host
    return str(number.ipv4_mapped) if number.ipv4_mapped else number.packed[:8].hex()


class Buckets:
    """Token buckets, one number each: the time at which the bucket is full again."""

    __slots__ = ("_all_ns", "_each_ns", "_full_ns")

    def __init__(self, count: int, budget: Budget) -> None:
        self._each_ns = SECOND_NS // budget.per_second
        self._all_ns = budget.burst * self._each_ns
        self._full_ns = array("q", [0]) * count

    def has(self, slot: int, now_ns: int) -> bool:
        """Return whether there is a token in a bucket."""
        return max(self._full_ns[slot], now_ns) + self._each_ns - now_ns <= self._all_ns

    def take(self, slot: int, now_ns: int) -> bool:
        """Take one token out of a bucket; False where it is empty."""
        full_ns = max(self._full_ns[slot], now_ns) + self._each_ns
        if full_ns - now_ns > self._all_ns:
            return False
        self._full_ns[slot] = full_ns
        return True
