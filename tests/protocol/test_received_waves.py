"""Waves as a line takes them in: the numbers of the message to the last bit; compiled, decoded as msgspec decodes them."""

import importlib.util
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Stamp, Waves, encode

from tests.protocol.valid_values import valid

spec = importlib.util.find_spec("cogrip.protocol.line.received_waves")
COMPILED = spec is not None and str(spec.origin).endswith((".so", ".pyd"))
compiled = pytest.mark.skipif(not COMPILED, reason="received_waves is not compiled (`python3 dev.py compile`)")
theirs = msgspec.msgpack.Decoder(Waves).decode
NAMES = (
    "session", "first", "acknowledged", "made_j", "port_j", "phase", "applied", "impedance_nspm", "since", "edges",
)  # fmt: skip
EXAMPLE = Waves(1, 2, (0.5, -0.0), (1.0,), (2.0,), 0.25, 0.125, 3, Stamp(9, 8, 7), (1.0, 2.0), -5, 6, 40.0, 1)

sent = valid(Waves, handle=st.none())


def bits(row: tuple[float, ...]) -> list[str]:
    return [value.hex() for value in row]  # the sign of zeros, too


def check(found: ReceivedWaves, waves: Waves) -> None:
    assert [getattr(found, name) for name in NAMES] == [getattr(waves, name) for name in NAMES]
    assert Stamp(found.sent_ns, found.echo_ns, found.held_ns) == waves.stamp
    assert (found.numbers, found.states) == (len(waves.waves), len(waves.state))
    assert bits(found.state_from(0, found.states)) == bits(waves.state)
    assert found.axes == (len(waves.total) if len(waves.total) == len(waves.squares) else 0)
    if found.axes:
        assert bits(found.total_row()) == bits(waves.total)
        assert bits(found.squares_row()) == bits(waves.squares)
        frames = [found.frame(place) for place in range(found.numbers // found.axes)]
        whole = waves.waves[: found.numbers // found.axes * found.axes]
        assert bits(tuple(value for frame in frames for value in frame)) == bits(whole)


@given(sent)
def test_a_message_that_is_read_keeps_its_numbers(waves: Waves) -> None:
    found = ReceivedWaves()
    found.read(EXAMPLE)  # what it took in before is gone
    found.read(waves)
    check(found, waves)


@compiled
@given(sent)
def test_what_is_sent_is_decoded_as_it_was(waves: Waves) -> None:
    found = ReceivedWaves()
    assert found.decode(encode(waves))
    check(found, waves)


@compiled
@given(sent, st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 255)), min_size=1, max_size=4))
def test_of_altered_bytes_it_takes_in_what_msgspec_decodes_or_nothing(
    waves: Waves, changes: list[tuple[int, int]]
) -> None:
    altered = bytearray(encode(waves))
    for place, value in changes:
        altered[place % len(altered)] = value
    found = ReceivedWaves()
    if found.decode(bytes(altered)):
        check(found, theirs(bytes(altered)))


@compiled
@given(st.binary(max_size=200), st.integers(0, 400))
def test_of_anything_else_it_takes_in_what_msgspec_decodes_or_nothing(noise: bytes, length: int) -> None:
    found = ReceivedWaves()
    for datagram in (noise, encode(EXAMPLE)[:length] + noise, encode(EXAMPLE)[:length]):
        if found.decode(datagram):
            check(found, theirs(datagram))


def changed(**fields: Any) -> bytes:
    return encode(msgspec.structs.replace(EXAMPLE, **fields))


@compiled
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

    found = ReceivedWaves()
    for bound in (least, most):
        assert found.decode(changed(**{name: bound}))
        assert getattr(found, name) == bound
    for value in (beyond(least, -1), beyond(most, 1)):
        assert not found.decode(changed(**{name: value}))
        with pytest.raises(msgspec.ValidationError):
            theirs(changed(**{name: value}))


@compiled
def test_what_msgspec_has_to_decide_is_left_to_it() -> None:
    found = ReceivedWaves()
    for value in (math.inf, -math.inf, math.nan):
        assert not found.decode(changed(waves=(value,)))
    rounded = msgspec.to_builtins(msgspec.structs.replace(EXAMPLE, waves=(1.0,)))
    rounded[3] = [1]  # a whole number in place of a float
    assert not found.decode(msgspec.msgpack.encode(rounded))
    assert theirs(msgspec.msgpack.encode(rounded)).waves == (1.0,)
    assert not found.decode(changed(handle=Handle(0, (), ())))
    assert not found.decode(encode(EXAMPLE) + b"\x00")
    for length in range(len(encode(EXAMPLE))):
        assert not found.decode(encode(EXAMPLE)[:length])


def test_a_datagram_of_more_numbers_than_any_line_sends_is_of_none() -> None:
    found = ReceivedWaves()
    found.put(0, (1.0,) * 193, (0.0,), (0.0,), (0.0, 0.0, 0), 0)
    assert found.numbers in (0, 193)  # compiled, there is no room for it; `LineReceiver` refuses both
    found.put(0, (1.0,), (0.0,), (0.0, 0.0), (0.0, 0.0, 0), 0)
    assert found.axes == 0
