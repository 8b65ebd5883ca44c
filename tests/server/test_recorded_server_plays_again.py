"""A recorded server plays again bit for bit, whoever came and whatever they said."""

import json
from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.recording.records import Datagram, Input
from cogrip.protocol.wire.session import LOST_NS
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.checkpoint import CheckpointError
from cogrip.server.inputs import CloseLedger, Idle, Restore, SocketFailed, Stop, decode
from cogrip.server.recorder import ACCOUNT, ANSWER, DATAGRAM_IN, DATAGRAM_OUT, EVENT, INPUT, RecordedServer, start_of

from tests.kinds import SCHEMES, object_of
from tests.recorded_end import nothing_is_judged_after_a_gap, the_beginning_is_exact
from tests.server.recorded_rooms import ADDRESSES, FRAME_NS, SCRIPT, STEP, TICKET, TOKEN, Server, a_room, scripted

HELLOS = ("hello", "hello", "another hello", "hello by name", "hello to a room")
REFUSED = ("other settings", "too few axes", "too slow", "newer", "short hello")
NOISE = ("again", "flipped", "cut", "garbage", "too long", "stranger", "heartbeat", "state", "power", "hostile")
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
    DURING
    | st.tuples(
        st.just("handle"), st.builds(Stop, st.text(max_size=20)) | st.builds(SocketFailed, st.text(max_size=20))
    )
    | st.just(("handle", CloseLedger()))
)
ACTIONS = st.builds(list.__add__, st.lists(DURING, min_size=3, max_size=20), st.lists(AT_THE_END, max_size=5))
COUPLINGS: list[dict[str, Any]] = [
    {"kind": "wave", "server_step": "paper", "encoder": "velocity", "decimator": "lowpass"},
    *({"kind": scheme} for scheme in SCHEMES),
]


@st.composite
def servers(draw: st.DrawFn) -> Server:
    coupling = draw(st.sampled_from(COUPLINGS))
    thing = {"kind": object_of(coupling["kind"]), "axes": draw(st.integers(1, 3))}
    tables = {"object": thing, "coupling": coupling}
    rooms = [a_room("lab", draw(st.sampled_from(["a", "ab", "abc"])), **tables)]
    if draw(st.booleans()):
        rooms.append(a_room("hall", "zy", **tables))
    server = Server(*rooms)
    server.hear(*[(who, "hello", 0, 0.0) for who in range(draw(st.integers(0, 4)))])
    return server


def played(server: Server, actions: Sequence[Any]) -> None:
    for action in actions:
        match action:
            case "hear", words:
                server.hear(*words)
            case "handle", given:
                server.handle(given)
                server.hear()
            case verb, *what:
                getattr(server, verb)(*what)


@settings(max_examples=300)
@given(servers(), ACTIONS)
def test_whatever_happened_plays_again_exactly(server: Server, actions: list[Any]) -> None:
    played(server, actions)
    server.exact()


@given(servers(), ACTIONS, st.floats(0.0, 1.0))
def test_whatever_is_left_of_a_cut_recording_plays_exactly(server: Server, actions: list[Any], part: float) -> None:
    played(server, actions)
    length = round(part * len(server.noted))
    verdict = the_beginning_is_exact(server, length)
    assert verdict.ticks >= server.ticks_in(server.noted[:length]) - 1, "the last may be waiting for its clock"


@given(st.integers(0, 400))
def test_nothing_after_a_gap_is_judged_and_all_before_it_is(at: int) -> None:
    nothing_is_judged_after_a_gap(SCRIPT, min(at, len(SCRIPT.noted)))


def test_a_deserted_room_writes_nothing_until_somebody_joins() -> None:
    server = Server(a_room("lab", "ab"), a_room("hall", "z"))
    server.run(50, ())
    assert server.noted == []
    resting_ns = server.now_ns
    server.tick(0, [(0, "hello", 0, 0.0)])
    inputs = [msgspec.json.decode(payload, type=Input) for topic, _, payload in server.noted[:2] if topic == INPUT]
    assert [each.kind for each in inputs] == ["idle", "idle"]
    assert [decode(each.value) for each in inputs] == [Idle("lab", 50), Idle("hall", 50)]
    assert [time_ns for _, time_ns, _ in server.noted[:2]] == [resting_ns, resting_ns]
    server.run(10, (0,))
    server.tick(0, later_ns=LOST_NS + 1)
    server.run(20, ())
    server.hear((1, "hello", 0, 0.0))
    server.exact()


def test_a_scripted_session_has_everything() -> None:
    SCRIPT.exact()
    assert {topic for topic, *_ in SCRIPT.noted} == {
        DATAGRAM_IN, DATAGRAM_OUT, INPUT, ANSWER, EVENT, ACCOUNT, STEP, STEP + 1,
    }  # fmt: skip
    events = " ".join(json.loads(payload)["text"] for topic, _, payload in SCRIPT.noted if topic == EVENT)
    for words in (
        "joined from", "[full]", "[version]", "left: bored", "silent for too long", "observes from", "[token]", "[device]",
        "resumed from", "kicked by the administrator: too rough", "an observer may not send waves", "token was revoked",
    ):  # fmt: skip
        assert words in events, words
    assert SCRIPT.core.dropped["malformed"] >= 1


def test_a_step_that_is_recorded_late_stands_where_it_would_stand_else() -> None:
    assert scripted(records_late=True).noted == SCRIPT.noted
    server = Server()
    server.records_late = True
    server.tick(0, [(0, "hello", 0, 0.0)])
    assert not server.places("step")
    for _ in range(2):
        server.core.finish_step()
        assert len(server.places("step")) == 1


def test_no_secret_stands_in_a_recording() -> None:
    """Only hashes of tickets and ids of tokens are recorded."""
    noted = b" ".join(payload for *_, payload in SCRIPT.noted)
    datagrams = b" ".join(
        msgspec.json.decode(SCRIPT.noted[at][2], type=Datagram).data
        for at in SCRIPT.places("datagram_in", "datagram_out")
    )
    for secret in (TICKET.encode(), TOKEN.encode()):
        assert secret not in noted
        assert secret not in datagrams
    assert b"hash" in datagrams


def test_a_restored_server_plays_again() -> None:
    before = Server()
    before.hear((0, "hello", 0, 0.0))
    before.run(40, (0,))
    after = Server()
    after.handle(Restore(before.core.rooms[0].checkpoint()))
    after.tickets = before.tickets
    after.hear((0, "comes back", 0, 0.0), (1, "hello", 0, 0.0))
    assert after.core.rooms[0].seats[0].state == "seated"
    after.run(40)
    after.handle(SocketFailed("Network is unreachable"))  # a part of the ledger at the end
    after.handle(CloseLedger())
    after.exact()


def test_a_server_that_refused_its_checkpoint_plays_again() -> None:
    """Settings were changed between the two: the server begins without the checkpoint, and so does its replay."""
    after = Server(a_room("lab", "xyz"))
    with pytest.raises(CheckpointError):
        after.handle(Restore(Server().core.rooms[0].checkpoint()))
    after.hear((0, "hello", 0, 0.0))
    after.run(20)
    after.handle(CloseLedger())
    after.exact()


def test_a_core_starts_from_what_the_header_says() -> None:
    rooms = [
        a_room("lab", "abc", object={"axes": 3, "kind": "cube"}),
        a_room("hall", "z", coupling={"kind": "coupling"}),
    ]
    assert start_of(RecordedServer(rooms, "a version", AdmissionServices(lambda: 1)).start) == (rooms, "a version")
