"""A recorded server plays again bit by bit, whoever came and whatever they said, and one altered field is found and named."""

import json
import math
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cogrip.protocol import messages
from cogrip.protocol.accounts import TickCount
from cogrip.protocol.line import LineSender
from cogrip.protocol.messages import Heartbeat, Hello, Leave, Stamp, State, Waves, Welcome
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.recording.records import Asked, Command, Datagram, Gap, Step
from cogrip.protocol.recording.sink import Held, encode
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.protocol.session import LOST_NS, make_hello
from cogrip.protocol.settings import Settings, resolve
from cogrip.server.recorded import (
    ACCOUNT,
    ASKED,
    COMMAND,
    DATAGRAM_IN,
    DATAGRAM_OUT,
    EVENT,
    KINDS,
    RecordedServer,
    server_topics,
    start_of,
)
from cogrip.sim.replay.verify import Verdict, verify

FRAME_NS = 1_000_000_000 // 128
GAP, STEP = KINDS.index("gap"), len(KINDS)
ADDRESSES = [("127.0.0.1", 4001), ("127.0.0.1", 4002), ("::1", 4003, 0, 0), "person 3", ("10.0.0.7", 65535)]
Put = tuple[int, int, bytes]  # topic, time, payload
Word = tuple[int, str, int, float]  # who, what, which of that kind, how large


def a_room(name: str = "lab", people: str = "ab", **tables: object) -> Settings:
    return resolve({"name": name, "users": [{"name": person} for person in people], **tables})


def flipped(datagram: bytes, place: int, bits: int) -> bytes:
    """One byte of it changed."""
    data = bytearray(datagram or b"x")
    data[place % len(data)] ^= bits
    return bytes(data)


def steps_in(noted: Sequence[Put]) -> int:
    """Steps that were noted one by one, and those of rooms at rest."""
    commands = [msgspec.json.decode(payload, type=Command) for topic, _, payload in noted if topic == COMMAND]
    return sum(topic >= STEP for topic, *_ in noted) + sum(command.count for command in commands)


