"""Redirects over real sockets of this machine: followed where they answer the hello, dropped where they could lead astray."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest

from cogrip.client.io.paths import Paths, find, server_of
from cogrip.protocol.secure.channel import UnencryptedChannel
from cogrip.protocol.wire.messages import PROTOCOL_VERSION, Redirect, encode
from cogrip.protocol.wire.session import MOST_REDIRECTS, ClientSession

from tests.client.far_server import FarServer, drain_until
from tests.client.seated_client import hello

NONCE = 77


@pytest.fixture
def servers() -> Iterator[list[FarServer]]:
    made = [FarServer() for _ in range(MOST_REDIRECTS + 2)]
    yield made
    for each in made:
        each.socket.close()


@pytest.fixture
def session() -> ClientSession:
    return ClientSession(hello(nonce=NONCE))


def redirect(place: str, *fronts: str, nonce: int = NONCE) -> bytes:
    return encode(Redirect(PROTOCOL_VERSION, nonce, place, fronts))


Ask = Callable[..., Paths]


@pytest.fixture
def ask(servers: list[FarServer], session: ClientSession) -> Iterator[Ask]:
    """Open paths to the first server, whose answer to the hello is a redirect."""
    made: list[Paths] = []

    def asked(place: str, *fronts: str, roams: bool = True) -> Paths:
        paths = Paths(find("127.0.0.1", servers[0].port), UnencryptedChannel, roams)
        made.append(paths)
        paths.open()
        session.connect(0)
        paths.send(session.outbox.popleft(), hello=True)
        assert servers[0].answer(redirect(place, *fronts)) == session.hello
        drained(paths, session)
        return paths

    yield asked
    for each in made:
        each.close()


def drained(paths: Paths, session: ClientSession, done: bytes = b"") -> None:
    """Drain until these bytes have come, or something was counted or followed."""
    before = (paths.attempts, paths.counted())
    drain_until(
        paths, lambda taken: done in taken if done else (paths.attempts, paths.counted()) != before, session.redirect
    )


def test_a_redirect_leads_to_the_server_that_has_the_room(
    servers: list[FarServer], session: ClientSession, ask: Ask
) -> None:
    room = servers[1]
    paths = ask(room.place)
    paths.poll(0, resuming=False)
    assert room.answer(b"welcome") == session.hello, "at once, not with the next repetition"
    drained(paths, session, b"welcome")
    assert [path.server for path in paths.paths] == [server_of(room.place)]


def test_in_a_silence_the_server_of_the_seat_is_asked_and_then_the_fronts(
    servers: list[FarServer], session: ClientSession, ask: Ask
) -> None:
    front, room, other = servers[:3]
    paths = ask(room.place, other.place, "no.address:1", "127.0.0.1:0")
    paths.poll(0, resuming=False)
    room.answer(b"welcome")
    drained(paths, session, b"welcome")
    asked = []
    for now_ns in range(0, 16_000_000_000, 4_000_000_000):
        paths.poll(now_ns, resuming=True)
        asked.append(paths.paths[-1].server.port)
        paths.poll(now_ns, resuming=True)  # it sees that the path is ready
    assert asked == [room.port, front.port, other.port, room.port]


@pytest.mark.parametrize(
    "place",
    ["", "lab.example:47800", "localhost:1", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:65536", "::1:5", "[::1", "x" * 60],
)
def test_a_redirect_to_no_address_is_counted(place: str, ask: Ask) -> None:
    paths = ask(place)
    assert paths.counted() == {"redirect not followed": 1}
    assert len(paths.paths) == 1


@pytest.mark.parametrize("roams", [True, False])
def test_an_unencrypted_redirect_leaves_this_machine_where_a_person_allowed_it_alone(roams: bool, ask: Ask) -> None:
    paths = ask("192.0.2.77:47800", roams=roams)
    assert paths.counted() == ({} if roams else {"redirect not followed": 1})
    assert paths.attempts == roams


def test_a_ring_of_redirects_is_left(servers: list[FarServer], session: ClientSession, ask: Ask) -> None:
    paths = ask(servers[1].place)
    for here, there in pairwise(servers[1:]):
        paths.poll(0, resuming=False)
        here.answer(redirect(there.place))
        drained(paths, session)
    assert paths.attempts == MOST_REDIRECTS
    assert paths.counted() == {"too many redirects": 1}


def test_a_redirect_that_nobody_waits_for_is_none(session: ClientSession) -> None:
    answer = redirect("127.0.0.1:1")
    assert session.redirect(answer) is None, "nobody has asked"
    session.connect(0)
    assert session.redirect(answer) is not None
    for other in (redirect("127.0.0.1:1", nonce=NONCE + 1), answer[:-1], session.hello):
        assert session.redirect(other) is None
    session.receive(answer, 0)
    assert session.dropped == {"unexpected": 1}, "the core itself follows none"
    assert session.state == "connecting"
