"""Tokens and tickets do not stand in recordings: whoever reads one may not come in by it.

A token is left out. A ticket is replaced by its mark, so that a replay finds the seat that it opened: it plays the marks
as if they were the tickets.
"""

from collections.abc import Callable

import msgspec

from cogrip.protocol import messages
from cogrip.protocol.messages import Hello, Welcome

Mark = Callable[[str], str]


def without_secrets(message: bytes, mark: Mark) -> bytes:
    """`message` as it may be kept. Anything but a hello or a welcome with a secret in it is given back as it is."""
    if _tag(message) not in (1, 2):
        return message
    try:
        read = messages.decode(message)
    except messages.MalformedError:
        return _foreign(message) if _tag(message) == 1 else message
    if isinstance(read, Hello) and (read.token or read.ticket):
        return messages.padded(msgspec.structs.replace(read, token="", ticket=read.ticket and mark(read.ticket)))
    if isinstance(read, Welcome) and read.ticket:
        return messages.encode(msgspec.structs.replace(read, ticket=mark(read.ticket)))
    return message


def _foreign(hello: bytes) -> bytes:
    """A hello of another version, cut to what all versions share (`SPEC.md` section 3), as long as it was."""
    try:
        shared = msgspec.msgpack.decode(hello, type=list[msgspec.Raw])[:5]
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return hello
    head = bytes([0x90 | len(shared) + 1]) + b"".join(map(bytes, shared)) + b"\xc5"
    zeros = len(hello) - len(head) - 2
    return head + zeros.to_bytes(2, "big") + bytes(zeros) if zeros >= 0 else hello


def _tag(message: bytes) -> int:
    """The tag of a MessagePack array, -1 where it is none. Tags are below 128, so they are one byte."""
    if not message:
        return -1
    head = message[0]
    place = 1 if head & 0xF0 == 0x90 else {0xDC: 3, 0xDD: 5}.get(head, 0)
    return message[place] if place and len(message) > place else -1
