"""The message of a frame: the bytes that msgspec makes of the same `Waves`, compiled or not."""

from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.line.waves_encoding import encode_waves
from cogrip.protocol.wire.clock import Clock
from cogrip.protocol.wire.handle import MOST_AGE, MOST_BUTTONS, MOST_EDGES, Handle
from cogrip.protocol.wire.messages import Stamp, Waves, encode

NUMBERS = st.floats(-1e4, 1e4)
EDGES = [1 << bits for bits in (5, 7, 8, 15, 16, 31, 32, 53)]  # where MessagePack takes another length
WHOLE = st.integers(0, 2**53) | st.sampled_from([edge + by for edge in EDGES[:-1] for by in (-1, 0, 1)])
TICKS = st.integers(-(2**31), 2**31) | st.sampled_from(
    [sign * (edge + by) for edge in EDGES[:5] for by in (-1, 0, 1) for sign in (-1, 1)]
)
TIME_NS = st.integers(1, 2**62)

EDGE = st.tuples(st.integers(-MOST_BUTTONS, MOST_BUTTONS).filter(bool), st.integers(0, MOST_AGE))
HANDLE = st.lists(EDGE, max_size=MOST_EDGES).flatmap(
    lambda edges: st.builds(
        Handle, st.integers(0, 2**32 - 1), *[st.just(tuple(each[part] for each in edges)) for part in (0, 1)],
        st.sampled_from([None, (1.0, 0.0, 0.0, 0.0), (0.6, 0.0, -0.8, 0.0)]), st.none() | st.floats(-1.0, 1.0),
    )
)  # fmt: skip


@given(st.data())
def test_the_bytes_are_those_of_the_message(data: st.DataObject) -> None:
    axes, redundancy = data.draw(st.integers(1, 6)), data.draw(st.integers(1, 13))
    sender, row = LineSender(axes, redundancy), st.tuples(*[NUMBERS] * axes)
    for wave in data.draw(st.lists(row, min_size=1, max_size=30)):
        sender.push(wave)
    clock, now_ns = Clock(), data.draw(TIME_NS)
    if data.draw(st.booleans()):
        clock.read(Stamp(data.draw(TIME_NS), 0, 0), now_ns - data.draw(st.integers(0, min(now_ns, 10**10))))
    state = data.draw(st.lists(NUMBERS, min_size=2, max_size=18).map(tuple))
    session, acknowledged, since = (
        data.draw(st.integers(1, 2**63 - 1) | WHOLE.filter(bool)),
        data.draw(WHOLE),
        data.draw(WHOLE),
    )
    phase, edges = data.draw(TICKS), data.draw(st.integers(0, 2**32 - 1))
    made_j, port_j, impedance = [data.draw(NUMBERS) for _ in range(3)]
    applied, handle = data.draw(WHOLE), data.draw(st.none() | HANDLE)
    found = encode_waves(
        session, sender, made_j, port_j, acknowledged, clock, now_ns, state, phase, impedance, since, edges, applied,
        handle,
    )  # fmt: skip
    first, waves, total, squares = sender.contents()
    assert found == encode(Waves(
        session, first, waves, total, squares, made_j, port_j, acknowledged, clock.stamp(now_ns), state, phase,
        applied, impedance, since, handle, edges,
    ))  # fmt: skip
