"""A client's ways over real sockets of this machine: hellos by the newest, the rest by the one in use, a welcome decides."""

import socket
import time
from collections.abc import Callable, Iterator, Sequence

import pytest

from cogrip.client.io.paths import LEFT, MOST_DATAGRAMS, MOST_MESSAGES, TOO_MANY, JoinError, Paths, Server, find
from cogrip.client.path_migration import AGAIN_NS, REFUSED_NS, SPARE_NS
from cogrip.protocol.channel import PEER, Address, Channel, UnencryptedChannel
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.session import GIVE_UP_NS, ClientSession, make_hello

from tests.free_ports import free_port

LIMIT_S = 60.0
MS = 1_000_000


class SlowChannel(UnencryptedChannel):
    """Opens once it has heard `open`, says `knock` until then, and can be told to fail."""

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
    """A server's socket, and what it heard, by address."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(LIMIT_S)
        self.port = int(self.socket.getsockname()[1])

    def hear(self) -> tuple[bytes, object]:
        """The next datagram; waits for it."""
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
def calls(far: Far) -> Iterator[Make]:
    made: list[Paths] = []

    def make(channel: Callable[[], Channel]) -> Paths:
        made.append(Paths(find("127.0.0.1", far.port), channel))
        made[-1].open()
        return made[-1]

    yield make
    for each in made:
        each.close()


def arrives(calls: Paths, now_ns: int = 0, answers: Callable[[bytes], bool] = lambda message: False) -> list[bytes]:
    """Drain until something has come."""
    found: list[bytes] = []
    until = time.monotonic() + LIMIT_S
    while not found:
        assert time.monotonic() < until, "nothing came"
        calls.drain(now_ns, lambda message, at_ns: found.append(message), answers)
    return found


def opens(calls: Paths) -> None:
    """Drain until the newest channel is open."""
    until = time.monotonic() + LIMIT_S
    while not calls._migration.asking.channel.ready(PEER):
        assert time.monotonic() < until, "it never opened"
        calls.drain(0, lambda message, at_ns: None, lambda message: False)


def test_one_way_takes_everything(far: Far, calls: Make) -> None:
    way = calls(UnencryptedChannel)
    way.send(b"hello", hello=True)
    way.send(b"waves")
    (first, address), (second, again) = far.hear(), far.hear()
    assert (first, second, address) == (b"hello", b"waves", again)
    far.say(b"answer", address)
    assert arrives(way) == [b"answer"]
    assert way.counted() == {}


def test_hellos_go_by_a_new_way_until_a_welcome_has_come_by_it(far: Far, calls: Make) -> None:
    way = calls(UnencryptedChannel)
    way.send(b"waves")
    _, old = far.hear()
    way.poll(0, resuming=True)
    way.send(b"hello", hello=True)
    way.send(b"more waves")
    heard = dict(reversed(far.hear()) for _ in range(2))
    [new] = [address for address in heard if address != old]
    assert heard == {old: b"more waves", new: b"hello"}
    far.say(b"old words", old)
    assert arrives(way, answers=lambda message: message == b"welcome") == [b"old words"], "both are listened to"
    far.say(b"welcome", new)
    assert arrives(way, answers=lambda message: message == b"welcome") == [b"welcome"]
    way.send(b"waves again")
    assert far.hear() == (b"waves again", new)
    assert way.dials == 1


def test_a_welcome_by_the_old_way_closes_the_new_one(far: Far, calls: Make) -> None:
    way = calls(UnencryptedChannel)
    way.send(b"waves")
    _, old = far.hear()
    way.poll(0, resuming=True)
    far.say(b"welcome", old)
    assert arrives(way, answers=lambda message: True) == [b"welcome"]
    way.send(b"hello", hello=True)
    assert far.hear() == (b"hello", old)


def test_a_hello_waits_for_its_way_to_open_and_is_no_drop(far: Far, calls: Make) -> None:
    way = calls(SlowChannel)
    way.poll(0, resuming=False)
    _, address = far.hear()
    way.send(b"hello", hello=True)
    way.send(b"hello 2", hello=True)
    assert way.counted() == {}
    way.send(b"waves")
    assert way.counted() == {"not open": 1}, "what cannot wait is dropped and counted"
    far.say(b"open", address)
    opens(way)
    way.poll(1, resuming=False)
    assert far.hear() == (b"hello 2", address), "the newest"


def test_a_way_is_dialled_anew_as_the_policy_says_and_what_is_closed_says_goodbye(far: Far, calls: Make) -> None:
    way = calls(SlowChannel)
    way.poll(0, resuming=False)
    _, first = far.hear()
    for now_ns in range(0, sum(AGAIN_NS[:2]) + 1, 100 * MS):
        way.poll(now_ns, resuming=True)
    assert way.dials == 3
    way.poll(sum(AGAIN_NS[:2]) + 1, resuming=False)
    way.poll(sum(AGAIN_NS[:2]) + 1 + SPARE_NS, resuming=False)
    goodbyes: set[object] = set()
    while len(goodbyes) < 3:  # the last way of each of two changes, and the one that was spare
        words, address = far.hear()
        if words == b"bye":
            goodbyes.add(address)
    assert first not in goodbyes


def test_what_failed_for_good_is_told_and_tried_again(far: Far, calls: Make) -> None:
    way = calls(SlowChannel)
    way.poll(0, resuming=True)
    addresses = {far.hear()[1] for _ in range(2)}
    for address in addresses:
        far.say(b"never", address)
    until = time.monotonic() + LIMIT_S
    while not all(call.channel.failed for call in way._migration.ways):
        assert time.monotonic() < until
        way.drain(0, lambda message, at_ns: None, lambda message: False)
    way.poll(AGAIN_NS[0], resuming=True)
    assert way.failed == "the server's certificate is not the link's"
    assert way.dials == 2


def test_where_nobody_listens_it_is_tried_more_often() -> None:
    way = Paths(find("127.0.0.1", free_port()), UnencryptedChannel)
    way.open()
    way.poll(0, resuming=True)
    until = time.monotonic() + LIMIT_S
    while "connection refused" not in way.counted():
        assert time.monotonic() < until
        way.send(b"hello", hello=True)
        way.drain(0, lambda message, at_ns: None, lambda message: False)
    way.poll(REFUSED_NS - 1, resuming=True)
    assert way.dials == 1
    way.poll(REFUSED_NS, resuming=True)
    assert way.dials == 2
    way.close()


def test_no_network_is_counted_and_is_a_try(calls: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    way = calls(UnencryptedChannel)

    def unreachable(self: socket.socket, address: object) -> None:
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(socket.socket, "connect", unreachable)
    for now_ns in range(0, AGAIN_NS[0], MS):
        way.poll(now_ns, resuming=True)
    assert way.counted() == {"socket: Network is unreachable": 1}
    assert way.failed == "socket: Network is unreachable"
    monkeypatch.undo()
    way.poll(AGAIN_NS[0], resuming=True)
    assert way.dials == 2


# The first call -------------------------------------------------------------------------------------------------------


class Caller:
    """A core that wants a seat."""

    def __init__(self) -> None:
        self.session = ClientSession(make_hello(
            software="1", nonce=1, room="", name="", digest="", device="test", axes=1, rate_hz=1024.0
        ))  # fmt: skip

    def call(self, now_ns: int) -> None:
        self.session.connect(now_ns)

    def poll(self, now_ns: int) -> None:
        self.session.poll(now_ns)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        self.session.receive(datagram, now_ns)


def test_a_channel_that_fails_is_the_reason_why_there_is_no_seat(far: Far) -> None:
    class Failing(SlowChannel):
        def poll(self, now_ns: int) -> None:
            self.failed = "this is another server"

    way = Paths(find("127.0.0.1", far.port), Failing)
    with pytest.raises(JoinError, match=rf"^this is another server \(server 127.0.0.1:{far.port}\)$"):
        way.call(Caller(), Stop())
    way.close()


def test_somebody_who_stops_before_there_is_a_seat(far: Far) -> None:
    way = Paths(find("127.0.0.1", far.port), SlowChannel)
    with pytest.raises(JoinError, match=r"stopped \(SIGINT\) before a seat was had"):
        way.call(Caller(), Stop("stopped (SIGINT)"))
    way.close()


def test_nothing_that_was_never_opened_needs_closing(far: Far) -> None:
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
def test_what_is_this_machine(host: str, loopback: bool) -> None:
    found: Server = find(host, 47800)
    assert found.loopback is loopback


def test_a_name_that_nobody_knows() -> None:
    with pytest.raises(JoinError, match=r"check the server's name"):
        find("no-such-host.invalid", 47800)
    with pytest.raises(JoinError, match=r"check the server's name"):
        find("a" * 70 + ".invalid", 47800)


# A flood --------------------------------------------------------------------------------------------------------------


def queued(way: Paths, count: int) -> list[bytes]:
    """Put `count` datagrams before a way's socket, in place of a network's; those that are still there."""
    waiting = [b"%d" % number for number in range(count)]

    class Socket:
        def recv(self, size: int) -> bytes:
            if not waiting:
                raise BlockingIOError
            return waiting.pop(0)

        def send(self, datagram: bytes) -> None: ...
        def close(self) -> None: ...

    way._migration.way.socket.close()
    way._migration.way.socket = Socket()  # type: ignore[assignment]
    return waiting


@pytest.mark.parametrize("count", [MOST_DATAGRAMS - 1, MOST_DATAGRAMS, MOST_DATAGRAMS + 1, 3 * MOST_DATAGRAMS])
def test_a_tick_takes_so_many_datagrams_and_no_more(calls: Make, count: int) -> None:
    way = calls(UnencryptedChannel)
    waiting = queued(way, count)
    taken: list[bytes] = []
    way.drain(0, lambda message, at_ns: taken.append(message), lambda message: False)
    assert len(taken) == min(count, MOST_DATAGRAMS)
    assert way.counted() == ({LEFT: 1} if count >= MOST_DATAGRAMS else {})
    while waiting:
        way.drain(0, lambda message, at_ns: taken.append(message), lambda message: False)
    assert taken == [b"%d" % number for number in range(count)], "nothing is lost, and nothing overtakes"


@pytest.mark.parametrize("count", [MOST_MESSAGES, MOST_MESSAGES + 1, 100])
def test_a_datagram_gives_so_many_messages_and_no_more(far: Far, calls: Make, count: int) -> None:
    class Bundle(UnencryptedChannel):
        def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
            return [datagram] * count

    way = calls(Bundle)
    way.send(b"hello")
    far.say(b"again", far.hear()[1])
    assert arrives(way) == [b"again"] * MOST_MESSAGES
    assert way.counted() == ({TOO_MANY: count - MOST_MESSAGES} if count > MOST_MESSAGES else {})


def test_a_flood_on_the_old_way_leaves_the_new_one_its_turn(far: Far, calls: Make) -> None:
    way = calls(UnencryptedChannel)
    queued(way, 1000)
    way.poll(0, resuming=True)
    way.send(b"hello", hello=True)
    far.say(b"welcome", far.hear()[1])
    until = time.monotonic() + LIMIT_S
    while way._migration.newer is not None:
        assert time.monotonic() < until, "the welcome was not heard"
        way.drain(0, lambda message, at_ns: None, lambda message: message == b"welcome")
