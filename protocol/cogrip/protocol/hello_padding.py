"""Length of a hello: as long as any answer to it, with the part of a device address that its own field is too short for."""

from typing import TYPE_CHECKING

import msgspec

from cogrip.protocol.texts import clipped

if TYPE_CHECKING:
    from cogrip.protocol.messages import Hello

HELLO_BYTES = 1024  # length to which a hello is padded: no answer to an unauthenticated peer is longer than its request
SHORT = 40  # most characters of a ShortText
DEVICE_BYTES = 200  # longest device address: its beginning stands in `device`, the whole in the padding

_encode = msgspec.msgpack.Encoder().encode


def padded(hello: "Hello") -> bytes:
    """Return a hello at its full length of HELLO_BYTES. The padding is always a bin 16: so every length is possible."""
    short = with_short_device(hello)
    bare = _encode(msgspec.structs.replace(short, padding=b""))[:-2]
    length = HELLO_BYTES - len(bare) - 3
    return bare + b"\xc5" + length.to_bytes(2, "big") + short.padding[:length].ljust(length, b"\0")


def with_short_device(hello: "Hello") -> "Hello":
    """Return a hello in wire form: a device address that is too long for its field stands whole in the padding."""
    if len(hello.device) <= SHORT:
        return msgspec.structs.replace(hello, padding=b"")
    whole = clipped(hello.device, DEVICE_BYTES).encode()
    return msgspec.structs.replace(hello, device=hello.device[:SHORT], padding=whole)


def with_whole_device(hello: "Hello") -> "Hello":
    """Return a hello from its wire form: the padding's text up to a zero is the address, if it begins with the field's."""
    try:
        whole = hello.padding[: DEVICE_BYTES + 1].partition(b"\0")[0].decode()
    except UnicodeDecodeError:
        whole = ""
    longer = len(whole) > SHORT == len(hello.device) and len(whole.encode()) <= DEVICE_BYTES
    fits = longer and whole.startswith(hello.device)
    return msgspec.structs.replace(hello, device=whole, padding=b"") if fits else hello
