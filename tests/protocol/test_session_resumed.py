"""Resumption of a session whose server fell silent, and sessions of observers."""

import msgspec
import pytest

from cogrip.protocol.wire import messages, session
from cogrip.protocol.wire.messages import HELLO_BYTES, Leave, Stamp, View, Waves, Welcome
from cogrip.protocol.wire.session import HELLO_EVERY_NS, LOST_NS, QUIET_NS, ClientSession
from cogrip.server.core import ServerCore
from cogrip.server.inputs import Kick, Restart, Restore

from tests.protocol.two_ends import MS, answered, exchange, hello, seated, server, waves


def said(client: ClientSession) -> list[messages.AnyMessage]:
    found = [messages.decode(datagram) for datagram in client.outbox]
    client.outbox.clear()
    return found


def quiet(now_ns: int = 5) -> tuple[ClientSession, ServerCore]:
    """Return a client that has just noticed that its server is silent."""
    client, core = seated(now_ns, tickets=True)
    client.outbox.clear()
    client.poll(now_ns + QUIET_NS)
    assert client.state == "resuming"
    return client, core


def test_half_a_second_of_silence_makes_a_client_ask_for_its_seat_again() -> None:
    client, _ = seated(now_ns=5, tickets=True)
    client.outbox.clear()
    client.poll(5 + QUIET_NS - 1)
    assert (client.state, list(client.outbox)) == ("seated", [])
    client.poll(5 + QUIET_NS)
    assert client.state == "resuming"
    [asked] = said(client)
    assert asked == msgspec.structs.replace(hello(ticket="ticket-1"), padding=asked.padding)
    client.poll(5 + QUIET_NS + HELLO_EVERY_NS - 1)
    assert not client.outbox
    client.poll(5 + QUIET_NS + HELLO_EVERY_NS)
    assert len(client.outbox) == 1
    assert len(client.outbox[0]) == HELLO_BYTES
    client.heartbeat(5 + QUIET_NS + session.HEARTBEAT_EVERY_NS)
    assert len(client.outbox) == 1, "nothing but hellos goes out meanwhile"


def restarting(wait_ms: int) -> tuple[ClientSession, ServerCore]:
    """Return a client whose server has just said, at 5 ns, that it restarts."""
    client, core = seated(now_ns=5, tickets=True)
    core.handle(Restart(wait_ms), 5)
    for _, datagram in list(core.outbox):
        client.receive(datagram, 5)
    return client, core


def test_a_server_that_restarts_lets_its_people_go_at_once_and_keeps_their_seats() -> None:
    client, core = seated(now_ns=5, tickets=True)
    client.outbox.clear()
    core.outbox.clear()
    for now_ns in (6, 7, 8):  # a datagram may be lost: it is repeated
        core.handle(Restart(30_000), now_ns)
        for _, datagram in core.outbox:
            client.receive(datagram, now_ns)
        core.outbox.clear()
    assert (client.state, client.restarting, client.failed) == ("resuming", True, "")
    assert client.last_received_ns == 6
    assert [each.seats[0].ticket for each in core.checkpoint()] != [""]
    client.poll(9)
    [asked] = said(client)
    assert asked == msgspec.structs.replace(hello(ticket="ticket-1"), padding=asked.padding)
    assert client.welcome is not None
    for late in (waves(client.welcome.session), messages.Heartbeat(client.welcome.session, Stamp(1, 0, 0))):
        client.receive(late if isinstance(late, bytes) else messages.encode(late), 10)
        assert client.state == "resuming", "sent by the server that ends"
    assert client.dropped["before the restart"] == 2 + 2
    after = server(tickets=True, first_session=200)
    after.handle(Restore(core.checkpoint()[0]), 11)
    after.receive(messages.encode(asked), ("a", 2), 12)
    for _, datagram in after.outbox:
        client.receive(datagram, 12)
    assert (client.state, client.restarting, client.renewed) == ("seated", False, 1)