class Live:
    """A recorded core called as the live loop calls it, and people of all kinds who talk to it."""

    def __init__(self, *rooms: Settings) -> None:
        self.rooms = rooms or (a_room(),)
        self.topics = server_topics([room.name for room in self.rooms])
        sessions, asked = count(2**63 - 1000), count(1)
        self.core = RecordedServer(self.rooms, "test", lambda: next(sessions))
        self.held = Held()
        self.core.record(self.held)
        for room in self.core.rooms:  # the pacer of a live loop tells more every time
            self.core.count_ticks(room, lambda: TickCount(due=(number := next(asked)), run=number))
        self.now_ns = 1_000_000_000
        self.lines = [LineSender(self.rooms[0].object.axes, 4) for _ in ADDRESSES]
        self.session = [1 for _ in ADDRESSES]
        self.said: list[bytes] = [b""]

    @property
    def noted(self) -> list[Put]:
        return self.held.messages

    def hello(self, who: int, **changed: object) -> bytes:
        given: dict[str, object] = {
            "software": "test", "nonce": who + 1, "room": "", "name": "", "digest": "", "device": "sim:ideal", "axes": 3,
            "rate_hz": 1024.0,
        }  # fmt: skip
        return messages.padded(make_hello(**{**given, **changed}))  # type: ignore[arg-type]

    def frame(self, who: int, value: float) -> bytes:
        """The next frame of this person's line up."""
        line, axes, row = self.lines[who], self.rooms[0].object.axes, (0.01 * value,) * self.rooms[0].object.axes
        line.push((value,) * axes)
        first, waves, total, squares = line.contents()
        stamp, state = Stamp(self.now_ns - 1, self.now_ns - 9_000_000, 2_000_000), row + row
        if self.rooms[0].coupling.kind == "coupling":
            return messages.encode(State(self.session[who], line.next_number - 1, row, row, 0.0, 0, stamp))
        return messages.encode(Waves(self.session[who], first, waves, total, squares, 0.0, 0.0, 0, stamp, state))

    def word(self, who: int, kind: str, number: int, value: float) -> bytes:
        """A datagram as it may arrive; `number` tells which of that kind."""
        axes, session, said = self.rooms[0].object.axes, self.session[who], self.said[number % len(self.said)]
        stamp, row = Stamp(number * 1000), (value,) * axes
        names = [user.name for room in self.rooms for user in room.users]
        raw: dict[str, Callable[[], bytes]] = {
            "next": lambda: self.frame(who, value),
            "again": lambda: said,
            "flipped": lambda: flipped(said, number, 1 << number % 8),
            "cut": lambda: said[: number % 60],
            "garbage": lambda: number.to_bytes(8, "big") * (number % 20),
            "too long": lambda: bytes(2000),
            "hello": lambda: self.hello(who),
            "another hello": lambda: self.hello(who, nonce=number),
            "hello by name": lambda: self.hello(who, name=[*names, "nobody"][number % (len(names) + 1)]),
            "hello to a room": lambda: self.hello(
                who, room=[*(room.name for room in self.rooms), "attic"][number % 3 % 2]
            ),
            "other settings": lambda: self.hello(who, digest="other"),
            "too few axes": lambda: self.hello(who, axes=1),
            "too slow": lambda: self.hello(who, rate_hz=100.0),
            "newer": lambda: self.hello(who).replace(b"cogrip\x01", b"cogrip\x63", 1),
            "short hello": lambda: self.hello(who)[:-1],
        }
        largest, total, squares = tuple(1e4 * each for each in row), tuple(1e15 * each for each in row), (1e15,) * axes
        made = {
            "stranger": Heartbeat(session % 1000 + 1 + number, stamp),
            "heartbeat": Heartbeat(session, stamp),
            "state": State(session, number, row, row, value, 0, stamp),
            "hostile": Waves(session, number, largest, total, squares, 0.0, 0.0, number, stamp, row + row),
            "leave": Leave(session, "bored"),
        }
        datagram = raw[kind]() if kind in raw else messages.encode(made[kind])
        self.said.append(datagram)
        return datagram

    def hear(self, *words: Word) -> None:
        for word in words:
            self.core.receive(self.word(*word), ADDRESSES[word[0]], self.now_ns)
        for address, datagram in self.core.outbox:
            with suppress(messages.MalformedError):  # of a room that went wild
                answer = messages.decode(datagram)
                if isinstance(answer, Welcome):
                    self._welcomed(ADDRESSES.index(address), answer.session)  # type: ignore[arg-type]
        self.core.outbox.clear()

    def _welcomed(self, who: int, session: int) -> None:
        if self.session[who] != session:
            self.session[who] = session
            self.lines[who] = LineSender(self.rooms[0].object.axes, 4)

    def tick(self, number: int, words: Sequence[Word] = (), frames: int = 1, later_ns: int = FRAME_NS) -> None:
        """What came is heard, then a room is stepped."""
        self.now_ns += later_ns
        self.hear(*words)
        room = self.core.rooms[number % len(self.core.rooms)]
        self.core.timing[room.name] = (number, frames * 10, frames - 1)
        self.core.tick(room, self.now_ns, frames)
        self.core.events.clear()
        self.hear()

    def run(self, ticks: int, who: Sequence[int] = (0, 1)) -> None:
        """Some people swing, all rooms are stepped."""
        for step in range(ticks):
            words = [(each, "next", 0, 0.3 * math.sin(0.1 * step + each)) for each in who]
            for number in range(len(self.rooms)):
                self.tick(number, [] if number else words, later_ns=0 if number else FRAME_NS)

    def verdict(self, noted: Sequence[Put] | None = None, closed: bool = True) -> Verdict:
        """Write `noted` (else all that was noted) to a file, and verify that."""
        header = Header("server", "server", self.core.start, 128, 1, 5, True, versions_here(), self.topics)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "server.mcap"
            with path.open("wb") as file:
                writer = RecordingWriter(file, header)
                for message in self.noted if noted is None else noted:
                    writer.put(*message)
                if closed:
                    writer.finish()
                else:
                    writer.flush()
            return verify(open_recording(path))

    def exact(self) -> None:
        verdict = self.verdict()
        assert verdict.exact, verdict.difference
        assert verdict.messages == len(self.noted)
        assert verdict.ticks == steps_in(self.noted)
        assert not verdict.cut


