"""The session: its tables, its timers, and two ends that talk."""

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.settings.digest import digest
from cogrip.protocol.wire import messages, session
from cogrip.protocol.wire.accounts import LinkCount
from cogrip.protocol.wire.messages import (
    HELLO_BYTES,
    MAGIC,
    PROTOCOL_VERSION,
    Farewell,
    Heartbeat,
    Refuse,
    Stamp,
    Welcome,
)
from cogrip.protocol.wire.session import CLIENT, GIVE_UP_NS, HELLO_EVERY_NS, LEAVE_GIVE_UP_NS, LOST_NS, ClientSession
from cogrip.server.core import ServerCore
from cogrip.server.inputs import Kick, Stop

from tests.protocol.two_ends import MS, SETTINGS, answered, exchange, hello, seated, server, waves

said = [
    messages.encode(Refuse(1, 7, "full", "no")), messages.encode(Farewell(5, "stopped")),
    messages.encode(Heartbeat(5, Stamp(1))), waves(5), b"noise", messages.padded(hello()), b"welcome", b"renewed",
]  # fmt: skip
events = st.one_of(
    st.sampled_from(["connect", "poll", "leave"]), st.integers(1, 3_000).map(lambda ms: ms * MS), st.sampled_from(said)
)


class Watched(ClientSession):
    """Refuses a change of state that the table does not have."""

    def __setattr__(self, name: str, value: object) -> None:
        if name == "state" and hasattr(self, "state"):
            assert (self.state, value) in {(before, after) for (before, _), after in CLIENT.items()}
        super().__setattr__(name, value)


@given(st.lists(events, max_size=30))
def test_a_client_moves_along_its_table_and_nowhere_else(steps: list[str | int | bytes]) -> None:
    seat = server().rooms[0].seats[0].settings
    words = {
        b"welcome": messages.encode(Welcome(PROTOCOL_VERSION, 7, 5, "", "1", seat, "a-ticket")),
        b"renewed": messages.encode(Welcome(PROTOCOL_VERSION, 7, 6, "", "1", seat, "a-ticket")),
    }
    client, now_ns = Watched(hello()), 0
    for step in steps:
        before = client.state
        if step == "connect":
            client.connect(now_ns)
        elif step == "leave":
            client.leave("enough", None, now_ns)
        elif isinstance(step, bytes):
            client.receive(words.get(step, step), now_ns)
        elif isinstance(step, int):
            now_ns += step
        client.poll(now_ns)
        if client.state == "closed" != before and step != "leave" and before != "leaving":
            assert client.failed, "a session that ends badly says why"


