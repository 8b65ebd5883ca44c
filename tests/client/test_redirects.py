"""Redirects over real sockets of this machine: followed where they answer the hello, dropped where they could lead astray."""

import socket
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest

from cogrip.client.io.paths import Paths, find, server_of
from cogrip.protocol.channel import UnencryptedChannel
from cogrip.protocol.messages import PROTOCOL_VERSION, Redirect, encode
from cogrip.protocol.session import MOST_REDIRECTS, ClientSession, make_hello

LIMIT_S = 60.0
NONCE = 77


class Server:
    """A server's socket."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(LIMIT_S)
        self.port = int(self.socket.getsockname()[1])
        self.place = f"127.0.0.1:{self.port}"

    def answer(self, words: bytes) -> bytes:
        """Wait for a datagram, and answer it. Returns it."""
        heard, address = self.socket.recvfrom(2000)
        self.socket.sendto(words, address)
        return heard


@pytest.fixture
def servers() -> Iterator[list[Server]]:
    made = [Server() for _ in range(MOST_REDIRECTS + 2)]
    yield made
    for each in made:
        each.socket.close()


@pytest.fixture
def session() -> ClientSession:
    hello = make_hello(
        software="1", nonce=NONCE, room="", name="", digest="", device="sim:x", axes=1, rate_hz=1e3, force_n=1.0
    )
    return ClientSession(hello)


def redirect(place: str, *fronts: str, nonce: int = NONCE) -> bytes:
    return encode(Redirect(PROTOCOL_VERSION, nonce, place, fronts))


def opened(server: Server, roams: bool = True) -> Paths:
    paths = Paths(find("127.0.0.1", server.port), UnencryptedChannel, roams)
    paths.open()
    return paths


def drained(paths: Paths, session: ClientSession, done: bytes = b"") -> None:
    """Drain until these bytes have come, or something was counted or followed."""
    taken: list[bytes] = []
    before, until = (paths.attempts, paths.counted()), time.monotonic() + LIMIT_S
    while done not in taken and (done or (paths.attempts, paths.counted()) == before):
        assert time.monotonic() < until, "nothing came"
        paths.drain(
            0, lambda message, at_ns: taken.append(message), lambda message: message == b"welcome", session.redirect
        )


def test_a_redirect_leads_to_the_server_that_has_the_room(servers: list[Server], session: ClientSession) -> None:
    front, room = servers[:2]
    paths = opened(front)
    session.connect(0)
    paths.send(session.outbox.popleft(), hello=True)
    assert front.answer(redirect(room.place)) == session.hello
    drained(paths, session)
    paths.poll(0, resuming=False)
    assert room.answer(b"welcome") == session.hello, "at once, not with the next repetition"
    drained(paths, session, b"welcome")
    assert [path.server for path in paths.paths] == [server_of(room.place)]
    paths.close()


def test_in_a_silence_the_server_of_the_seat_is_asked_and_then_the_fronts(
    servers: list[Server], session: ClientSession
) -> None:
    front, room, other = servers[:3]
    paths = opened(front)
    session.connect(0)
    paths.send(session.hello, hello=True)
    front.answer(redirect(room.place, other.place, "no.address:1", "127.0.0.1:0"))
    drained(paths, session)
    paths.poll(0, resuming=False)
    room.answer(b"welcome")
    drained(paths, session, b"welcome")
    asked, now_ns = [], 0
    for _ in range(4):
        paths.poll(now_ns, resuming=True)
        asked.append(paths.paths[-1].server.port)
        paths.poll(now_ns, resuming=True)  # it sees that the path is ready
        now_ns += 4_000_000_000
    assert asked == [room.port, front.port, other.port, room.port]
    paths.close()


@pytest.mark.parametrize(
    "place",
    ["", "lab.example:47800", "localhost:1", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:65536", "::1:5", "[::1", "x" * 60],
)
def test_a_redirect_to_no_address_is_counted(place: str, servers: list[Server], session: ClientSession) -> None:
    paths = opened(servers[0])
    session.connect(0)
    paths.send(session.hello, hello=True)
    servers[0].answer(redirect(place))
    drained(paths, session)
    assert paths.counted() == {"redirect not followed": 1}
    assert len(paths.paths) == 1
    paths.close()


@pytest.mark.parametrize("roams", [True, False])
def test_an_unencrypted_redirect_leaves_this_machine_where_a_person_allowed_it_alone(
    roams: bool, servers: list[Server], session: ClientSession
) -> None:
    paths = opened(servers[0], roams)
    session.connect(0)
    paths.send(session.hello, hello=True)
    servers[0].answer(redirect("192.0.2.77:47800"))
    drained(paths, session)
    assert paths.counted() == ({} if roams else {"redirect not followed": 1})
    assert paths.attempts == roams
    paths.close()


def test_a_ring_of_redirects_is_left(servers: list[Server], session: ClientSession) -> None:
    paths = opened(servers[0])
    session.connect(0)
    paths.send(session.hello, hello=True)
    for here, there in pairwise(servers):
        here.answer(redirect(there.place))
        drained(paths, session)
        paths.poll(0, resuming=False)
    assert paths.attempts == MOST_REDIRECTS
    assert paths.counted() == {"too many redirects": 1}
    paths.close()


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
