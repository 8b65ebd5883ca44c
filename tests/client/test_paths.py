"""Paths over real sockets of this machine: hellos by the newest, the rest by the one in use, a welcome decides."""

import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import pytest

from cogrip.client.inputs import Connect, Poll
from cogrip.client.io.paths import LEFT, MOST_DATAGRAMS, MOST_MESSAGES, MOST_WAITED_NS, TOO_MANY, JoinError, Paths, find
from cogrip.client.path_migration import AGAIN_NS, REFUSED_NS, SPARE_NS
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import PEER, Address, Channel, UnencryptedChannel
from cogrip.protocol.wire.session import GIVE_UP_NS, ClientSession

from tests.client.far_server import LIMIT_S, FarServer, drain_until
from tests.client.seated_client import hello
from tests.fair_time import FairTime
from tests.free_ports import free_port

MS = 1_000_000


class SlowChannel(UnencryptedChannel):
    """A channel that is ready after `open`, sends `knock` until then, and fails after `never`."""

    def __init__(self) -> None:
        super().__init__()
        self.open = False

    def ready(self, address: Address) -> bool:
        return self.open and not self.failed

    def send(self, message: bytes, address: Address) -> bool:
        if not self.ready(address):
            self.dropped["not open"] = self.dropped.get("not open", 0) + 1
            return False
        return super().send(message, address)

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        if datagram == b"open":
            self.open = True
            return ()
        if datagram == b"never":
            self.failed = "the server's certificate is not the link's"
            return ()
        return (datagram,)

    def poll(self, now_ns: int) -> None:
        if not self.open and not self.outbox:
            self.outbox.append((PEER, b"knock"))

    def close(self, address: Address) -> None:
        self.outbox.append((PEER, b"bye"))


@pytest.fixture
def far() -> Iterator[FarServer]:
    server = FarServer()
    yield server
    server.socket.close()


Make = Callable[[Callable[[], Channel]], Paths]


@pytest.fixture
def make(far: FarServer) -> Iterator[Make]:
    made: list[Paths] = []

    def open_paths(channel: Callable[[], Channel]) -> Paths:
        made.append(Paths(find("127.0.0.1", far.port), channel))
        made[-1].open()
        return made[-1]

    yield open_paths
    for each in made:
        each.close()


@pytest.fixture
def paths(make: Make) -> Paths:
    return make(UnencryptedChannel)


def arrived(paths: Paths, many: int = 1) -> list[bytes]:
    """Drain until so much has come. Returns it."""
    return drain_until(paths, lambda taken: len(taken) >= many)


def wait_until_ready(paths: Paths) -> None:
    """Drain until the newest path is ready."""
    drain_until(paths, lambda taken: paths.paths[-1].ready)


def test_hellos_go_by_a_new_path_until_a_welcome_has_come_by_it(paths: Paths, far: FarServer) -> None:
    paths.send(b"waves")
    _, old = far.hear()
    paths.poll(0, resuming=True)
    paths.send(b"hello", hello=True)
    paths.send(b"more waves")
    received = dict(reversed(far.hear()) for _ in range(2))
    [new] = [address for address in received if address != old]
    assert received == {old: b"more waves", new: b"hello"}
    for words, address in ((b"old words", old), (b"welcome", new)):
        far.say(words, address)
        assert arrived(paths) == [words], "both are received from"
    paths.send(b"waves again")
    assert far.hear() == (b"waves again", new)
    assert paths.attempts == 1


def test_a_server_that_was_stopped_answers_the_hello_by_the_old_path_first(paths: Paths, far: FarServer) -> None:
    paths.send(b"hello", hello=True)  # at the tick at which its silence is noticed, before there is another path
    paths.poll(0, resuming=True)
    paths.send(b"hello again", hello=True)
    received = dict(far.hear() for _ in range(2))
    for words in (b"hello", b"hello again"):  # the seat is bound to where the last one came from
        far.say(b"welcome", received[words])
    arrived(paths, 2)
    paths.send(b"waves")
    assert far.hear() == (b"waves", received[b"hello again"])
    assert len(paths.paths) == 1


def test_a_handshake_is_reported_once_and_what_needs_none_is_not(far: FarServer, make: Make, paths: Paths) -> None:
    assert [paths.poll(now_ns, resuming=True) for now_ns in range(3)] == [False] * 3
    slow = make(SlowChannel)
    assert not slow.poll(0, resuming=True)
    heard = [far.hear() for _ in range(2)]
    for _, address in heard:
        far.say(b"open", address)
    wait_until_ready(slow)
    assert [slow.poll(now_ns, resuming=True) for now_ns in range(3)] == [True, False, False]


def test_a_path_that_carried_no_hello_is_closed_by_a_welcome_by_the_old_one(far: FarServer, make: Make) -> None:
    paths = make(SlowChannel)
    paths.poll(0, resuming=False)
    _, old = far.hear()
    far.say(b"open", old)
    wait_until_ready(paths)
    paths.poll(0, resuming=True)
    far.say(b"welcome", old)
    assert arrived(paths) == [b"welcome"]
    assert len(paths.paths) == 1


