"""A recorded client plays again bit for bit, whatever happened to it."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.client.inputs import Connect, DeviceFailed, KeepSeat, Rearm, Stop
from cogrip.client.recorder import DATAGRAM_IN, DATAGRAM_OUT, EVENT, INPUT, KINDS, TICK, RecordedClient, start_of
from cogrip.protocol.recording.records import Datagram, Input, Tick
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Hello, Welcome

from tests.client.recorded_person import SCRIPT, TICKET, TOKEN, Person, Word, capability, outages
from tests.kinds import SCHEMES, objects_of
from tests.recorded_end import nothing_is_judged_after_a_gap, the_beginning_is_exact

FINITE = st.floats(-0.1, 0.1)
STRANGE = st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 1e200, 5e-324, -0.0, 2.0])
NUMBERS = st.integers(0, 9).flatmap(lambda chance: STRANGE if chance == 0 else FINITE)
THREE = st.tuples(NUMBERS, NUMBERS, NUMBERS)


def words(*kinds: str, most: int = 3) -> st.SearchStrategy[list[Word]]:
    """Draw words for `Person.word`."""
    return st.lists(st.tuples(st.sampled_from(kinds), st.integers(0, 300), st.floats(-1.0, 1.0)), max_size=most)


NOISE = ("garbage", "stranger", "heartbeat", "power", "hostile")
WORDS = words("next", "next", "next", "again", "flipped", "cut", "too long", "state", "welcome", "renewed", *NOISE)
LAST_WORDS = words("farewell", "refuse", "garbage", "cut", "stranger", "hostile", most=1)
REASONS = st.text(max_size=20)
GAPS = st.sampled_from([1] * 8 + [2, 8, 9, 50, 120, 2500])
LATER_NS = st.sampled_from([0, 2_000_000, 2_000_000, 90_000_000, 260_000_000, 1_500_000_000])
BEFORE = st.lists(st.tuples(LATER_NS, words(*NOISE)), max_size=3)
ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("tick"), GAPS, st.none() | st.tuples(THREE, THREE), WORDS),
        st.tuples(st.just("run"), st.integers(8, 150), st.booleans()),
        st.tuples(st.just("poll"), LATER_NS, WORDS | LAST_WORDS),
        st.tuples(st.sampled_from(["fail", "end"]), REASONS),
        st.tuples(st.sampled_from(["stop", "rearm", "keep_seat"])),
    ),
    min_size=4, max_size=25,
)  # fmt: skip
WORLDS: list[dict[str, dict[str, Any]]] = [
    {},
    {"coupling": {"decimator": "lowpass", "encoder": "velocity", "server_step": "paper"}},
    {"coupling": {"decimator": "none"}, "object": {"kind": "wall"}},
    *({"coupling": {"kind": scheme}, "object": {"kind": thing}} for scheme in SCHEMES for thing in objects_of(scheme)),
]
PEOPLE = st.builds(Person, st.integers(1, 3), st.booleans(), st.sampled_from(WORLDS))


def played(person: Person, before: Sequence[Any], last: Sequence[Any], actions: Sequence[Any]) -> None:
    core = person.core
    core.handle(Connect(), 0)
    for later_ns, words in before:
        person.poll(later_ns, words)
    person.poll(2_000_000, [*last, ("welcome", 0, 0.0)])
    for action in actions if core.seated else ():
        match action:
            case "tick", gap, sample, words:
                person.run_tick(gap, None if sample is None else person.sample(*sample), words)
            case "run", ticks, answered:
                person.run(ticks, answered)
            case "poll", later_ns, words:
                person.poll(later_ns, words)
            case "fail", reason:
                core.handle(DeviceFailed(reason), core.now_ns)
            case "keep_seat", *_:
                core.handle(KeepSeat(), person.now_ns)
            case "end", reason:
                person.end(reason)
            case "stop", *_:
                core.handle(Stop(), core.now_ns)
            case "rearm", *_:
                core.handle(Rearm(), core.now_ns)


@settings(max_examples=300)
@given(PEOPLE, BEFORE, LAST_WORDS, ACTIONS)
def test_whatever_happened_plays_again_exactly(
    person: Person, before: list[Any], last: list[Any], actions: list[Any]
) -> None:
    played(person, before, last, actions)
    person.exact()


def test_a_line_that_is_owed_energy_sends_nothing() -> None:
    person = Person(1, False, {"coupling": {"decimator": "none"}, "object": {"kind": "wall"}})
    silence = [("tick", 1, None, []), ("tick", 2500, None, [("renewed", 0, 0.0)])]
    played(person, [], [], [("run", 32, False), *silence, ("run", 8, False)])
    assert person.core.coupling.sent == (0.0,)
    person.exact()


@given(PEOPLE, ACTIONS, st.floats(0.0, 1.0))
def test_whatever_is_left_of_a_cut_recording_plays_exactly(person: Person, actions: list[Any], part: float) -> None:
    played(person, [], [], actions)
    length = round(part * len(person.noted))
    verdict = the_beginning_is_exact(person, length)
    assert verdict.ticks == person.ticks_in(person.noted[:length])


@pytest.mark.parametrize("step", [11, pytest.param(1, marks=pytest.mark.long)])
def test_every_beginning_of_a_recording_plays_exactly(step: int) -> None:
    for length in range(0, len(SCRIPT.noted), step):
        the_beginning_is_exact(SCRIPT, length)


@given(st.integers(0, 400))
def test_nothing_after_a_gap_is_judged_and_all_before_it_is(at: int) -> None:
    at = min(at, len(SCRIPT.noted))
    verdict = nothing_is_judged_after_a_gap(SCRIPT, at)
    assert verdict.ticks == SCRIPT.ticks_in(SCRIPT.noted[:at])


def test_a_scripted_session_has_everything() -> None:
    SCRIPT.exact()
    assert {KINDS[topic] for topic, *_ in SCRIPT.noted} == set(KINDS) - {"gap", "clock"}
    given = [msgspec.json.decode(payload, type=Input).kind for topic, _, payload in SCRIPT.noted if topic == INPUT]
    assert set(given) == {"connect", "poll", "keep_seat", "rearm", "device_failed", "stop", "close_ledger", "leave"}
    texts = [json.loads(payload)["text"] for topic, _, payload in SCRIPT.noted if topic == EVENT]
    states = [text.split(":")[0] for text in texts]
    assert states == ["live", "fault", "live", "fault", "degraded", "live", "fault", "idle"]
    assert all(one <= other for one, other in pairwise(time for _, time, _ in SCRIPT.noted))


def test_silences_play_again_exactly_and_no_secret_is_noted() -> None:
    """Back on the same line, then on a new one. Token and ticket stood in what was said, not in what was noted of it."""
    person = outages()
    person.exact()
    session = person.core.session
    assert (session.resumed, session.renewed) == (1, 1)
    ticks = [msgspec.json.decode(payload, type=Tick) for topic, _, payload in person.noted if topic == TICK]
    assert "degraded" in {tick.state for tick in ticks}
    datagrams = [
        msgspec.json.decode(payload, type=Datagram).data
        for topic, _, payload in person.noted
        if topic in (DATAGRAM_IN, DATAGRAM_OUT)
    ]
    noted = [*datagrams, *(payload for _, _, payload in person.noted), person.core.start.encode()]
    said = [session.hello, *person.said]
    for secret in (TOKEN.encode(), TICKET.encode()):
        assert any(secret in datagram for datagram in said)
        assert not any(secret in each for each in noted)
    received = [(messages.decode(datagram), len(datagram)) for datagram in datagrams]
    hellos = {(one.token, one.ticket, size) for one, size in received if isinstance(one, Hello)}
    assert hellos == {("", "", messages.HELLO_BYTES), ("", "-", messages.HELLO_BYTES)}
    assert [message.ticket for message, _ in received if isinstance(message, Welcome)] == ["-"] * 3


@given(st.integers(1, 3), st.floats(1e-9, 1e6), st.booleans())
def test_a_core_starts_from_what_the_header_says(axes: int, limit: float, gives_velocity: bool) -> None:
    person, record = Person(axes), replace(capability(axes, gives_velocity), slew_nps=limit, speed_mps=limit)
    hello, _ = start_of(person.core.start)
    assert start_of(RecordedClient(hello, record).start) == (hello, record)


def test_nothing_is_lost_before_it_is_known_where_it_goes() -> None:
    """A live client has a file only once it has a seat; its first hello is recorded all the same."""
    at_once, later = Person(), Person()
    later.core = RecordedClient(*start_of(at_once.core.start))
    for person in (at_once, later):
        person.take_seat()
    later.core.record(later.held)
    for person in (at_once, later):
        person.run(20)
    assert later.noted == at_once.noted
    assert msgspec.json.decode(later.noted[0][2], type=Input).kind == "connect"