HELLOS = ("hello", "hello", "another hello", "hello by name", "hello to a room")
REFUSED = ("other settings", "too few axes", "too slow", "newer", "short hello")
NOISE = ("again", "flipped", "cut", "garbage", "too long", "stranger", "heartbeat", "state", "hostile")
WORDS = st.lists(
    st.tuples(
        st.integers(0, len(ADDRESSES) - 1),
        st.sampled_from([*HELLOS, *REFUSED, *NOISE, "next", "next", "next", "next", "leave"]),
        st.integers(0, 300),
        st.floats(-1.0, 1.0),
    ),
    max_size=4,
)
LATER_NS = st.sampled_from([0, FRAME_NS, FRAME_NS, 100_000_000, LOST_NS + 1])
DURING = st.one_of(
    st.tuples(st.just("hear"), WORDS),
    st.tuples(st.just("tick"), st.integers(0, 1), WORDS, st.sampled_from([1, 1, 1, 2, 9]), LATER_NS),
    st.tuples(st.just("run"), st.integers(1, 30), st.lists(st.integers(0, 4), max_size=3, unique=True)),
)
AT_THE_END = (
    DURING | st.tuples(st.sampled_from(["stop", "socket_failed"]), st.text(max_size=20)) | st.just(("close_books",))
)
ACTIONS = st.builds(list.__add__, st.lists(DURING, min_size=3, max_size=20), st.lists(AT_THE_END, max_size=5))
COUPLINGS: list[dict[str, Any]] = [
    {}, {"server_step": "paper", "encoder": "velocity", "decimator": "lowpass"}, {"kind": "coupling"},
]  # fmt: skip


@st.composite
def lives(draw: st.DrawFn) -> Live:
    tables = {"object": {"axes": draw(st.integers(1, 3))}, "coupling": draw(st.sampled_from(COUPLINGS))}
    rooms = [a_room("lab", draw(st.sampled_from(["a", "ab", "abc"])), **tables)]
    if draw(st.booleans()):
        rooms.append(a_room("hall", "zy", **tables))
    live = Live(*rooms)
    live.hear(*[(who, "hello", 0, 0.0) for who in range(draw(st.integers(0, 4)))])
    return live


def played(live: Live, actions: Sequence[Any]) -> None:
    for action in actions:
        match action:
            case "hear", words:
                live.hear(*words)
            case "close_books", *_:
                live.core.close_books()
            case "socket_failed", reason:
                live.core.socket_failed(reason)
            case "stop", reason:
                live.core.stop(reason)
                live.hear()
            case verb, *what:
                getattr(live, verb)(*what)


@settings(max_examples=300)
@given(lives(), ACTIONS)
def test_whatever_happened_plays_again_exactly(live: Live, actions: list[Any]) -> None:
    played(live, actions)
    live.exact()


@given(lives(), ACTIONS, st.floats(0.0, 1.0))
def test_whatever_is_left_of_a_cut_recording_plays_exactly(live: Live, actions: list[Any], part: float) -> None:
    """A chunk may end between any two messages: between what a step sent and the step itself, too."""
    played(live, actions)
    left = live.noted[: round(part * len(live.noted))]
    verdict = live.verdict(left, closed=False)
    assert verdict.difference is None
    assert verdict.exact
    assert verdict.cut
    assert verdict.ticks >= steps_in(left) - 1, "the last may be waiting for its clock"


def test_a_room_where_nobody_sits_writes_nothing_until_somebody_comes() -> None:
    live = Live(a_room("lab", "ab"), a_room("hall", "z"))
    live.run(50, ())
    assert live.noted == []
    resting_ns = live.now_ns
    live.tick(0, [(0, "hello", 0, 0.0)])
    rests = [msgspec.json.decode(payload, type=Command) for topic, _, payload in live.noted[:2] if topic == COMMAND]
    assert rests == [Command("rest", "lab", 50), Command("rest", "hall", 50)]
    assert [time_ns for _, time_ns, _ in live.noted[:2]] == [resting_ns, resting_ns]
    live.run(10, (0,))
    live.tick(0, later_ns=LOST_NS + 1)
    live.run(20, ())
    live.hear((1, "hello", 0, 0.0))
    live.exact()


