"""Decoders of messages that are compiled (`struct_decoder.pyx`), where they are."""

import importlib
import importlib.util
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

DECODER = "cogrip.protocol.struct_decoder"


def decoder_of(kind: type[T]) -> Callable[[bytes], T | None]:
    """Return the decoder of a struct: it gives None for what msgspec has to decode, which is all where it is not compiled."""
    if importlib.util.find_spec(DECODER) is None:
        return lambda datagram: None
    decode: Callable[[bytes], T | None] = importlib.import_module(DECODER).StructDecoder(kind).decode
    return decode
