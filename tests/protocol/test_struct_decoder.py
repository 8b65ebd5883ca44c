"""The compiled decoder of waves: what it decodes is msgspec's to the last bit, and what msgspec refuses it leaves alone."""

import importlib
import importlib.util
import math
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.handle import Handle
from cogrip.protocol.messages import Hello, Stamp, Waves, encode
from cogrip.protocol.struct_decoding import DECODER

from tests.protocol.valid_values import valid

if importlib.util.find_spec(DECODER) is None:
    pytest.skip("struct_decoder is not compiled (`python3 dev.py compile`)", allow_module_level=True)

Made: Any = importlib.import_module(DECODER).StructDecoder
decode: Callable[[bytes], Waves | None] = Made(Waves).decode
theirs = msgspec.msgpack.Decoder(Waves).decode

sent = valid(Waves, handle=st.none())
EXAMPLE = Waves(1, 2, (0.5, -0.0), (1.0,), (2.0,), 0.25, 0.125, 3, Stamp(9, 8, 7), (1.0, 2.0), -5, 6, 40.0, 1)


@given(sent)
def test_what_is_sent_is_decoded_as_it_was(waves: Waves) -> None:
    found = decode(encode(waves))
    assert found == waves
    assert encode(found) == encode(waves), "the sign of zeros, too"


@given(sent, st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 255)), min_size=1, max_size=4))
def test_of_altered_bytes_it_gives_what_msgspec_gives_or_nothing(waves: Waves, changes: list[tuple[int, int]]) -> None:
    altered = bytearray(encode(waves))
    for place, value in changes:
        altered[place % len(altered)] = value
    found = decode(bytes(altered))
    if found is not None:
        assert encode(found) == encode(theirs(bytes(altered)))


@given(st.binary(max_size=200), st.integers(0, 400))
def test_of_anything_else_it_gives_what_msgspec_gives_or_nothing(noise: bytes, length: int) -> None:
    for datagram in (noise, encode(EXAMPLE)[:length] + noise, encode(EXAMPLE)[:length]):
        found = decode(datagram)
        if found is not None:
            assert encode(found) == encode(theirs(datagram))


def changed(**fields: Any) -> bytes:
    return encode(msgspec.structs.replace(EXAMPLE, **fields))


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("session", 1, 2**63 - 1), ("first", 0, 2**53), ("phase", -(2**31), 2**31), ("edges", 0, 2**32 - 1),
        ("made_j", -1e15, 1e15), ("impedance_nspm", 0.0, 1e4),
    ],
)  # fmt: skip
def test_both_sides_of_the_bounds_of_numbers(name: str, least: Any, most: Any) -> None:
    def beyond(bound: Any, sign: int) -> Any:
        return bound + sign if isinstance(bound, int) else math.nextafter(bound, sign * math.inf)

    for bound in (least, most):
        assert getattr(decode(changed(**{name: bound})), name) == bound
    for value in (beyond(least, -1), beyond(most, 1)):
        assert decode(changed(**{name: value})) is None
        with pytest.raises(msgspec.ValidationError):
            theirs(changed(**{name: value}))


def test_what_msgspec_has_to_decide_is_left_to_it() -> None:
    whole = msgspec.msgpack.encode([4, *msgspec.to_builtins(EXAMPLE)[1:]])
    assert decode(whole) == EXAMPLE
    rounded = msgspec.to_builtins(msgspec.structs.replace(EXAMPLE, waves=(1.0,)))
    rounded[3] = [1]  # a whole number in place of a float
    assert decode(msgspec.msgpack.encode(rounded)) is None
    assert theirs(msgspec.msgpack.encode(rounded)).waves == (1.0,)
    assert decode(changed(handle=Handle(0, (), ()))) is None
    assert decode(encode(EXAMPLE) + b"\x00") is None
    for length in range(len(encode(EXAMPLE))):
        assert decode(encode(EXAMPLE)[:length]) is None


def test_it_says_which_structs_it_cannot_decode() -> None:
    with pytest.raises(TypeError, match="a field of Hello"):
        Made(Hello)
