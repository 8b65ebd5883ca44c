"""One altered field of a client's recording is found and named; what cannot be played is refused in words."""

import json
import math

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cogrip.client.inputs import ClientInput, CloseLedger, DeviceFailed, Leave, Poll
from cogrip.client.recorder import ACCOUNT, DATAGRAM_OUT, EVENT, INPUT, TICK, client_topics
from cogrip.protocol import messages
from cogrip.protocol.accounts import TickCount
from cogrip.protocol.messages import Waves
from cogrip.protocol.recording.records import Datagram, Input, Tick
from cogrip.protocol.recording.sink import encode

from tests.client.recorded_person import SCRIPT, M

TICKS = SCRIPT.places("tick")


def next_float(value: float) -> float:
    """The least change there is."""
    return math.nextafter(value, math.inf)


TICK_OUTPUTS = ("velocity_mps", "force_n", "wave_up", "wave_down", "object_m", "work_j", "port_j", "margin_j", "rtt_ms")


@given(st.sampled_from(TICKS), st.sampled_from(TICK_OUTPUTS), st.integers(0, 1))
def test_the_last_bit_of_any_number_of_a_tick_is_found(at: int, field: str, axis: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    tick = msgspec.json.decode(payload, type=Tick)
    value = getattr(tick, field)
    where = field
    if isinstance(value, tuple):
        assume(value[axis] is not None)
        old, new = value[axis], next_float(value[axis])
        value = tuple(new if number == axis else each for number, each in enumerate(value))
        where = f"{field}[{axis}]"
    else:
        assume(value is not None)
        old, new = value, next_float(value)
        value = new
    verdict = SCRIPT.altered(at, encode(msgspec.structs.replace(tick, **{field: value})))
    found = verdict.difference
    assert found is not None
    assert not verdict.exact
    assert (found.time_ns, found.topic, found.field) == (time_ns, "/anna/tick", where)
    assert (float(found.recorded), float(found.replayed)) == (new, old)
    assert verdict.messages == at, "all before it is the same"
    assert not verdict.cut, "the file was closed"


@pytest.mark.parametrize(("field", "value"), [("state", "armed"), ("lost", 1000)])
def test_state_and_losses_of_a_tick_are_compared(field: str, value: str | int) -> None:
    at = TICKS[40]
    tick = msgspec.json.decode(SCRIPT.noted[at][2], type=Tick)
    found = SCRIPT.altered(at, encode(msgspec.structs.replace(tick, **{field: value}))).difference
    assert found is not None
    assert (found.time_ns, found.field) == (SCRIPT.noted[at][1], field)
    assert found.recorded == json.dumps(value)


def test_the_sign_of_a_zero_is_a_difference() -> None:
    at = TICKS[0]
    tick = msgspec.json.decode(SCRIPT.noted[at][2], type=Tick)
    assert tick.wave_up == (0.0, 0.0)
    found = SCRIPT.altered(at, encode(msgspec.structs.replace(tick, wave_up=(0.0, -0.0)))).difference
    assert found is not None
    assert (found.field, found.recorded, found.replayed) == ("wave_up[1]", "-0.0", "0.0")


def _input(kind: str) -> int:
    """Return where the first input of this kind stands."""
    return next(
        at
        for at, (topic, _, payload) in enumerate(SCRIPT.noted)
        if topic == INPUT and msgspec.json.decode(payload, type=Input).kind == kind
    )


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
    at = _input(kind)
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
    wave = (*received.waves[:-1], next_float(received.waves[-1]))
    found = SCRIPT.altered(
        at, encode(Datagram(messages.encode(msgspec.structs.replace(received, waves=wave))))
    ).difference
    assert found is not None
    assert (found.time_ns, found.topic, found.field) == (SCRIPT.noted[at][1], "/anna/tick", "wave_down[1]")
    assert float(found.replayed) == next_float(float(found.recorded))


@given(st.sampled_from(TICKS[5:50]), st.integers(0, 1))
def test_a_hand_that_was_elsewhere_is_found_at_that_tick(at: int, axis: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    tick = msgspec.json.decode(payload, type=Tick)
    assert tick.position_m is not None
    place = tuple(each + 1e-9 if number == axis else each for number, each in enumerate(tick.position_m))  # type: ignore[operator]
    found = SCRIPT.altered(at, encode(msgspec.structs.replace(tick, position_m=place))).difference
    assert found is not None
    border = tick.tick % M == 0  # then the frame was sent before the tick was noted
    where = ("/anna/datagram_out", "data") if border else ("/anna/tick", f"velocity_mps[{axis}]")
    assert (found.time_ns, found.topic, found.field) == (time_ns, *where)
