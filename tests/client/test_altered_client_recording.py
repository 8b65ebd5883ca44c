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
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.records import Datagram, Input, Tick
from cogrip.protocol.recording.sink import encode

from tests.client.recorded_person import SCRIPT, M, Person
from tests.recorded_end import (
    a_missing_message_is_found,
    another_text_is_found,
    another_time_is_found,
    any_payload_is_judged_or_refused,
    changed_places_are_found,
    flipped,
)

OUTPUTS = SCRIPT.places("datagram_out", "event", "account")
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


@given(st.sampled_from(SCRIPT.places("datagram_out")), st.integers(0, 2**20), st.integers(1, 255))
def test_any_bit_of_a_datagram_that_was_sent_is_found(at: int, place: int, flip: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    sent = msgspec.json.decode(payload, type=Datagram).data
    new = encode(Datagram(flipped(sent, place, flip)))
    found = SCRIPT.altered(at, new).difference
    assert found is not None
    assert (found.time_ns, found.topic, found.field) == (time_ns, "/anna/datagram_out", "data")
    assert json.loads(found.recorded) == json.loads(new)["data"]
    assert json.loads(found.replayed) == json.loads(payload)["data"]


@given(st.sampled_from(OUTPUTS), st.sampled_from([-1, 1, 1000]))
def test_the_time_of_any_output_is_compared(at: int, later_ns: int) -> None:
    assume(SCRIPT.noted[at][1] + later_ns >= 0)
    another_time_is_found(SCRIPT, at, later_ns)


@pytest.mark.parametrize(("topic", "field"), [(EVENT, "text"), (ACCOUNT, "account")])
def test_events_and_accounts_are_compared(topic: int, field: str) -> None:
    for at in [at for at in OUTPUTS if SCRIPT.noted[at][0] == topic]:
        another_text_is_found(SCRIPT, at, field)


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


@given(st.sampled_from([*TICKS[5:], *OUTPUTS]))
def test_a_message_that_is_left_out_is_found(at: int) -> None:
    a_missing_message_is_found(SCRIPT, at)


@given(st.integers(0, len(SCRIPT.noted) - 2))
def test_two_messages_that_changed_places_are_found(at: int) -> None:
    one, other = SCRIPT.noted[at : at + 2]
    assume(one[0] in (TICK, DATAGRAM_OUT, EVENT, ACCOUNT) or other[0] in (TICK, DATAGRAM_OUT, EVENT, ACCOUNT))
    changed_places_are_found(SCRIPT, at)


LEAVE = encode(Input("leave", encode(Leave("bored")).decode()))
STRANGE_PAYLOADS = st.sampled_from([b"", b"{}", b"[]", b"null", b'{"kind":"fly","value":"{}"}', LEAVE, b'{"data":"?"}'])


@given(st.integers(0, 400), st.binary(max_size=40) | STRANGE_PAYLOADS)
def test_what_is_no_message_gives_a_verdict_or_a_refusal_in_words(at: int, payload: bytes) -> None:
    any_payload_is_judged_or_refused(SCRIPT, at % len(SCRIPT.noted), payload)


@pytest.mark.parametrize(
    "start", ["", "{", "[]", "{}", '{"hello": 3, "capability": {}}', '{"hello": [], "capability": []}']
)
def test_a_start_that_is_none_is_refused_in_words(start: str) -> None:
    person = Person()
    person.core.start = start
    with pytest.raises(RecordingError, match=r"client-anna.mcap cannot be replayed"):
        person.verdict()
