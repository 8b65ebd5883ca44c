"""Paths over real sockets of this machine: hellos by the newest, the rest by the one in use, a welcome decides."""

import socket
import time
from collections.abc import Callable, Iterator, Sequence

import pytest

from cogrip.client.inputs import Connect, Poll
from cogrip.client.io.paths import LEFT, MOST_DATAGRAMS, MOST_MESSAGES, TOO_MANY, JoinError, Paths, Server, find
from cogrip.client.path_migration import AGAIN_NS, REFUSED_NS, SPARE_NS
from cogrip.protocol.channel import PEER, Address, Channel, UnencryptedChannel
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.session import GIVE_UP_NS, ClientSession, make_hello

from tests.free_ports import free_port

LIMIT_S = 60.0
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


class Far:
    """A server's socket."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(LIMIT_S)
        self.port = int(self.socket.getsockname()[1])

    def hear(self) -> tuple[bytes, object]:
        """Wait for the next datagram. Returns it with its address."""
        return self.socket.recvfrom(2000)

    def say(self, words: bytes, address: object) -> None:
        self.socket.sendto(words, address)  # type: ignore[call-overload]


@pytest.fixture
def far() -> Iterator[Far]:
    server = Far()
    yield server
    server.socket.close()


Make = Callable[[Callable[[], Channel]], Paths]


@pytest.fixture
def make(far: Far) -> Iterator[Make]:
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


def arrived(paths: Paths, now_ns: int = 0, answers: Callable[[bytes], bool] = lambda message: False) -> list[bytes]:
    """Drain until something has come. Returns it."""
    found: list[bytes] = []
    until = time.monotonic() + LIMIT_S
    while not found:
        assert time.monotonic() < until, "nothing came"
        paths.drain(now_ns, lambda message, at_ns: found.append(message), answers)
    return found


def wait_until_ready(paths: Paths) -> None:
    """Drain until the newest path is ready."""
    until = time.monotonic() + LIMIT_S
    while not paths.paths[-1].ready:
        assert time.monotonic() < until, "it never opened"
        paths.drain(0, lambda message, at_ns: None, lambda message: False)


def test_one_path_carries_everything(paths: Paths, far: Far) -> None:
    paths.send(b"hello", hello=True)
    paths.send(b"waves")
    (first, address), (second, again) = far.hear(), far.hear()
    assert (first, second, address) == (b"hello", b"waves", again)
    far.say(b"answer", address)
    assert arrived(paths) == [b"answer"]
    assert paths.counted() == {}


def test_hellos_go_by_a_new_path_until_a_welcome_has_come_by_it(paths: Paths, far: Far) -> None:
    paths.send(b"waves")
    _, old = far.hear()
    paths.poll(0, resuming=True)
    paths.send(b"hello", hello=True)
    paths.send(b"more waves")
    received = dict(reversed(far.hear()) for _ in range(2))
    [new] = [address for address in received if address != old]
    assert received == {old: b"more waves", new: b"hello"}
    far.say(b"old words", old)
    assert arrived(paths, answers=lambda message: message == b"welcome") == [b"old words"], "both are received from"
    far.say(b"welcome", new)
    assert arrived(paths, answers=lambda message: message == b"welcome") == [b"welcome"]
    paths.send(b"waves again")
    assert far.hear() == (b"waves again", new)
    assert paths.attempts == 1


def test_a_server_that_was_stopped_answers_the_hello_by_the_old_path_first(paths: Paths, far: Far) -> None:
    paths.send(b"hello", hello=True)  # at the tick at which its silence is noticed, before there is another path
    paths.poll(0, resuming=True)
    paths.send(b"hello again", hello=True)
    received = dict(far.hear() for _ in range(2))
    for hello in (b"hello", b"hello again"):  # the seat is bound to where the last one came from
        far.say(b"welcome", received[hello])
    found: list[bytes] = []
    while len(found) < 2:
        found += arrived(paths, answers=lambda message: message == b"welcome")
    paths.send(b"waves")
    assert far.hear() == (b"waves", received[b"hello again"])
    assert len(paths.paths) == 1


def test_a_handshake_is_reported_once_and_what_needs_none_is_not(far: Far, make: Make, paths: Paths) -> None:
    assert [paths.poll(now_ns, resuming=True) for now_ns in range(3)] == [False] * 3
    slow = make(SlowChannel)
    assert not slow.poll(0, resuming=True)
    heard = [far.hear() for _ in range(2)]
    for _, address in heard:
        far.say(b"open", address)
    wait_until_ready(slow)
    assert [slow.poll(now_ns, resuming=True) for now_ns in range(3)] == [True, False, False]


def test_a_path_that_carried_no_hello_is_closed_by_a_welcome_by_the_old_one(far: Far, make: Make) -> None:
    paths = make(SlowChannel)
    paths.poll(0, resuming=False)
    _, old = far.hear()
    far.say(b"open", old)
    wait_until_ready(paths)
    paths.poll(0, resuming=True)
    far.say(b"welcome", old)
    assert arrived(paths, answers=lambda message: message == b"welcome") == [b"welcome"]
    assert len(paths.paths) == 1


def test_a_hello_waits_until_its_path_is_ready_and_is_no_drop(far: Far, make: Make) -> None:
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


def test_paths_are_tried_as_path_migration_says_and_a_closed_one_says_goodbye(far: Far, make: Make) -> None:
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


def test_a_channel_that_failed_for_good_is_reported_and_tried_again(far: Far, make: Make) -> None:
    paths = make(SlowChannel)
    paths.poll(0, resuming=True)
    addresses = {far.hear()[1] for _ in range(2)}
    for address in addresses:
        far.say(b"never", address)
    until = time.monotonic() + LIMIT_S
    while not all(each.channel.failed for each in paths.paths):
        assert time.monotonic() < until
        paths.drain(0, lambda message, at_ns: None, lambda message: False)
    paths.poll(AGAIN_NS[0], resuming=True)
    assert paths.failed == "the server's certificate is not the link's"
    assert paths.attempts == 2


def test_attempts_are_more_frequent_where_nobody_listens() -> None:
    paths = Paths(find("127.0.0.1", free_port()), UnencryptedChannel)
    paths.open()
    paths.poll(0, resuming=True)
    until = time.monotonic() + LIMIT_S
    while "connection refused" not in paths.counted():
        assert time.monotonic() < until
        paths.send(b"hello", hello=True)
        paths.drain(0, lambda message, at_ns: None, lambda message: False)
    paths.poll(REFUSED_NS - 1, resuming=True)
    assert paths.attempts == 1
    paths.poll(REFUSED_NS, resuming=True)
    assert paths.attempts == 2
    paths.close()


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


class Caller:
    """A core that wants a seat."""

    def __init__(self) -> None:
        self.session = ClientSession(make_hello(
            software="1", nonce=1, room="", name="", digest="", device="test", axes=1, rate_hz=1024.0
        ))  # fmt: skip

    def handle(self, given: Connect | Poll, now_ns: int) -> None:
        if isinstance(given, Connect):
            self.session.connect(now_ns)
        else:
            self.session.poll(now_ns)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        self.session.receive(datagram, now_ns)


def test_a_channel_that_fails_is_the_reason_why_there_is_no_seat(far: Far) -> None:
    class Failing(SlowChannel):
        def poll(self, now_ns: int) -> None:
            self.failed = "this is another server"

    paths = Paths(find("127.0.0.1", far.port), Failing)
    with pytest.raises(JoinError, match=rf"^this is another server \(server 127.0.0.1:{far.port}\)$"):
        paths.connect(Caller(), Stop())
    paths.close()


def test_where_nobody_listens_the_address_stands_once() -> None:
    paths = Paths(find("127.0.0.1", port := free_port()), UnencryptedChannel)
    paths.open()
    until = time.monotonic() + LIMIT_S
    while "connection refused" not in paths.counted():
        assert time.monotonic() < until
        paths.send(b"hello", hello=True)
        paths.drain(0, lambda message, at_ns: None, lambda message: False)
    said = paths._placed("no server answered within 3 s")
    assert said == f"no server answered within 3 s; nothing listens on 127.0.0.1:{port}: is the server running there?"
    paths.close()


def test_a_stop_before_there_is_a_seat(far: Far) -> None:
    paths = Paths(find("127.0.0.1", far.port), SlowChannel)
    with pytest.raises(JoinError, match=r"stopped \(SIGINT\) before a seat was had"):
        paths.connect(Caller(), Stop("stopped (SIGINT)"))
    paths.close()


def test_paths_that_were_never_opened_need_no_closing(far: Far) -> None:
    Paths(find("127.0.0.1", far.port), UnencryptedChannel).close()
    assert GIVE_UP_NS < LIMIT_S * 1e9


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("localhost", True),
        ("192.0.2.7", False),
        ("0.0.0.0", False),
    ],
)
def test_addresses_of_this_machine(host: str, loopback: bool) -> None:
    found: Server = find(host, 47800)
    assert found.loopback is loopback


def test_an_unknown_name() -> None:
    with pytest.raises(JoinError, match=r"check the server's name"):
        find("no-such-host.invalid", 47800)
    with pytest.raises(JoinError, match=r"check the server's name"):
        find("a" * 70 + ".invalid", 47800)


# A flood --------------------------------------------------------------------------------------------------------------


def queued(paths: Paths, count: int) -> list[bytes]:
    """Put `count` datagrams before the socket of the path in use. Returns those that wait there still."""
    waiting = [b"%d" % number for number in range(count)]

    class Socket:
        def recv(self, size: int) -> bytes:
            if not waiting:
                raise BlockingIOError
            return waiting.pop(0)

        def send(self, datagram: bytes) -> None: ...
        def close(self) -> None: ...

    paths.paths[0].socket.close()
    paths.paths[0].socket = Socket()  # type: ignore[assignment]
    paths.paths[0].arrived = lambda: True
    return waiting


def test_a_socket_with_nothing_is_not_asked_for_a_datagram(paths: Paths) -> None:
    queued(paths, 3)
    paths.paths[0].arrived = lambda: False
    paths.drain(0, lambda message, at_ns: pytest.fail("it was asked"), lambda message: False)


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


@pytest.mark.parametrize("count", [MOST_MESSAGES, MOST_MESSAGES + 1, 100])
def test_a_datagram_gives_so_many_messages_and_no_more(far: Far, make: Make, count: int) -> None:
    class Bundle(UnencryptedChannel):
        def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
            return [datagram] * count

    paths = make(Bundle)
    paths.send(b"hello")
    far.say(b"again", far.hear()[1])
    assert arrived(paths) == [b"again"] * MOST_MESSAGES
    assert paths.counted() == ({TOO_MANY: count - MOST_MESSAGES} if count > MOST_MESSAGES else {})


def test_a_flood_on_the_old_path_leaves_the_new_one_its_turn(paths: Paths, far: Far) -> None:
    queued(paths, 1000)
    paths.poll(0, resuming=True)
    paths.send(b"hello", hello=True)
    far.say(b"welcome", far.hear()[1])
    until = time.monotonic() + LIMIT_S
    while len(paths.paths) > 1:
        assert time.monotonic() < until, "the welcome was not received"
        paths.drain(0, lambda message, at_ns: None, lambda message: message == b"welcome")
