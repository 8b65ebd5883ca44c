"""One altered field of a server's recording is found and named; what cannot be played is refused in words."""

import json
import math
import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cogrip.machine.tick_count import TickCount
from cogrip.protocol.recording.records import Answer, Datagram, Input, Step
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Waves
from cogrip.server.inputs import Stop
from cogrip.server.recorder import ANSWER, DATAGRAM_IN, DATAGRAM_OUT, EVENT, INPUT

from tests.server.recorded_rooms import SCRIPT, STEP

STEPS = SCRIPT.places("step")
STEP_FIELDS = st.sampled_from(["object_m[0]", "object_m[1]", "object_mps[0]"])
SEAT_FIELDS = st.sampled_from(
    ["proxy_m[0]", "proxy_m[1]", "force_n[1]", "up_margin_j", "line_margin_j", "up_used_j", "down_made_j"]
)


@given(st.sampled_from(STEPS), STEP_FIELDS | st.builds("seats[{}].{}".format, st.integers(0, 1), SEAT_FIELDS))
def test_the_last_bit_of_any_number_of_a_step_is_found(at: int, where: str) -> None:
    topic, time_ns, payload = SCRIPT.noted[at]
    table = json.loads(payload)
    path: list[Any] = [int(key) if key.isdigit() else key for key in re.findall(r"\w+", where)]
    assume(path[0] != "seats" or path[1] < len(table["seats"]))
    holder = table
    for key in path[:-1]:
        holder = holder[key]
    old = holder[path[-1]]
    assume(old is not None)
    holder[path[-1]] = new = math.nextafter(old, math.inf)
    verdict = SCRIPT.altered(at, encode(table))
    found = verdict.difference
    assert found is not None
    assert (found.time_ns, found.topic, found.field) == (time_ns, SCRIPT.topics[topic], where)
    assert (float(found.recorded), float(found.replayed)) == (new, old)
    assert verdict.messages == at, "all before it is the same"
    assert not verdict.exact
    assert not verdict.cut, "the file was closed"


@pytest.mark.parametrize(
    ("where", "value"), [("step", 10**6), ("seats[0].lost", 77), ("seats[1].user", "zoe"), ("seats[0].seated", False)]
)
def test_counts_and_names_of_a_step_are_compared(where: str, value: Any) -> None:
    at = next(at for at in STEPS[20:] if SCRIPT.noted[at][0] == STEP)
    table = json.loads(SCRIPT.noted[at][2])
    holder, key = (table, where) if "." not in where else (table["seats"][int(where[6])], where[9:])
    holder[key] = value
    found = SCRIPT.altered(at, encode(table)).difference
    assert found is not None
    assert (found.time_ns, found.field, found.recorded) == (SCRIPT.noted[at][1], where, json.dumps(value))


def test_to_whom_a_datagram_was_sent_is_compared() -> None:
    at = SCRIPT.places("datagram_out")[0]
    sent = msgspec.json.decode(SCRIPT.noted[at][2], type=Datagram)
    found = SCRIPT.altered(at, encode(Datagram(sent.data, '["127.0.0.1",4009]'))).difference
    assert found is not None
    assert found.field == "address"
    assert (json.loads(found.recorded), json.loads(found.replayed)) == ('["127.0.0.1",4009]', sent.address)


def _first(topic: int, record: type[Any], holds: Callable[[Any], bool]) -> tuple[int, Any]:
    for at, (each, _, payload) in enumerate(SCRIPT.noted):
        if each == topic and holds(one := msgspec.json.decode(payload, type=record)):
            return at, one
    raise LookupError


TICKS = encode(TickCount(9, 9)).decode()


@pytest.mark.parametrize(
    ("topic", "record", "holds", "change", "found_in", "field"),
    [
        (ANSWER, Answer, lambda answer: answer.session, {"session": 5}, DATAGRAM_OUT, "data"),
        (ANSWER, Answer, lambda answer: answer.ticks, {"ticks": TICKS}, DATAGRAM_OUT, "data"),
        (ANSWER, Answer, lambda answer: answer.ticks, {"room": "hall"}, ANSWER, "room"),
        (INPUT, Input, lambda given: given.kind == "stop", {"value": encode(Stop("enough")).decode()}, DATAGRAM_OUT, "data"),
        (STEP, Step, lambda step: step.frames == 3, {"frames": 1}, DATAGRAM_OUT, "data"),
        (DATAGRAM_IN, Datagram, lambda heard: True, {"address": '["127.0.0.1",4444]'}, EVENT, "text"),
    ],
    ids=["a session's number", "the loop's ticks", "whose ticks", "why it stops", "frames of a step", "who said it"],
)  # fmt: skip
def test_another_input_is_found_by_what_comes_of_it(
    topic: int, record: type[Any], holds: Callable[[Any], bool], change: dict[str, Any], found_in: int, field: str
) -> None:
    at, old = _first(topic, record, holds)
    found = SCRIPT.altered(at, encode(msgspec.structs.replace(old, **change))).difference
    assert found is not None
    assert (found.topic, found.field) == (SCRIPT.topics[found_in], field)
    times_ns = [time_ns for topic, time_ns, _ in SCRIPT.noted if topic == found_in]
    assert found.time_ns == min(time_ns for time_ns in times_ns if time_ns >= SCRIPT.noted[at][1])
    assert found.recorded != found.replayed


def test_a_wave_that_was_heard_otherwise_is_found_where_it_is_played() -> None:
    def waves(heard: Datagram) -> bool:
        try:
            said = messages.decode(heard.data)
        except messages.MalformedError:
            return False
        return isinstance(said, Waves) and said.waves[0] != 0.0

    at, heard = _first(DATAGRAM_IN, Datagram, waves)
    said = messages.decode(heard.data)
    assert isinstance(said, Waves)
    wave = (math.nextafter(said.waves[0], 1.0), *said.waves[1:])
    other = Datagram(messages.encode(msgspec.structs.replace(said, waves=wave)), heard.address)
    verdict = SCRIPT.altered(at, encode(other))
    found = verdict.difference
    assert found is not None
    assert found.time_ns == SCRIPT.noted[at][1], "in the same step"
    assert found.topic in ("/server/datagram_out", "/room/lab/step")
    assert at < verdict.messages < at + 8


def test_an_answer_that_is_left_out_before_one_of_another_kind_is_found() -> None:
    """Answers are given in order: without it a session's number would be given for a loop's ticks."""
    answers = [(at, msgspec.json.decode(SCRIPT.noted[at][2], type=Answer)) for at in SCRIPT.places("answer")]
    out_of_step = [at for (at, answer), (_, then) in pairwise(answers) if answer.ticks and not then.ticks]
    assert out_of_step
    for at in out_of_step:
        SCRIPT.misses(at)
