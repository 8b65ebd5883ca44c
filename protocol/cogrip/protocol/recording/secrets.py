"""Removal of tokens and tickets from recordings: a reader of one must not be able to join by it.

A token is left out. A ticket is replaced by its hash: a replay uses the hashes as tickets, and so finds the same seats.
"""

from collections.abc import Callable

import msgspec

from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Hello, Welcome

HEAD_BYTES = 24  # bytes in which a hello's magic stands, however its array and tag are written
FIRST_TAG, LAST_TAG = 3, 10  # range of the tags of messages that hold no secret
TicketHash = Callable[[str], str]


def without_secrets(message: bytes, ticket_hash: TicketHash) -> bytes:
    """Return `message` without its secrets. Anything but a hello or a welcome is returned as it is."""
    if not _may_hold_any(message):
        return message
    try:
        read = messages.decode(message)
    except messages.MalformedError:
        return _blanked(message) if messages.MAGIC.encode() in message[:HEAD_BYTES] else message
    if isinstance(read, Hello) and (read.token or read.ticket):
        return messages.padded(msgspec.structs.replace(read, token="", ticket=read.ticket and ticket_hash(read.ticket)))
    if isinstance(read, Welcome) and read.ticket:
        return messages.encode(msgspec.structs.replace(read, ticket=ticket_hash(read.ticket)))
    return message


def _may_hold_any(message: bytes) -> bool:
    """Return False for an array with one of the other tags, each one byte as senders write it: nearly all messages are."""
    place = 1 if message[:1] and message[0] & 0xF0 == 0x90 else 3
    return not (len(message) > place and FIRST_TAG <= message[place] <= LAST_TAG)


def _blanked(hello: bytes) -> bytes:
    """Return a hello of another version, or a malformed one, with only what all versions share (`SPEC.md` section 3) and
    zeros; only zeros where that cannot be read. A core treats both alike: refused, or malformed.
    """
    try:
        shared = msgspec.msgpack.decode(hello, type=list[msgspec.Raw])[:5]
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return bytes(len(hello))
    head = bytes([0x90 | len(shared) + 1]) + b"".join(map(bytes, shared)) + b"\xc5"
    zeros = len(hello) - len(head) - 2
    return head + zeros.to_bytes(2, "big") + bytes(zeros) if zeros >= 0 else bytes(len(hello))