def scripted() -> Live:
    """Every kind of message and every command, in two rooms."""
    live = Live(a_room("lab", "ab", object={"axes": 2}), a_room("hall", "z", object={"axes": 2}))
    live.hear((0, "hello", 0, 0.0), (1, "hello", 0, 0.0), (1, "hello", 0, 0.0), (4, "newer", 0, 0.0))
    live.hear((2, "hello by name", 2, 0.0), (3, "hello", 0, 0.0), (4, "garbage", 7, 0.0))
    live.run(40, (0, 1, 2))
    live.tick(0, [(0, "again", 3, 0.0)], frames=3)
    live.run(10, (0,))
    live.hear((0, "leave", 0, 0.0), (0, "leave", 0, 0.0))
    live.tick(1, later_ns=LOST_NS + 1)
    live.hear((4, "hello by name", 0, 0.0))
    live.run(10, (1, 4))
    live.core.stop("the time is over")
    live.hear((4, "leave", 0, 0.0))
    live.core.close_books()
    return live


SCRIPT = scripted()
OUTPUTS = [at for at, (topic, *_) in enumerate(SCRIPT.noted) if topic in (DATAGRAM_OUT, EVENT, ACCOUNT)]
STEPS = [at for at, (topic, *_) in enumerate(SCRIPT.noted) if topic >= STEP]


def test_a_scripted_session_has_everything() -> None:
    SCRIPT.exact()
    assert {topic for topic, *_ in SCRIPT.noted} == {
        DATAGRAM_IN, DATAGRAM_OUT, COMMAND, ASKED, EVENT, ACCOUNT, STEP, STEP + 1,
    }  # fmt: skip
    events = " ".join(json.loads(payload)["text"] for topic, _, payload in SCRIPT.noted if topic == EVENT)
    for words in ("joined from", "[full]", "[version]", "left: bored", "silent for too long"):
        assert words in events
    assert SCRIPT.core.dropped["malformed"] >= 1


def altered(at: int, payload: bytes, time_ns: int | None = None) -> Verdict:
    topic, now_ns, _ = SCRIPT.noted[at]
    new = (topic, now_ns if time_ns is None else time_ns, payload)
    return SCRIPT.verdict([*SCRIPT.noted[:at], new, *SCRIPT.noted[at + 1 :]])


STEP_FIELDS = st.sampled_from(["object_m[0]", "object_m[1]", "object_mps[0]"])
SEAT_FIELDS = st.sampled_from(
    ["proxy_m[0]", "proxy_m[1]", "force_n[1]", "up_margin_j", "line_margin_j", "up_used_j", "down_made_j"]
)


@given(st.sampled_from(STEPS), STEP_FIELDS | st.builds("seats[{}].{}".format, st.integers(0, 1), SEAT_FIELDS))
def test_the_last_bit_of_any_number_of_a_step_is_found(at: int, where: str) -> None:
    topic, time_ns, payload = SCRIPT.noted[at]
    table = json.loads(payload)
    path: list[str | int] = [
        int(key) if key.isdigit() else key for key in where.replace("]", "").replace("[", ".").split(".")
    ]
    assume(path[0] != "seats" or int(path[1]) < len(table["seats"]))
    holder = table
    for key in path[:-1]:
        holder = holder[key]
    old = holder[path[-1]]
    assume(old is not None)
    holder[path[-1]] = new = math.nextafter(old, math.inf)
    verdict = altered(at, encode(table))
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
    found = altered(at, encode(table)).difference
    assert found is not None
    assert (found.time_ns, found.field, found.recorded) == (SCRIPT.noted[at][1], where, json.dumps(value))


