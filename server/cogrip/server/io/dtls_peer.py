"""Peer of the encrypted channel: its association, what its datagrams can be, and the memory that it leaves."""

import ctypes
import hmac
from collections.abc import Sequence

from cogrip.machine.large_pages import uses_large_pages
from cogrip.machine.platform import system
from cogrip.protocol.io.dtls import Association
from cogrip.protocol.io.dtls_session import SUITES, DtlsSession, export_keys
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.secure.dtls_records import (
    CHANGE_CIPHER_SPEC,
    DATA,
    HANDSHAKE,
    RECORD_HEADER_BYTES,
    ClientRecords,
    records,
)
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES
from cogrip.server.rate_limit import network_of

COOKIE_NS = 30_000_000_000  # a cookie is valid for one or two of these periods
COOKIE_BYTES = 16


class Peer:
    """Association with its handshake's nonce, and the time since its last change of state."""

    __slots__ = (
        "address", "association", "had_seat", "has_received", "last_flight", "most_requests", "network", "newest", "nonce",
        "records", "repeats", "requests", "seated", "session", "since_ns", "written",
    )  # fmt: skip

    def __init__(
        self, association: Association, nonce: bytes, address: Address, now_ns: int, records: ClientRecords, most_requests: int
    ) -> None:  # fmt: skip
        self.association = association
        self.nonce = nonce
        self.address = address
        self.network = network_of(address)
        self.records = records
        self.since_ns = now_ns
        self.seated = False  # at the last check
        self.had_seat = False  # or its address had one lately
        self.has_received = False  # a message
        self.requests = 0  # datagrams of this handshake, then those without a seat
        self.most_requests = most_requests
        self.newest = -1  # number of a record of a message, until it was seated
        self.written = 0  # number of the record sent last, until then
        self.session: DtlsSession | None = (
            None  # since it was seated: OpenSSL has made the handshake, and is asked no more
        )
        self.last_flight: Sequence[bytes] = ()
        self.repeats = 0  # of the last flight

    def begin_session(self) -> None:
        """Go on with the keys of the association, once it has a seat: `DtlsSession` opens and encrypts in a fifth of the time.

        What OpenSSL takes a datagram are its four calls from Python, each with a buffer of its own.
        """
        association = self.association
        if self.session is None and association.connection.get_cipher_name() in SUITES:
            self.session = DtlsSession(export_keys(association.connection, self.written, self.newest))
            association.release()

    def feed(self, datagram: bytes) -> Sequence[bytes]:
        """Return the messages of a datagram by OpenSSL. Record by record: the number of one counts only if it is authentic."""
        received: list[bytes] = []
        for each in records(datagram):
            if found := self.association.feed(datagram[each.begin : each.end]):
                received += found
                self.newest = max(self.newest, each.number)
        return received


def cookies_of(secret: bytes, address: Address, now_ns: int) -> tuple[bytes, bytes]:
    """Return the cookies of an address: of this period and of the one before."""
    number, text = now_ns // COOKIE_NS, repr(address)
    now, before = [
        hmac.digest(secret, f"{each} {text}".encode(), "sha256")[:COOKIE_BYTES] for each in (number, number - 1)
    ]
    return now, before


def is_of_session(datagram: bytes) -> bool:
    """Return whether a datagram is one encrypted record of messages, by its header."""
    size = len(datagram)
    return (
        RECORD_HEADER_BYTES < size <= MAX_DATAGRAM_BYTES
        and datagram[0] == DATA
        and (datagram[3] != 0 or datagram[4] != 0)
        and size == RECORD_HEADER_BYTES + 256 * datagram[11] + datagram[12]
    )


def is_of_handshake(datagram: bytes) -> bool:
    """Return whether a datagram can only be of a handshake: all but messages, and encrypted alerts."""
    return datagram[0] in (CHANGE_CIPHER_SPEC, HANDSHAKE) or not (datagram[3] or datagram[4])


_malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if system.LINUX else None


def trim() -> None:
    """Give freed memory back (glibc's malloc_trim): 1 ms for some MB, 0.1 ms for none. Memory locked by mlockall stays.

    Large pages stay whole: what handshakes have freed is there for the next ones.
    """
    if _malloc_trim is not None and not uses_large_pages():
        _malloc_trim(0)
