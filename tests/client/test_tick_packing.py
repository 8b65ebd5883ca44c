"""The record of a client's tick, packed part by part: the bytes that msgspec makes of the whole, compiled or not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.tick_packing import pack_tick
from cogrip.protocol.recording.records import Tick
from cogrip.protocol.recording.sink import pack

NUMBERS = st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, 5e-324])
EDGES = [1 << bits for bits in (5, 7, 8, 15, 16, 31, 32, 53)]  # where MessagePack takes another length
WHOLE = st.integers(0, 2**53) | st.sampled_from([edge + by for edge in EDGES for by in (-1, 0, 1)])
LAST = "device_reserve_j"


@given(st.data())
def test_the_bytes_are_those_of_the_tick(data: st.DataObject) -> None:
    row = st.tuples(*[NUMBERS] * data.draw(st.integers(1, 6)))
    head = (
        data.draw(WHOLE), data.draw(st.integers(-(2**31), 2**31)), data.draw(WHOLE), data.draw(st.none() | row), data.draw(row),
        data.draw(row), data.draw(NUMBERS), data.draw(NUMBERS),
    )  # fmt: skip
    left_j, tick = data.draw(NUMBERS), Tick(*head, *[data.draw(row) for _ in range(3)], lost=data.draw(WHOLE))
    names = tick.__struct_fields__[len(head) : -1]
    rest = b"".join(pack(name) + pack(getattr(tick, name)) for name in names) + pack(LAST)
    whole = Tick(**{name: getattr(tick, name) for name in tick.__struct_fields__[:-1]}, device_reserve_j=left_j)
    assert pack_tick(*head, rest, left_j) == pack(whole)


@pytest.mark.parametrize("rest", [b"", b"x" * 100_000])
def test_the_rest_may_have_any_length(rest: bytes) -> None:
    made = pack_tick(1, 0, 0, None, (0.0,), (1.0,), 0.5, -0.5, rest, 2.0)
    assert made.endswith(rest + pack(2.0))
    assert len(made) == len(pack_tick(1, 0, 0, None, (0.0,), (1.0,), 0.5, -0.5, b"", 2.0)) + len(rest)
