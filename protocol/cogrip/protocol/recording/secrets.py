"""Tokens and tickets do not stand in recordings: whoever reads one may not come in by it.

A token is left out. A ticket is replaced by its mark, so that a replay finds the seat that it opened: it plays the marks
as if they were the tickets.
"""

from collections.abc import Callable

import msgspec

from cogrip.protocol import messages
from cogrip.protocol.messages import Hello, Welcome

HEAD_BYTES = 24  # in which a hello's magic stands, however its array and tag are written
FIRST_TAG, LAST_TAG = 3, 9  # of the messages that hold no secret
Mark = Callable[[str], str]


def without_secrets(message: bytes, mark: Mark) -> bytes:
    """`message` as it may be kept. Anything but a hello or a welcome is given back as it is."""
    if not _may_hold_any(message):
        return message
    try:
        read = messages.decode(message)
    except messages.MalformedError:
        return _spoiled(message) if messages.MAGIC.encode() in message[:HEAD_BYTES] else message
    if isinstance(read, Hello) and (read.token or read.ticket):
        return messages.padded(msgspec.structs.replace(read, token="", ticket=read.ticket and mark(read.ticket)))
    if isinstance(read, Welcome) and read.ticket:
        return messages.encode(msgspec.structs.replace(read, ticket=mark(read.ticket)))
    return message


def _may_hold_any(message: bytes) -> bool:
    """Not if it is an array with one of the other tags, each one byte as senders write it: nearly all messages are."""
    place = 1 if message[:1] and message[0] & 0xF0 == 0x90 else 3
    return not (len(message) > place and FIRST_TAG <= message[place] <= LAST_TAG)


def _spoiled(hello: bytes) -> bytes:
    """A hello that is not understood, of another version or broken: what all versions share (`SPEC.md` section 3), as long as
    it was; nothing at all where that cannot be read. A core makes the same of either: refused, or malformed.
    """
    try:
        shared = msgspec.msgpack.decode(hello, type=list[msgspec.Raw])[:5]
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return bytes(len(hello))
    head = bytes([0x90 | len(shared) + 1]) + b"".join(map(bytes, shared)) + b"\xc5"
    zeros = len(hello) - len(head) - 2
    return head + zeros.to_bytes(2, "big") + bytes(zeros) if zeros >= 0 else bytes(len(hello))
