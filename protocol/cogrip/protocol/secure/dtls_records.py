"""Headers of DTLS 1.2 records and handshake messages, and which of a client's records a server's DTLS library may see.

A DTLS library keeps what it cannot use yet: parts of handshake messages, each in a buffer of the length that its header
announces (100 kB and ten messages are usual), and whole records of the next epoch. An unauthenticated peer decides these
lengths. So every record of a client is checked before the library sees it (RFC 6347 sections 4.1 and 4.2.2), and passed only
where a client that joins needs it:

    key exchange   ClientHello, ClientKeyExchange in the clear, ChangeCipherSpec   --ChangeCipherSpec--> finishing
    finishing      an encrypted record that may be Finished, MOST_FINISHED times   --handshake done--> open
    open           application data and alerts, encrypted

An alert passes in every state. The client has no certificate and never renegotiates.
"""

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

RECORD_HEADER_BYTES = 13  # bytes of a record header: type 1, version 2, epoch 2, number 6, length 2
MESSAGE_HEADER_BYTES = 12  # bytes of a message header: type 1, length 3, number 2, fragment offset 3, fragment length 3
CHANGE_CIPHER_SPEC, ALERT, HANDSHAKE, DATA = 20, 21, 22, 23  # types of records
CLIENT_HELLO, CLIENT_KEY_EXCHANGE = 1, 16  # types of handshake messages
MOST_MESSAGE_BYTES = 1024  # longest handshake message of a client: its hello takes some 200 bytes, its key exchange 78
MOST_MESSAGE_SEQ = 4  # highest message number of a client: hello 0, hello with the cookie 1, key exchange 2, Finished 3
MOST_FINISHED_BYTES = 64  # longest record that holds Finished: 24 bytes, and up to 24 more for nonce and tag
MOST_FINISHED = 2
"""Most records that may hold Finished, of which one completes the handshake: the second is for one that came too early."""


class Record(NamedTuple):
    """The header of a record, and where in its datagram the record lies."""

    type: int
    epoch: int
    number: int
    begin: int
    end: int


def records(datagram: bytes) -> Iterator[Record]:
    """Yield the whole records of a datagram, in order. What follows the last of them is no record."""
    begin = 0
    while begin + RECORD_HEADER_BYTES <= len(datagram):
        end = begin + RECORD_HEADER_BYTES + int.from_bytes(datagram[begin + 11 : begin + 13], "big")
        if end > len(datagram) or datagram[begin + 1] != 0xFE:
            return
        epoch, number = (int.from_bytes(datagram[begin + at : begin + to], "big") for at, to in ((3, 5), (5, 11)))
        yield Record(datagram[begin], epoch, number, begin, end)
        begin = end


def message_fault(body: bytes) -> str:
    """Return the reason to drop an unencrypted handshake record, "" for one of a client that joins."""
    at = 0
    while at + MESSAGE_HEADER_BYTES <= len(body):
        length, offset, size = [int.from_bytes(body[at + first : at + first + 3], "big") for first in (1, 6, 9)]
        if body[at] not in (CLIENT_HELLO, CLIENT_KEY_EXCHANGE):
            return "handshake message of no client"
        if length > MOST_MESSAGE_BYTES:
            return "handshake message too long"
        if int.from_bytes(body[at + 4 : at + 6], "big") > MOST_MESSAGE_SEQ:
            return "handshake message ahead"
        if offset + size > length or not size:
            return "handshake fragment out of range"
        at += MESSAGE_HEADER_BYTES + size
        if at == len(body):
            return ""
    return "handshake message cut"


class ClientRecords:
    """Filter of one client's records by the state of its handshake. drop: called with a reason for every record left out.

    state     one of those above
    finished  records so far that may have been Finished
    repeats   the last datagram held a new handshake record after the handshake: a client sends its last flight again where it
              has not received the server's
    """

    __slots__ = ("_drop", "_exchanged", "_newest", "finished", "repeats", "state")

    def __init__(self, drop: Callable[[str], None]) -> None:
        self._drop = drop
        self._exchanged = False  # a key exchange was passed: before it a ChangeCipherSpec is lost on the library
        self._newest = -1  # number of the newest encrypted handshake record
        self.finished = 0  # records that may have been Finished
        self.repeats = False
        self.state: Literal["key exchange", "finishing", "open"] = "key exchange"

    @property
    def overdue(self) -> bool:
        """True where the records that were passed should have completed the handshake."""
        return self.state == "finishing" and self.finished >= MOST_FINISHED

    def open(self) -> None:
        """Enter the state after the handshake."""
        self.state = "open"

    def passed(self, datagram: bytes) -> bytes:
        """Return the records that the library may see, as one datagram; b"" if there are none."""
        self.repeats = False
        kept, end = [], 0
        for record in records(datagram):
            end = record.end
            fault = self._fault(record, datagram)
            if fault:
                self._drop(fault)
            else:
                kept.append(datagram[record.begin : end])
        if end < len(datagram):
            self._drop("no record")
        return b"".join(kept)

    def _fault(self, record: Record, datagram: bytes) -> str:
        kind, epoch = record.type, record.epoch
        size = record.end - record.begin - RECORD_HEADER_BYTES
        if epoch > 1:
            return "record of no epoch"
        if self.state == "open":
            if kind in (CHANGE_CIPHER_SPEC, HANDSHAKE):
                if epoch and record.number > self._newest:  # not the network's copy of an old one
                    self._newest, self.repeats = record.number, True
                return "handshake after its end"
            if kind not in (DATA, ALERT):
                return "record of no type"
            return "" if epoch else "record in the clear"
        if kind == ALERT:
            return "" if epoch or size == 2 else "alert of no length"
        if kind == CHANGE_CIPHER_SPEC and not epoch and size == 1 and self._exchanged:
            self.state = "finishing"
            return ""
        if kind != HANDSHAKE:
            return "record too early" if kind in (CHANGE_CIPHER_SPEC, DATA) else "record of no type"
        if epoch:
            return self._finished_fault(record.number, size)
        body = datagram[record.begin + RECORD_HEADER_BYTES : record.end]
        fault = message_fault(body)
        if not fault and body[0] == CLIENT_KEY_EXCHANGE:
            self._exchanged = True
        return fault

    def _finished_fault(self, number: int, size: int) -> str:
        if self.state != "finishing":
            return "record too early"
        if size > MOST_FINISHED_BYTES:
            return "handshake message too long"
        if self.finished >= MOST_FINISHED:
            return "handshake message ahead"
        self.finished += 1
        self._newest = max(self._newest, number)
        return ""