def test_a_hello_waits_until_its_path_is_ready_and_is_no_drop(far: FarServer, make: Make) -> None:
    paths = make(SlowChannel)
    paths.poll(0, resuming=False)
    _, address = far.hear()
    paths.send(b"hello", hello=True)
    paths.send(b"hello 2", hello=True)
    assert paths.counted() == {}
    paths.send(b"waves")
    assert paths.counted() == {"not open": 1}, "what cannot wait is dropped and counted"
    far.say(b"open", address)
    wait_until_ready(paths)
    paths.poll(1, resuming=False)
    assert far.hear() == (b"hello 2", address), "the newest"
    paths.send(b"more waves")
    assert far.hear() == (b"more waves", address), "one path carries everything"


def test_paths_are_tried_as_path_migration_says_and_a_closed_one_says_goodbye(far: FarServer, make: Make) -> None:
    paths = make(SlowChannel)
    paths.poll(0, resuming=False)
    _, first = far.hear()
    for now_ns in range(0, sum(AGAIN_NS[:2]) + 1, 100 * MS):
        paths.poll(now_ns, resuming=True)
    assert paths.attempts == 3
    paths.poll(sum(AGAIN_NS[:2]) + 1, resuming=False)
    paths.poll(sum(AGAIN_NS[:2]) + 1 + SPARE_NS, resuming=False)
    goodbyes: set[object] = set()
    while len(goodbyes) < 3:  # the last paths of each of two changes, and the one that was spare
        words, address = far.hear()
        if words == b"bye":
            goodbyes.add(address)
    assert first not in goodbyes


def test_a_channel_that_failed_for_good_is_reported_and_tried_again(far: FarServer, make: Make) -> None:
    paths = make(SlowChannel)
    paths.poll(0, resuming=True)
    for address in {far.hear()[1] for _ in range(2)}:
        far.say(b"never", address)
    drain_until(paths, lambda taken: all(each.channel.failed for each in paths.paths))
    paths.poll(AGAIN_NS[0], resuming=True)
    assert paths.failed == "the server's certificate is not the link's"
    assert paths.attempts == 2


def test_attempts_are_more_frequent_where_nobody_listens_and_the_address_stands_once() -> None:
    port = free_port()
    with closing(Paths(find("127.0.0.1", port), UnencryptedChannel)) as paths:
        paths.open()
        paths.poll(0, resuming=True)
        drain_until(paths, lambda taken: "connection refused" in paths.counted(), hello=b"hello")
        for now_ns, attempts in ((REFUSED_NS - 1, 1), (REFUSED_NS, 2)):
            paths.poll(now_ns, resuming=True)
            assert paths.attempts == attempts
        said = paths._placed("no server answered within 3 s")
    assert said == f"no server answered within 3 s; nothing listens on 127.0.0.1:{port}: is the server running there?"


def test_no_network_is_counted_as_an_attempt(paths: Paths, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(self: socket.socket, address: object) -> None:
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(socket.socket, "connect", unreachable)
    for now_ns in range(0, AGAIN_NS[0], MS):
        paths.poll(now_ns, resuming=True)
    assert paths.counted() == {"socket: Network is unreachable": 1}
    assert paths.failed == "socket: Network is unreachable"
    monkeypatch.undo()
    paths.poll(AGAIN_NS[0], resuming=True)
    assert paths.attempts == 2


# Connecting -----------------------------------------------------------------------------------------------------------


def caller() -> Any:
    """Return the part of a core that asks for a seat."""
    session = ClientSession(hello())

    def handle(given: Connect | Poll, now_ns: int) -> None:
        session.connect(now_ns) if isinstance(given, Connect) else session.poll(now_ns)

    return SimpleNamespace(session=session, handle=handle, receive=session.receive)


def test_a_channel_that_fails_is_the_reason_why_there_is_no_seat(far: FarServer) -> None:
    class Failing(SlowChannel):
        def poll(self, now_ns: int) -> None:
            self.failed = "this is another server"

    with (
        closing(Paths(find("127.0.0.1", far.port), Failing)) as paths,
        pytest.raises(JoinError, match=rf"^this is another server \(server {far.place}\)$"),
    ):
        paths.connect(caller(), Stop())


def test_a_stop_before_there_is_a_seat(far: FarServer) -> None:
    with (
        closing(Paths(find("127.0.0.1", far.port), SlowChannel)) as paths,
        pytest.raises(JoinError, match=r"stopped \(SIGINT\) before a seat was had"),
    ):
        paths.connect(caller(), Stop("stopped (SIGINT)"))


def test_paths_that_were_never_opened_need_no_closing(far: FarServer) -> None:
    Paths(find("127.0.0.1", far.port), UnencryptedChannel).close()
    assert GIVE_UP_NS < LIMIT_S * 1e9


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "::1", "localhost", "192.0.2.7", "0.0.0.0"])
def test_addresses_of_this_machine(host: str) -> None:
    assert find(host, 47800).loopback is (host not in {"192.0.2.7", "0.0.0.0"})