def test_hellos_are_repeated_until_the_client_gives_up() -> None:
    client = ClientSession(hello())
    client.connect(0)
    for now_ns in range(0, GIVE_UP_NS, 10 * MS):
        client.poll(now_ns)
    assert (client.state, len(client.outbox)) == ("connecting", GIVE_UP_NS // HELLO_EVERY_NS)
    client.poll(GIVE_UP_NS - 1)
    assert client.state == "connecting"
    client.poll(GIVE_UP_NS)
    assert (client.state, client.failed) == ("closed", "no server answered within 3 s")


def test_what_came_before_the_newest_makes_nothing_stale_sooner() -> None:
    """A datagram has the time at which it came, which may lie before the first tick."""
    client, _ = seated()
    client.fresh_ns = 50 * MS
    assert client.welcome is not None
    client.receive(messages.encode(Heartbeat(client.welcome.session, Stamp(1))), 40 * MS)
    assert not client.stale(50 * MS + session.STALE_NS)
    client.mark_fresh(45 * MS)
    assert not client.stale(50 * MS + session.STALE_NS)
    assert client.stale(50 * MS + session.STALE_NS + 1)


def test_a_silent_server_without_a_ticket_is_given_up_and_staleness_comes_long_before() -> None:
    client, _ = seated(now_ns=5)
    client.poll(5 + LOST_NS)
    assert client.state == "seated"
    assert not client.stale(5 + session.STALE_NS)
    assert client.stale(5 + session.STALE_NS + 1)
    client.poll(5 + LOST_NS + 1)
    assert (client.state, client.failed) == ("closed", "the server has been silent for 2 s")


def test_a_silent_client_loses_its_seat() -> None:
    client, core = seated(now_ns=5)
    room = core.rooms[0]
    core.tick(room, 5 + LOST_NS)
    assert room.seats[0].state == "seated"
    core.tick(room, 5 + LOST_NS + 1)
    assert room.seats[0].state == "free"
    assert core.dropped == {"seat timed out": 1}
    core.outbox.clear()
    core.receive(waves(100), "anna's", 5 + LOST_NS + 2)
    assert core.dropped["not seated"] == 1
    assert client.welcome is not None


def test_goodbye_is_repeated_and_answered_every_time() -> None:
    client, core = seated()
    client.leave("done", None, 0)
    assert client.outbox, "said at once"
    lost = []
    for now_ns in range(0, LEAVE_GIVE_UP_NS, 10 * MS):
        client.poll(now_ns)
        lost += client.outbox
        client.outbox.clear()
    assert len(lost) == LEAVE_GIVE_UP_NS // session.LEAVE_EVERY_NS
    for number, datagram in enumerate(lost[:2]):
        core.receive(datagram, "anna's", number * session.LEAVE_EVERY_NS)
    assert core.outbox[0] == core.outbox[1]
    assert core.rooms[0].seats[0].state == "free"
    assert client.state == "leaving"
    client.receive(core.outbox[0][1], LEAVE_GIVE_UP_NS - 1)
    assert (client.state, client.failed) == ("closed", "")
    assert isinstance(client.farewell, Farewell)


@pytest.mark.parametrize(
    ("event", "failed", "ended"),
    [
        (Stop("maintenance"), "the server said goodbye: maintenance", ""),
        (Stop("the server was stopped (SIGTERM)"), "", "the server was stopped (SIGTERM)"),
        (
            Kick("anna", reason="the server was stopped"),
            "the server said goodbye: kicked by the administrator: the server was stopped",
            "",
        ),
    ],
    ids=["failure", "stopped on purpose", "a kick that talks of a stop"],
)
def test_a_client_that_is_sent_away_says_why(event: Stop | Kick, failed: str, ended: str) -> None:
    client, core = seated()
    core.handle(event, 1)
    exchange(client, core, 1)
    assert (client.state, client.failed, client.ended) == ("closed", failed, ended)


def test_a_lost_welcome_is_said_again_for_the_same_session() -> None:
    client, core = ClientSession(hello()), server()
    client.connect(0)
    core.receive(client.outbox.popleft(), "anna's", 0)
    core.outbox.clear()
    client.poll(HELLO_EVERY_NS)
    exchange(client, core, HELLO_EVERY_NS)
    assert client.welcome is not None
    assert client.welcome.session == 100
    assert [seat.state for seat in core.rooms[0].seats] == ["seated", "free"]


def test_nothing_foreign_reaches_the_coupling() -> None:
    client, _ = seated()
    refusals = [session.refusal(nonce, "full", "no") for nonce in (8, 7)]
    for datagram in (waves(101), b"\xc1", messages.padded(hello()), *refusals, waves(100)):
        client.receive(datagram, 1)
    assert client.dropped == {"other session": 1, "malformed": 1, "unexpected": 1, "other nonce": 1, "late answer": 1}
    assert client.receive(waves(100), 2) == messages.decode(waves(100))
    assert (client.state, client.last_received_ns) == ("seated", 2)


def both_print(client: ClientSession, core: ServerCore) -> str:
    """The reason that the client's failure and the server's event have in common."""
    [event] = core.events
    reason = event.text.partition(": ")[2]
    assert client.failed == f"the server refused: {reason}"
    assert client.state == "closed"
    return reason


@pytest.mark.parametrize(
    ("change", "code", "text"),
    [
        ({"version": 3}, "version", "the client speaks protocol 3, the server 8: install the same cogrip on both"),
        ({"room": "attic"}, "room", "there is no room 'attic' here; there is: lab"),
        ({"name": "eve"}, "name", "no seat is kept for 'eve'; seats are: anna, ben"),
        ({"digest": "0123"}, "settings", f"your settings (0123) are not the server's ({digest(SETTINGS)})"),
        ({"device_rate_hz": 1000.0}, "rate", "device sim:phantom runs at 1000 Hz at most, this room at"),
    ],
)
def test_a_refusal_has_a_reason_that_both_sides_print(change: dict[str, object], code: str, text: str) -> None:
    core = server()
    client = answered(hello(**change), core)
    reason = both_print(client, core)
    assert text in reason
    assert reason.endswith(f"[{code}]")
    assert core.dropped == {f"refused: {code}": 1}


def test_a_taken_seat_and_a_full_room_are_refused() -> None:
    _, core = seated()
    core.events.clear()
    second = answered(hello(nonce=8), core, 0, "ben's")
    assert "the seat of 'anna' is taken" in both_print(second, core)
    for nonce in (9, 10):
        core.events.clear()
        third = answered(hello("", nonce), core, 0, f"address {nonce}")
    assert "the room is full: all 2 seats are taken" in both_print(third, core)


@pytest.mark.parametrize(
    ("magic", "version", "refused"),
    [(MAGIC, PROTOCOL_VERSION + 1, True), (MAGIC, PROTOCOL_VERSION, False), ("gropic", PROTOCOL_VERSION + 1, False)],
)
def test_a_hello_with_another_layout_is_refused_by_its_fixed_part(magic: str, version: int, refused: bool) -> None:
    """Tag, magic, version, software and nonce have their places for ever; the rest may change with the version."""
    client, core = ClientSession(hello()), server()
    client.connect(0)
    client.outbox.clear()
    head = msgpack.packb([1, magic, version, "2.0", 7, {"new": 1}])
    padding = bytes(HELLO_BYTES - len(head) - 3)
    core.receive(b"\x97" + head[1:] + b"\xc5" + len(padding).to_bytes(2, "big") + padding, "anna's", 0)
    exchange(client, core, 0)
    if refused:
        assert both_print(client, core).startswith("the client speaks protocol 9, the server 8")
    else:
        assert core.dropped == {"malformed": 1}
        assert client.state == "connecting"


def test_short_hellos_get_no_answer() -> None:
    core = server()
    for datagram in (messages.encode(hello()), msgpack.packb([1, MAGIC, 9, "2.0", 7, {}]), b"\x91" * 1232, waves(100)):
        core.receive(datagram, "unknown", 0)
    assert not core.outbox
    assert core.dropped == {"short hello": 2, "malformed": 1, "not seated": 1}


@given(st.text(max_size=40), st.text(max_size=40))
def test_no_answer_is_longer_than_the_question_and_every_refusal_is_read(room: str, name: str) -> None:
    """Names may hold anything: a repr of them may be ten times as long."""
    client, core = ClientSession(hello(name=name, room=room)), server()
    client.connect(0)
    core.receive(client.outbox.popleft(), "unknown", 0)
    [(_, answer)] = core.outbox
    assert len(answer) <= HELLO_BYTES
    client.receive(answer, 0)
    assert client.state in ("seated", "closed")


def test_heartbeats_keep_their_pace() -> None:
    client, _ = seated()
    client.outbox.clear()
    start = HELLO_EVERY_NS
    for now_ns in range(start, start + 4 * session.HEARTBEAT_EVERY_NS, MS):
        client.heartbeat(now_ns)
    assert [type(messages.decode(datagram)) for datagram in client.outbox] == [Heartbeat] * 4


def test_a_left_seat_still_knows_its_count() -> None:
    client, core = seated()
    core.receive(waves(100), "anna's", 1)
    core.tick(core.rooms[0], 2)
    core.receive(messages.encode(messages.Leave(100, "done")), "anna's", 3)
    client.receive(core.outbox[-1][1], 4)
    assert client.farewell is not None
    assert client.farewell.seat is not None
    assert client.farewell.seat.up == LinkCount(sent=1, received=1, applied=1)