@pytest.mark.parametrize(("wait_ms", "own_ns", "end_ns"), [
    (0, 10_000 * MS, 10_000 * MS), (9_000, 10_000 * MS, 10_000 * MS), (45_000, 10_000 * MS, 45_000 * MS),
    (5_000, 20_000 * MS, 20_000 * MS), (messages.MOST_WAIT_MS, 10_000 * MS, messages.MOST_WAIT_MS * MS),
])  # fmt: skip
def test_a_client_waits_as_long_as_the_server_or_the_person_asks_for(wait_ms: int, own_ns: int, end_ns: int) -> None:
    client, _ = restarting(wait_ms)
    client.give_up_ns = own_ns
    client.poll(5 + end_ns - 1)
    assert client.state == "resuming"
    client.poll(5 + end_ns)
    assert (client.state, client.failed) == ("closed", f"no server for {end_ns / 1e9:.0f} s")


def test_without_a_ticket_nothing_is_waited_for() -> None:
    client, core = seated(now_ns=5, tickets=False)
    core.handle(Restart(30_000), 5)
    for _, datagram in list(core.outbox):
        client.receive(datagram, 5)
    assert (client.state, client.restarting) == ("seated", False)


@pytest.mark.parametrize(
    ("handshakes_ns", "end_ns", "failed"),
    [
        ((), 5 + session.RESUME_GIVE_UP_NS, "no server for 10 s"),
        ((5 + 3000 * MS,), 5 + 3000 * MS + session.RESUME_GIVE_UP_NS, "no server for 13 s"),
        ((9000 * MS, 18000 * MS, 27000 * MS), 5 + session.RESUME_MOST_NS, "no server for 30 s"),
    ],
)
def test_a_client_gives_up_ten_seconds_after_the_last_handshake(
    handshakes_ns: tuple[int, ...], end_ns: int, failed: str
) -> None:
    client, _ = quiet()
    for now_ns in sorted([*handshakes_ns, *range(5 + QUIET_NS, end_ns, 50 * MS), end_ns - 1]):
        client.poll(now_ns)
        assert client.state == "resuming"
        if now_ns in handshakes_ns:
            client.reached(now_ns)
    client.poll(end_ns)
    assert (client.state, client.failed) == ("closed", failed)


def test_the_old_path_may_come_back_by_itself() -> None:
    client, _ = quiet()
    message = client.receive(waves(100), 5 + 800 * MS)
    assert isinstance(message, Waves)
    assert (client.state, client.silence_ns, client.resumed, client.renewed) == ("seated", 800 * MS, 1, 0)
    assert client.last_received_ns == 5 + 800 * MS


def test_another_address_takes_the_seat_along() -> None:
    client, core = quiet()
    exchange(client, core, 5 + QUIET_NS, "another address")
    seat = core.rooms[0].seats[0]
    assert (client.state, client.resumed, client.renewed) == ("seated", 1, 0)
    assert (seat.state, seat.session, seat.address) == ("seated", 100, "another address")
    core.receive(waves(100), "anna's", 6 + QUIET_NS)
    assert core.dropped == {"not seated": 1}, "the address that was left"


def test_a_hello_that_was_overtaken_takes_no_seat_back() -> None:
    """Sockets and processes that stood still may bring the older hello last."""
    client, core = quiet()
    [asked] = client.outbox
    exchange(client, core, 5 + QUIET_NS + HELLO_EVERY_NS, "another address")
    core.receive(asked, "anna's", 5 + QUIET_NS)
    seat = core.rooms[0].seats[0]
    assert (seat.address, seat.last_received_ns) == ("another address", 5 + QUIET_NS + HELLO_EVERY_NS)
    assert core.dropped == {"old hello": 1}
    assert not core.outbox
    core.receive(asked, "anna's", 5 + QUIET_NS + HELLO_EVERY_NS)
    assert seat.address == "anna's"