@pytest.mark.parametrize("name", ["no-such-host", "a" * 70])
def test_an_unknown_name(name: str) -> None:
    with pytest.raises(JoinError, match=r"check the server's name"):
        find(f"{name}.invalid", 47800)


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel gives no arrival times here")
def test_a_message_comes_with_the_time_at_which_its_datagram_came(paths: Paths, far: FarServer) -> None:
    """Not with that of the loop, here 10 ms later."""
    paths.send(b"hello")
    far.say(b"word", far.hear()[1])
    times_ns: list[int] = []
    later_ns, waited = MOST_WAITED_NS // 2, FairTime()
    while not times_ns:
        assert waited.spent_s() < LIMIT_S, "nothing came"
        paths.drain(
            time.monotonic_ns() + later_ns, lambda message, at_ns: times_ns.append(at_ns), lambda message: False
        )
    assert times_ns[0] <= time.monotonic_ns()


# A flood --------------------------------------------------------------------------------------------------------------


def queued(paths: Paths, count: int) -> list[bytes]:
    """Put `count` datagrams before the socket of the path in use. Returns those that wait there still."""
    waiting = [b"%d" % number for number in range(count)]

    def poll(most_bytes: int, now_ns: int) -> tuple[bytes, None, int] | None:
        return (waiting.pop(0), None, now_ns) if waiting else None

    paths.paths[0].socket.close()
    paths.paths[0].socket = SimpleNamespace(send=len, close=list)  # type: ignore[assignment]
    paths.paths[0].arrivals = SimpleNamespace(poll=poll)  # type: ignore[assignment]
    return waiting


@pytest.mark.parametrize("count", [MOST_DATAGRAMS - 1, MOST_DATAGRAMS, MOST_DATAGRAMS + 1, 3 * MOST_DATAGRAMS])
def test_a_drain_takes_so_many_datagrams_and_no_more(paths: Paths, count: int) -> None:
    waiting = queued(paths, count)
    taken: list[bytes] = []
    paths.drain(0, lambda message, at_ns: taken.append(message), lambda message: False)
    assert len(taken) == min(count, MOST_DATAGRAMS)
    assert paths.counted() == ({LEFT: 1} if count >= MOST_DATAGRAMS else {})
    while waiting:
        paths.drain(0, lambda message, at_ns: taken.append(message), lambda message: False)
    assert taken == [b"%d" % number for number in range(count)], "nothing is lost, and nothing overtakes"


def test_what_waited_for_long_counts_as_news_and_no_time_falls(paths: Paths) -> None:
    """A loop was away for 12 s: the kernel kept the oldest datagrams, and the server is not silent for that."""
    ages_ns = iter([12 * 10**9, 10**9, 1_000_000, MOST_WAITED_NS + 1, MOST_WAITED_NS, 5_000_000, 0])
    queued(paths, 7)
    take_one = paths.paths[0].arrivals.poll

    def poll(most_bytes: int, now_ns: int) -> tuple[bytes, None, int] | None:
        found = take_one(most_bytes, now_ns)
        return found and (found[0], None, now_ns - next(ages_ns))

    paths.paths[0].arrivals = SimpleNamespace(poll=poll)  # type: ignore[assignment]
    now_ns, came_ns = 50 * 10**9, list[int]()
    paths.drain(now_ns, lambda message, at_ns: came_ns.append(now_ns - at_ns), lambda message: False)
    assert came_ns == [MOST_WAITED_NS, MOST_WAITED_NS, 1_000_000, 1_000_000, 1_000_000, 1_000_000, 0]


@pytest.mark.parametrize("count", [MOST_MESSAGES, MOST_MESSAGES + 1, 100])
def test_a_datagram_gives_so_many_messages_and_no_more(far: FarServer, make: Make, count: int) -> None:
    class Bundle(UnencryptedChannel):
        def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
            return [datagram] * count

    paths = make(Bundle)
    paths.send(b"hello")
    far.say(b"again", far.hear()[1])
    assert arrived(paths) == [b"again"] * MOST_MESSAGES
    assert paths.counted() == ({TOO_MANY: count - MOST_MESSAGES} if count > MOST_MESSAGES else {})


def test_a_flood_on_the_old_path_leaves_the_new_one_its_turn(paths: Paths, far: FarServer) -> None:
    queued(paths, 1000)
    paths.poll(0, resuming=True)
    paths.send(b"hello", hello=True)
    far.say(b"welcome", far.hear()[1])
    drain_until(paths, lambda taken: len(paths.paths) == 1)
