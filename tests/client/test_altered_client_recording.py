"""One altered field of a client's recording is found and named; what cannot be played is refused in words."""

import math

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cogrip.client.inputs import ClientInput, CloseLedger, DeviceFailed, Leave, Poll
from cogrip.client.recorder import ACCOUNT, DATAGRAM_OUT, EVENT, TICK, client_topics
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.recording.records import Datagram, Input, Tick
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Waves
from cogrip.results.replay.comparison import Difference

from tests.client.recorded_person import SCRIPT, M

TICKS = SCRIPT.places("tick")


def next_float(value: float) -> float:
    """The least change there is."""
    return math.nextafter(value, math.inf)


def tick_at(at: int) -> Tick:
    return msgspec.json.decode(SCRIPT.noted[at][2], type=Tick)


def difference(at: int, instead: msgspec.Struct) -> Difference:
    """Return what is found where this record stands at a place of the script."""
    found = SCRIPT.altered(at, encode(instead)).difference
    assert found is not None
    return found


TICK_OUTPUTS = ("velocity_mps", "force_n", "wave_up", "wave_down", "object_m", "work_j", "port_j", "margin_j", "rtt_ms")


@given(st.sampled_from(TICKS), st.sampled_from(TICK_OUTPUTS), st.integers(0, 1))
def test_the_last_bit_of_any_number_of_a_tick_is_found(at: int, field: str, axis: int) -> None:
    tick = tick_at(at)
    value = getattr(tick, field)
    row = list(value) if isinstance(value, tuple) else [value, value]
    assume(row[axis] is not None)
    old, row[axis] = row[axis], next_float(row[axis])
    changed, where = (tuple(row), f"{field}[{axis}]") if isinstance(value, tuple) else (row[axis], field)
    verdict = SCRIPT.altered(at, encode(msgspec.structs.replace(tick, **{field: changed})))
    found = verdict.difference
    assert found is not None
    assert not verdict.exact
    assert (found.time_ns, found.topic, found.field) == (SCRIPT.noted[at][1], "/anna/tick", where)
    assert (float(found.recorded), float(found.replayed)) == (row[axis], old)
    assert verdict.messages == at, "all before it is the same"
    assert not verdict.cut, "the file was closed"


@pytest.mark.parametrize(
    ("field", "value", "where", "recorded"),
    [
        ("state", "armed", "state", '"armed"'),
        ("lost", 1000, "lost", "1000"),
        ("wave_up", (0.0, -0.0), "wave_up[1]", "-0.0"),
    ],
    ids=["state", "losses", "sign of a zero"],
)
def test_what_is_no_size_of_a_tick_is_compared_too(field: str, value: object, where: str, recorded: str) -> None:
    at = TICKS[0]
    assert tick_at(at).wave_up == (0.0, 0.0)
    found = difference(at, msgspec.structs.replace(tick_at(at), **{field: value}))
    assert (found.time_ns, found.field, found.recorded) == (SCRIPT.noted[at][1], where, recorded)


@pytest.mark.parametrize(
    ("kind", "instead", "topic", "field"),
    [
        ("connect", Poll(), DATAGRAM_OUT, ""),  # the hello was sent, and is not now
        ("keep_seat", Poll(), DATAGRAM_OUT, ""),
        ("device_failed", DeviceFailed("device: burnt"), EVENT, "text"),
        ("rearm", Poll(), TICK, "force_n[0]"),
        ("stop", Poll(), TICK, "force_n[0]"),
        ("leave", Leave("I am bored"), DATAGRAM_OUT, "data"),
        ("close_ledger", CloseLedger(TickCount(1, 1)), ACCOUNT, "account"),
    ],
)
def test_another_input_is_found_by_what_comes_of_it(kind: str, instead: ClientInput, topic: int, field: str) -> None:
    at = next(at for at in SCRIPT.places("input") if msgspec.json.decode(SCRIPT.noted[at][2], type=Input).kind == kind)
    verdict = SCRIPT.altered(at, encode(Input(str(instead.__struct_config__.tag), encode(instead).decode())))
    found = verdict.difference
    assert found is not None
    following = next(number for number in range(at + 1, len(SCRIPT.noted)) if SCRIPT.noted[number][0] == topic)
    assert verdict.messages >= at
    assert found.time_ns == SCRIPT.noted[following][1]
    assert (found.topic, found.field) == (client_topics("anna")[topic], field)
    assert found.recorded != found.replayed


def test_a_wave_that_was_heard_otherwise_is_found_where_it_is_played() -> None:
    at = SCRIPT.places("datagram_in")[4]
    received = messages.decode(msgspec.json.decode(SCRIPT.noted[at][2], type=Datagram).data)
    assert isinstance(received, Waves)
    wave = (*received.waves[:-1], received.waves[-1] * (1.0 + 1e-12))
    found = difference(at, Datagram(messages.encode(msgspec.structs.replace(received, waves=wave))))
    assert (found.time_ns, found.topic, found.field) == (SCRIPT.noted[at][1], "/anna/tick", "force_n[1]")
    assert float(found.replayed) == pytest.approx(float(found.recorded), rel=1e-9)


@given(st.sampled_from(TICKS[5:50]), st.integers(0, 1))
def test_a_hand_that_was_elsewhere_is_found_at_that_tick(at: int, axis: int) -> None:
    tick = tick_at(at)
    place = list(tick.position_m or ())
    place[axis] += 1e-9  # type: ignore[operator]
    found = difference(at, msgspec.structs.replace(tick, position_m=tuple(place)))
    border = tick.tick % M == 0  # then the frame was sent before the tick was noted
    where = ("/anna/datagram_out", "data") if border else ("/anna/tick", f"velocity_mps[{axis}]")
    assert (found.time_ns, found.topic, found.field) == (SCRIPT.noted[at][1], *where)