def test_a_server_that_was_started_anew_gives_another_session() -> None:
    client, core = quiet()
    again = server(tickets=True, first_session=777)
    again.handle(Restore(core.checkpoint()[0]), 5)
    exchange(client, again, 5 + QUIET_NS, "anna's")
    assert client.welcome is not None
    assert (client.state, client.welcome.session, client.resumed, client.renewed) == ("seated", 777, 0, 1)
    client.receive(waves(100), 6 + QUIET_NS)
    assert client.dropped == {"other session": 1}


def test_a_seat_that_timed_out_is_had_again_by_its_ticket() -> None:
    client, core = quiet()
    core.tick(core.rooms[0], 5 + LOST_NS + 1)
    assert core.rooms[0].seats[0].state == "free"
    core.outbox.clear()
    client.outbox.clear()
    client.poll(6 + LOST_NS)
    exchange(client, core, 6 + LOST_NS, "another address")
    assert (client.state, client.renewed) == ("seated", 1)
    assert core.rooms[0].seats[0].state == "seated"


def test_one_who_was_kicked_does_not_come_back() -> None:
    client, core = quiet()
    core.handle(Kick("anna"), 5)
    core.outbox.clear()
    answered(hello(nonce=8), core, 6, "another's")
    exchange(client, core, 5 + QUIET_NS, "another address")
    assert client.state == "closed"
    assert "the seat of 'anna' is taken" in client.failed


@pytest.mark.parametrize("other", [{"user": "ben"}, {"seat": 1}, {"rendered_npm": 5.0}])
def test_another_seat_is_not_accepted(other: dict[str, object]) -> None:
    client, _ = quiet()
    client.outbox.clear()
    assert client.welcome is not None
    settings = msgspec.structs.replace(client.welcome.settings, **other)
    client.receive(messages.encode(Welcome(3, 7, 300, "", "1", settings, "t")), 5 + QUIET_NS)
    assert (client.state, client.failed) == (
        "closed",
        "the server came back with another seat or other settings: join anew",
    )
    [goodbye] = said(client)
    assert isinstance(goodbye, Leave)
    assert goodbye.session == 300, "that seat is given back"


def test_leaving_while_nobody_is_there_ends_all_the_same() -> None:
    client, _ = quiet()
    client.leave("enough", None, 5 + QUIET_NS)
    client.poll(5 + QUIET_NS + session.LEAVE_GIVE_UP_NS - 1)
    assert client.state == "leaving"
    client.poll(5 + QUIET_NS + session.LEAVE_GIVE_UP_NS)
    assert (client.state, client.failed) == ("closed", "")


def test_only_a_welcome_to_our_own_hello_is_an_answer() -> None:
    client, _ = seated(tickets=True)
    assert client.welcome is not None
    ours = messages.encode(client.welcome)
    assert client.is_welcome(ours)
    for other in (messages.encode(msgspec.structs.replace(client.welcome, nonce=8)), waves(100), b"noise", ours[:40]):
        assert not client.is_welcome(other)
    assert client.state == "seated", "asking changes nothing"


# Observers ------------------------------------------------------------------------------------------------------------


def view(session: int, number: int = 1) -> bytes:
    return messages.encode(View(session, number, (0.0, 0.0), (), (), (), Stamp(1)))


@pytest.mark.parametrize("role", ["player", "observer"])
def test_views_are_for_observers_and_waves_are_not(role: str) -> None:
    client = answered(hello(role=role), server(tickets=True))
    assert client.welcome is not None
    session = client.welcome.session
    mine, others = (view, waves) if role == "observer" else (waves, view)
    assert client.receive(mine(session), 1) == messages.decode(mine(session))
    assert client.receive(others(session), 2) is None
    assert client.dropped == {"unexpected": 1}
    assert client.last_received_ns == 1


def test_an_observer_comes_back_to_the_same_place() -> None:
    core = server(tickets=True)
    client = answered(hello("", role="observer"), core, 0, "olaf's")
    client.poll(QUIET_NS)
    exchange(client, core, QUIET_NS, "another address")
    assert (client.state, client.resumed, client.renewed) == ("seated", 1, 0)
    assert [each.address for each in core.rooms[0].observer_slots.observers.values()] == ["another address"]