@given(
    st.sampled_from([at for at in OUTPUTS if SCRIPT.noted[at][0] == DATAGRAM_OUT]),
    st.integers(0, 2**20),
    st.integers(1, 255),
)
def test_any_bit_of_a_datagram_that_was_sent_is_found(at: int, place: int, bits: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    sent = msgspec.json.decode(payload, type=Datagram)
    new = encode(Datagram(flipped(sent.data, place, bits), sent.address))
    found = altered(at, new).difference
    assert found is not None
    assert (found.time_ns, found.topic, found.field) == (time_ns, "/server/datagram_out", "data")
    assert (json.loads(found.recorded), json.loads(found.replayed)) == (
        json.loads(new)["data"],
        json.loads(payload)["data"],
    )


def test_to_whom_a_datagram_was_sent_is_compared() -> None:
    at = next(at for at in OUTPUTS if SCRIPT.noted[at][0] == DATAGRAM_OUT)
    sent = msgspec.json.decode(SCRIPT.noted[at][2], type=Datagram)
    found = altered(at, encode(Datagram(sent.data, '["127.0.0.1",4009]'))).difference
    assert found is not None
    assert (found.field, found.recorded, found.replayed) == (
        "address",
        json.dumps('["127.0.0.1",4009]'),
        json.dumps('["127.0.0.1",4001]'),
    )


@pytest.mark.parametrize(("topic", "field"), [(EVENT, "text"), (ACCOUNT, "account")])
def test_events_and_accounts_are_compared(topic: int, field: str) -> None:
    for at in [at for at in OUTPUTS if SCRIPT.noted[at][0] == topic]:
        _, time_ns, payload = SCRIPT.noted[at]
        before = json.loads(payload)[field]
        found = altered(at, encode({field: before + " "})).difference
        assert found is not None
        assert (found.time_ns, found.topic, found.field) == (time_ns, SCRIPT.topics[topic], field)
        assert (json.loads(found.recorded), json.loads(found.replayed)) == (before + " ", before)


@given(st.sampled_from(OUTPUTS), st.sampled_from([-1, 1, 1000]))
def test_the_time_of_any_output_is_compared(at: int, later_ns: int) -> None:
    topic, time_ns, payload = SCRIPT.noted[at]
    found = altered(at, payload, time_ns + later_ns).difference
    assert found is not None
    assert (found.field, found.recorded, found.replayed) == ("time_ns", str(time_ns + later_ns), str(time_ns))
    assert found.topic == SCRIPT.topics[topic]


def _first(topic: int, record: type[Any], holds: Callable[[Any], bool]) -> tuple[int, Any]:
    for at, (each, _, payload) in enumerate(SCRIPT.noted):
        if each == topic and holds(one := msgspec.json.decode(payload, type=record)):
            return at, one
    raise LookupError


TICKS = encode(TickCount(9, 9)).decode()


@pytest.mark.parametrize(
    ("topic", "record", "holds", "change", "found_in", "field"),
    [
        (ASKED, Asked, lambda asked: asked.session, {"session": 5}, DATAGRAM_OUT, "data"),
        (ASKED, Asked, lambda asked: asked.ticks, {"ticks": TICKS}, DATAGRAM_OUT, "data"),
        (ASKED, Asked, lambda asked: asked.ticks, {"room": "hall"}, ASKED, "room"),
        (COMMAND, Command, lambda command: command.verb == "stop", {"reason": "enough"}, DATAGRAM_OUT, "data"),
        (STEP, Step, lambda step: step.frames == 3, {"frames": 1}, DATAGRAM_OUT, "data"),
        (DATAGRAM_IN, Datagram, lambda heard: True, {"address": '["127.0.0.1",4444]'}, EVENT, "text"),
    ],
    ids=["a session's number", "the loop's ticks", "whose ticks", "why it stops", "frames of a step", "who said it"],
)  # fmt: skip
def test_another_input_is_found_by_what_comes_of_it(
    topic: int, record: type[Any], holds: Callable[[Any], bool], change: dict[str, Any], found_in: int, field: str
) -> None:
    at, old = _first(topic, record, holds)
    found = altered(at, encode(msgspec.structs.replace(old, **change))).difference
    assert found is not None
    assert (found.topic, found.field) == (SCRIPT.topics[found_in], field)
    now_ns = SCRIPT.noted[at][1]
    assert found.time_ns == min(
        time_ns for topic, time_ns, _ in SCRIPT.noted if topic == found_in and time_ns >= now_ns
    )
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
    verdict = altered(at, encode(other))
    found = verdict.difference
    assert found is not None
    assert found.time_ns == SCRIPT.noted[at][1], "in the same step"
    assert found.topic in ("/server/datagram_out", "/room/lab/step")
    assert at < verdict.messages < at + 8


@given(st.sampled_from([at for at, (topic, *_) in enumerate(SCRIPT.noted) if topic not in (DATAGRAM_IN, COMMAND)]))
def test_a_message_that_is_left_out_is_found(at: int) -> None:
    time_ns = SCRIPT.noted[at][1]
    verdict = SCRIPT.verdict([*SCRIPT.noted[:at], *SCRIPT.noted[at + 1 :]])
    assert verdict.difference is not None
    assert verdict.difference.time_ns >= time_ns
    assert verdict.messages >= sum(each < time_ns for _, each, _ in SCRIPT.noted), "all before it is the same"


@given(st.integers(0, len(SCRIPT.noted) - 2))
def test_two_messages_that_changed_places_are_found(at: int) -> None:
    one, other = SCRIPT.noted[at : at + 2]
    assume({one[0], other[0]} & {DATAGRAM_OUT, EVENT, ACCOUNT, ASKED})  # of two inputs either order is one that may be
    assume(one != other)
    verdict = SCRIPT.verdict([*SCRIPT.noted[:at], other, one, *SCRIPT.noted[at + 2 :]])
    assert verdict.difference is not None
    assert verdict.difference.time_ns >= one[1]


@given(st.integers(0, 400))
def test_nothing_after_a_gap_is_judged_and_all_before_it_is(at: int) -> None:
    at = min(at, len(SCRIPT.noted) - 1)
    gap = (GAP, SCRIPT.noted[at][1], encode(Gap(3, "the ring was full")))
    verdict = SCRIPT.verdict([*SCRIPT.noted[:at], gap, *SCRIPT.noted[at + 3 :]])
    assert verdict.difference is None
    assert verdict.hole == Gap(3, "the ring was full")
    assert verdict.hole_ns == gap[1]
    assert not verdict.exact
    assert not verdict.cut, "the file was closed"


def is_judged_or_refused(at: int, payload: bytes) -> None:
    refused, verdict = "", None
    try:
        verdict = altered(at, payload)
    except RecordingError as error:
        refused = str(error)
    assert "server.mcap cannot be replayed" in refused if verdict is None else not verdict.exact


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"{}", b"[]", b"null", b'{"verb":"fly"}', b'{"verb":"rest","reason":"attic","count":3}', b'{"step":1}',
        b'{"data":"?"}', b'{"ticks":"?"}',
    ],
)  # fmt: skip
def test_what_is_no_message_gives_a_verdict_or_a_refusal_in_words(payload: bytes) -> None:
    topics = [topic for topic, *_ in SCRIPT.noted]
    for topic in set(topics):
        is_judged_or_refused(topics.index(topic), payload)


