"""Recordings of a client and of a server: one altered message is found and named; what cannot be played is refused in words."""

import json

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cogrip.client.inputs import Leave, Poll
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.records import Datagram, Input, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.results.replay.comparison import FirstDifference
from cogrip.server.inputs import Idle

from tests.client.recorded_person import SCRIPT as CLIENT
from tests.client.recorded_person import Person
from tests.extent import every
from tests.recorded_end import RecordedEnd, flipped
from tests.server.recorded_rooms import SCRIPT as SERVER
from tests.server.recorded_rooms import Server

either = pytest.mark.parametrize("end", [CLIENT, SERVER], ids=["client", "server"])
both = pytest.mark.parametrize("make", [Person, Server])
OUTPUTS = ("datagram_out", "event", "account")
COMPARED = {  # messages whose lack is found at once
    "client": [*CLIENT.places("tick")[5:], *CLIENT.places(*OUTPUTS)],
    "server": SERVER.places("step", "answer", *OUTPUTS),
}
ORDERED = {*OUTPUTS, "tick", "answer"}  # of two inputs either order is one that may be
LEAVE = encode(Input("leave", encode(Leave("bored")).decode()))
IDLE_NOWHERE = encode(Input("idle", encode(Idle("attic", 3)).decode()))
STRANGE = (
    b"", b"{}", LEAVE, b"[]", IDLE_NOWHERE, b"null", b'{"kind":"fly","value":"{}"}', b'{"step":1}', b'{"ticks":"?"}',
    b'{"data":"?"}',
)  # fmt: skip


def difference(end: RecordedEnd, at: int, payload: bytes, later_ns: int = 0) -> FirstDifference:
    """Alter a message, or its time; return what is found, of its topic."""
    topic, time_ns, _ = end.noted[at]
    found = end.altered(at, payload, time_ns + later_ns).difference
    assert found is not None
    assert found.topic == end.topics[topic]
    return found


@either
@given(st.data(), st.integers(0, 2**20), st.integers(1, 255))
def test_any_bit_of_a_datagram_that_was_sent_is_found(end: RecordedEnd, data, place: int, bits: int) -> None:
    at = data.draw(st.sampled_from(end.places("datagram_out")))
    _, time_ns, payload = end.noted[at]
    sent = msgspec.json.decode(payload, type=Datagram)
    new = encode(msgspec.structs.replace(sent, data=flipped(sent.data, place, bits)))
    found = difference(end, at, new)
    assert (found.time_ns, found.field) == (time_ns, "data")
    assert json.loads(found.recorded) == json.loads(new)["data"]
    assert json.loads(found.replayed) == json.loads(payload)["data"]


@either
@given(st.data(), st.sampled_from([-1, 1, 1000]))
def test_the_time_of_any_output_is_compared(end: RecordedEnd, data, later_ns: int) -> None:
    at = data.draw(st.sampled_from(end.places(*OUTPUTS)))
    _, time_ns, payload = end.noted[at]
    assume(time_ns + later_ns >= 0)
    found = difference(end, at, payload, later_ns)
    assert (found.field, found.recorded, found.replayed) == ("time_ns", str(time_ns + later_ns), str(time_ns))


@pytest.mark.sample(1)
@either
@pytest.mark.parametrize(("kind", "field"), [("event", "text"), ("account", "account")])
def test_events_and_accounts_are_compared(end: RecordedEnd, kind: str, field: str) -> None:
    for at in end.places(kind):
        _, time_ns, payload = end.noted[at]
        before = json.loads(payload)[field]
        found = difference(end, at, encode({field: before + " "}))
        assert (found.time_ns, found.field) == (time_ns, field)
        assert (json.loads(found.recorded), json.loads(found.replayed)) == (before + " ", before)


@either
@given(st.data())
def test_a_message_that_is_left_out_is_found(end: RecordedEnd, data) -> None:
    end.misses(data.draw(st.sampled_from(COMPARED[end.role])))


@either
@given(st.data())
def test_two_messages_that_changed_places_are_found(end: RecordedEnd, data) -> None:
    at = data.draw(st.integers(0, len(end.noted) - 2))
    one, other = end.noted[at : at + 2]
    assume(ORDERED & {kind_of(end.topics[each[0]]) for each in (one, other)})
    assume(one != other)
    verdict = end.verdict([*end.noted[:at], other, one, *end.noted[at + 2 :]])
    assert verdict.difference is not None
    assert verdict.difference.time_ns >= one[1]


def judged_or_refused(end: RecordedEnd, at: int, payload: bytes) -> None:
    """Exact is at most what stands for an input that did nothing: its lack is not found either."""
    said = f"{end.file} cannot be replayed"
    try:
        exact = end.altered(at, payload).exact
    except RecordingError as error:
        said, exact = str(error), False
    assert f"{end.file} cannot be replayed" in said
    assert not exact or end.verdict([*end.noted[:at], *end.noted[at + 1 :]]).exact


def test_a_second_leave_may_stand_for_a_poll_that_did_nothing() -> None:
    at = CLIENT.places("input")[-1]
    assert CLIENT.noted[at][2] == encode(Input("poll", encode(Poll()).decode()))
    assert CLIENT.altered(at, LEAVE).exact
    judged_or_refused(CLIENT, at, LEAVE)
    judged_or_refused(CLIENT, CLIENT.places("input")[0], LEAVE)


@either
@given(st.data(), st.binary(max_size=40) | st.sampled_from(STRANGE))
def test_any_bytes_give_a_verdict_or_a_refusal_in_words(end: RecordedEnd, data, payload: bytes) -> None:
    judged_or_refused(end, data.draw(st.integers(0, len(end.noted) - 1)), payload)


@pytest.mark.sample(3)
@either
@pytest.mark.parametrize("payload", every(2, STRANGE))
def test_what_is_no_message_gives_a_verdict_or_a_refusal_in_words(end: RecordedEnd, payload: bytes) -> None:
    topics = [topic for topic, *_ in end.noted]
    for topic in set(topics):
        judged_or_refused(end, topics.index(topic), payload)


@both
@pytest.mark.parametrize(
    "start",
    [
        "", "{", "[]", "{}", '{"hello": 3, "capability": {}}', '{"hello": [], "capability": []}',
        '{"rooms": 3, "software": ""}', '{"rooms": [{"name": ""}], "software": ""}',
    ],
)  # fmt: skip
def test_a_start_that_is_none_is_refused_in_words(make: type[Person | Server], start: str) -> None:
    end = make()
    end.core.start = start
    with pytest.raises(RecordingError, match=f"{end.file} cannot be replayed"):
        end.verdict()