@given(st.integers(0, len(SCRIPT.noted) - 1), st.binary(max_size=40))
def test_any_bytes_give_a_verdict_or_a_refusal_in_words(at: int, payload: bytes) -> None:
    is_judged_or_refused(at, payload)


@pytest.mark.parametrize(
    "start", ["", "{", "[]", "{}", '{"rooms": 3, "software": ""}', '{"rooms": [{"name": ""}], "software": ""}']
)
def test_a_start_that_is_none_is_refused_in_words(start: str) -> None:
    live = Live()
    live.core.start = start
    with pytest.raises(RecordingError, match=r"server.mcap cannot be replayed"):
        live.verdict()


def test_a_core_starts_from_what_the_header_says() -> None:
    rooms = [
        a_room("lab", "abc", object={"axes": 3, "kind": "cube"}),
        a_room("hall", "z", coupling={"kind": "coupling"}),
    ]
    assert start_of(RecordedServer(rooms, "a version", lambda: 1).start) == (rooms, "a version")


def test_what_the_socket_refused_is_an_input_too() -> None:
    """It stands in the books that are closed at the end."""
    live = Live()
    live.hear((0, "hello", 0, 0.0))
    live.run(5, (0,))
    live.core.socket_failed("Network is unreachable")
    live.core.close_books()
    live.exact()


def test_a_hello_is_what_it_should_be() -> None:
    """The words above are what they are called."""
    live = Live()
    assert isinstance(messages.decode(live.word(0, "hello", 0, 0.0)), Hello)
    assert messages.foreign_version(live.word(0, "newer", 0, 0.0)) == 0x63
