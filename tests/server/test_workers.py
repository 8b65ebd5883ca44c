"""Parts of a server with several workers: the kernel's steering, the link, answers of several workers as one."""

import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from itertools import count
from typing import Any

import pytest

from cogrip.machine.server_platform import message_pair
from cogrip.machine.stop import Stop
from cogrip.protocol.wire.messages import padded
from cogrip.server.administration.orders import KickOrder, OrderReply, WhoOrder
from cogrip.server.admission.admission import AdmissionServices, Grant
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.core import ServerCore
from cogrip.server.hosting.administration import merged
from cogrip.server.hosting.link import (
    MOST_BYTES,
    Ask,
    Astray,
    Forget,
    HelloByPath,
    LinkEndedError,
    Path,
    ProcessLink,
    Released,
    Say,
    Stray,
)
from cogrip.server.hosting.orders import LinkOrders
from cogrip.server.hosting.workers.channel import WorkerChannel
from cogrip.server.hosting.workers.front import shares
from cogrip.server.hosting.workers.paths import WorkerSockets
from cogrip.server.hosting.workers.steering import Steering, open_path, open_public
from cogrip.server.hosting.workers.verdicts import FrontVerdicts
from cogrip.server.io.datagram_path import DatagramPath
from cogrip.server.rate_limit import RateLimiter

from tests.fair_time import FairTime
from tests.protocol.two_ends import SETTINGS, hello

HOST = "127.0.0.1"
PEERS = 20
FRAME_NS = 7_812_500

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="several workers need Linux")


def taken(end: socket.socket) -> int:
    """Return how many datagrams had come."""
    end.setblocking(False)
    count = 0
    while True:
        try:
            end.recv(100)
        except BlockingIOError:
            return count
        count += 1


class Peers(ExitStack):
    """Makes sockets of peers, and closes them and all else that is entered here."""

    def new(self) -> socket.socket:
        peer = self.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        peer.bind((HOST, 0))
        peer.settimeout(5.0)
        return peer


@pytest.fixture
def peers() -> Iterator[Peers]:
    with Peers() as made:
        yield made


@pytest.fixture
def public(peers: Peers) -> socket.socket:
    return peers.enter_context(open_public(HOST, 0))


class Linked:
    """A worker's sockets at its link, and the front's end of that. by_front: the public address, through which it sends.

    own: this is the worker's own socket there, by which it receives as well
    """

    def __init__(self, by_front: socket.socket | None = None, own: bool = False) -> None:
        self.front, self.link = (ProcessLink(end) for end in message_pair())
        self.verdicts = FrontVerdicts(self.link)
        self.port = WorkerSockets(self.link, Stop(), self.verdicts, LinkOrders(self.link), by_front, own)

    def hand_over(self, public: socket.socket, peer: socket.socket) -> None:
        """Hand over the path of a peer, as the front does."""
        with open_path(public, peer.getsockname()) as path:
            self.front.send(Path(peer.getsockname(), None, False), [path.fileno()])

    def close(self) -> None:
        for each in (self.port, self.front, self.link):
            each.close()


def test_a_peer_with_a_path_is_steered_to_it_and_all_others_to_the_front(public: socket.socket, peers: Peers) -> None:
    all_peers = [peers.new() for _ in range(PEERS)]
    paths = [peers.enter_context(open_path(public, peer.getsockname())) for peer in all_peers[::2]]
    for peer in all_peers:
        peer.sendto(b"a datagram", public.getsockname())
    assert [taken(path) for path in paths] == [1] * len(paths)
    assert taken(public) == PEERS // 2
    for path in paths:  # its worker has ended
        path.close()
    for peer in all_peers:
        peer.sendto(b"a datagram", public.getsockname())
    assert taken(public) == PEERS


def test_a_worker_drops_what_came_to_a_path_before_it_was_connected(peers: Peers) -> None:
    worker = peers.enter_context(closing(Linked()))
    mine, other, path = peers.new(), peers.new(), peers.new()  # alone at its port: all of it comes to this path
    other.sendto(b"forged", path.getsockname())
    path.connect(mine.getsockname())
    mine.sendto(b"a datagram", path.getsockname())
    worker.front.send(Path(mine.getsockname(), None, False), [path.fileno()])
    came = []
    for _ in range(4):
        with suppress(BlockingIOError):
            came.append(worker.port.receive(100, time.monotonic_ns())[:2])
    assert came == [(b"a datagram", mine.getsockname())]
    assert worker.port.dropped == {"of another peer": 1}


@pytest.mark.parametrize("gap_ns", [0, 1, FRAME_NS])
def test_a_worker_receives_from_each_path_in_turn(peers: Peers, public: socket.socket, gap_ns: int) -> None:
    worker = peers.enter_context(closing(Linked()))
    paths = [peers.new() for _ in range(3)]
    for peer in paths:
        worker.hand_over(public, peer)
    now_ns = FRAME_NS

    def received() -> list[tuple[bytes, object]]:
        came = []
        with suppress(BlockingIOError):
            while True:
                came.append(worker.port.receive(100, now_ns)[:2])
        return came

    assert received() == []
    for round_ in range(4):
        talks = paths[: 2 + round_ % 2]  # the third one in every other round
        for number in range(3):
            talks[0].sendto(b"a%d" % number, public.getsockname())
        for peer in talks[1:]:
            peer.sendto(b"b", public.getsockname())
        came = received()
        assert [data for data, who in came if who == talks[0].getsockname()] == [b"a0", b"a1", b"a2"]
        before = came[: came.index((b"a2", talks[0].getsockname()))]
        assert {who for _, who in before} == {peer.getsockname() for peer in talks}, (
            "nobody's third before another's first"
        )
        assert len(came) == len(talks) + 2
        now_ns += gap_ns
    assert received() == []


@pytest.mark.parametrize("at_once", [1, 3, 5, 6, 20])
def test_the_front_and_a_quiet_peer_have_their_turn_where_drains_are_cut_short(
    peers: Peers, public: socket.socket, at_once: int
) -> None:
    """Six busy peers, and so many datagrams taken a frame: a worker that cannot take all of them in still obeys."""
    worker = peers.enter_context(closing(Linked()))
    busy, quiet, now_ns = [peers.new() for _ in range(6)], peers.new(), 0
    for peer in [*busy, quiet]:
        worker.hand_over(public, peer)
    with suppress(BlockingIOError):
        while True:
            worker.port.receive(100, now_ns)
    came: list[bytes] = []
    for frame in range(60):
        now_ns += FRAME_NS
        for peer in busy:
            peer.sendto(b"busy", public.getsockname())
        if frame == 20:
            quiet.sendto(b"quiet", public.getsockname())
            worker.front.send(Ask((HOST, 9), b"hello", Grant("player", "0b9ee21b"), time.monotonic_ns()))
        with suppress(BlockingIOError):
            came.extend(worker.port.receive(100, now_ns)[0] for _ in range(at_once))
    assert b"quiet" in came
    assert b"hello" in came


@pytest.mark.parametrize("by_front", [False, True])
def test_what_a_worker_sends_comes_from_the_public_port(peers: Peers, public: socket.socket, by_front: bool) -> None:
    worker, peer = peers.enter_context(closing(Linked(public if by_front else None))), peers.new()
    worker.hand_over(public, peer)
    with suppress(BlockingIOError):
        worker.port.receive(100, time.monotonic_ns())
    assert worker.port.send_all(deque((peer.getsockname(), bytes([number])) for number in range(70))) == []
    assert [peer.recvfrom(10) for _ in range(70)] == [(bytes([number]), public.getsockname()) for number in range(70)]


def test_a_worker_receives_by_its_own_socket(peers: Peers, public: socket.socket) -> None:
    steering = Steering(public, 2, peers)
    worker = peers.enter_context(closing(Linked(steering.own[1], own=True)))
    seated, alike, later = peers.new(), peers.new(), peers.new()
    for peer in (seated, alike, later):  # of `alike` the worker knows nothing: so it is for an equal hash
        assert steering.add(peer.getsockname(), 1)
    worker.front.send(Path(seated.getsockname(), None, True))
    worker.front.send(Path(later.getsockname(), None, True))

    def received() -> list[tuple[bytes, object]]:
        came = []
        with suppress(BlockingIOError):
            while True:
                came.append(worker.port.receive(100, time.monotonic_ns())[:2])
        return came

    for number, peer in enumerate((seated, alike, later, seated)):
        peer.sendto(b"%d" % number, public.getsockname())
    worker.front.send(Ask((HOST, 9), b"hello", None, time.monotonic_ns()))
    places = {peer: peer.getsockname() for peer in (seated, alike, later)}
    came = [(b"%d" % number, places[peer]) for number, peer in enumerate((seated, alike, later, seated))]
    assert received() == [(b"hello", (HOST, 9)), *came], "the channel knows who has no path"
    assert worker.port.dropped == {}
    worker.port.send(b"at once", places[seated])
    assert worker.port.send_all(deque([(places[later], b"in turn"), (places[seated], b"in turn")])) == []
    assert [each.recvfrom(10) for each in (seated, seated, later)] == [
        (data, public.getsockname()) for data in (b"at once", b"in turn", b"in turn")
    ]
    worker.front.send(Forget(places[later]))
    later.sendto(b"4", public.getsockname())
    assert received() == [(b"4", places[later])]
    assert list(worker.port.renewed) == [places[later]]
    worker.port.send(b"to nobody", places[later])
    assert worker.port.dropped == {"path has gone": 1}
    assert worker.port.overruns() == 0


@pytest.mark.parametrize("at_once", [1, 5])
def test_the_front_has_its_turn_where_a_worker_cannot_take_in_all_that_comes_to_its_own_socket(
    peers: Peers, public: socket.socket, at_once: int
) -> None:
    steering, busy = Steering(public, 1, peers), peers.new()
    worker = peers.enter_context(closing(Linked(steering.own[0], own=True)))
    assert steering.add(busy.getsockname(), 0)
    worker.front.send(Path(busy.getsockname(), None, True))
    came: list[bytes] = []
    for frame in range(10):
        for _ in range(6):
            busy.sendto(b"busy", public.getsockname())
        if frame == 5:
            worker.front.send(Ask((HOST, 9), b"hello", None, time.monotonic_ns()))
        with suppress(BlockingIOError):
            came.extend(worker.port.receive(100, frame * FRAME_NS)[0] for _ in range(at_once))
    assert came.index(b"hello") == 5 * at_once


@pytest.mark.parametrize("at_once", [1, 2, 5])
def test_neither_a_path_of_its_own_nor_the_own_socket_waits_for_ever_for_the_other(
    peers: Peers, public: socket.socket, at_once: int
) -> None:
    steering, steered, apart = Steering(public, 1, peers), peers.new(), peers.new()
    worker = peers.enter_context(closing(Linked(steering.own[0], own=True)))
    assert steering.add(steered.getsockname(), 0)
    worker.front.send(Path(steered.getsockname(), None, True))
    worker.hand_over(public, apart)
    came: list[bytes] = []
    for frame in range(10):
        for _ in range(6):
            steered.sendto(b"steered", public.getsockname())
            apart.sendto(b"apart", public.getsockname())
        with suppress(BlockingIOError):
            came.extend(worker.port.receive(100, frame * FRAME_NS)[0] for _ in range(at_once))
    assert min(came.count(b"steered"), came.count(b"apart")) == 5 * at_once


def test_a_port_that_another_program_has_is_not_shared_until_it_is_free(public: socket.socket) -> None:
    place = public.getsockname()
    with pytest.raises(OSError, match="in use"):
        open_public(*place)
    closing_soon = threading.Timer(0.1, public.close)
    closing_soon.start()
    with open_public(*place, wait_s=10.0) as second:
        assert second.getsockname() == place
    closing_soon.join()


class Served(Linked):
    """A worker with a room of two seats."""

    def __init__(self, own: socket.socket | None = None) -> None:
        super().__init__(own, own is not None)
        services = AdmissionServices(count(100).__next__, self.verdicts, lambda: "ticket", lambda ticket: ticket)
        self.core = ServerCore([SETTINGS], "test", services)
        self.channel = WorkerChannel(self.link, self.port, RateLimiter(bytes(16)), self.core.knows)
        self.path = DatagramPath(self.port, self.channel, self.core, 10**9)

    def ask(self, port: int, **changed: Any) -> None:
        """Let the front ask about somebody's hello, whose token is good."""
        said = padded(hello(**changed))
        self.front.send(Ask((HOST, port), said, Grant("player", "0b9ee21b"), time.monotonic_ns()))

    def turn(self) -> None:
        """Take in what has come, step, and send."""
        now_ns = time.monotonic_ns()
        self.path.drain(now_ns)
        for room in self.core.rooms:
            self.core.tick(room, now_ns)
        self.path.send()

    def said(self) -> list[object]:
        """Return what the front has been told."""
        found: list[object] = []
        with suppress(BlockingIOError):
            while True:
                found.append(self.front.take_at_front())
        return found


@pytest.fixture
def served(peers: Peers) -> Served:
    return peers.enter_context(closing(Served()))


def test_what_is_of_no_path_goes_back_to_the_front_and_what_the_front_gave_does_not(
    public: socket.socket, peers: Peers
) -> None:
    steering, peer = Steering(public, 1, peers), peers.new()
    worker = peers.enter_context(closing(Served(steering.own[0])))
    assert steering.add(peer.getsockname(), 0)
    peer.sendto(b"hello again", public.getsockname())
    peer.sendto(bytes(3000), public.getsockname())
    worker.turn()
    assert worker.said() == [Astray(peer.getsockname(), b"hello again")]
    worker.front.send(Stray(peer.getsockname(), b"hello again"))
    worker.turn()
    assert worker.said() == [Released(peer.getsockname())], "the front takes it for one that is seated here"
    assert worker.channel.dropped["path has gone"] == 1


def test_who_has_no_address_any_more_ends_no_worker(served: Served) -> None:
    served.ask(5, nonce=1)
    served.turn()
    assert served.core.knows((HOST, 5))
    served.front.send(Forget((HOST, 5)))
    served.ask(6, nonce=2, name="ben")
    for _ in range(3):
        served.turn()
    assert served.core.dropped["no address"] == 3, "the seat is kept for who comes back"
    assert served.core.knows((HOST, 6))
    assert not served.channel.send(b"message", None)


def test_a_verdict_is_of_its_own_message_alone(served: Served, public: socket.socket, peers: Peers) -> None:
    for _ in range(2):  # the second one is answered without a look at the verdict
        served.ask(5, nonce=1)
    served.turn()
    peer = peers.new()
    served.hand_over(public, peer)
    served.turn()
    bens = padded(hello(nonce=3, name="ben"))
    peer.sendto(bens, public.getsockname())
    waited = FairTime()
    while not any(isinstance(each, HelloByPath) for each in served.said()):  # the front is asked
        assert waited.spent_s() < 10.0
        served.turn()
    while served.link.send(Say((HOST, 5), bytes(1000))):  # until the link is full
        pass
    peer.sendto(bens, public.getsockname())
    full = served.link.dropped.total()
    while served.link.dropped.total() == full:
        assert waited.spent_s() < 10.0
        served.path.drain(time.monotonic_ns())
    for _ in range(5):
        served.turn()
    peer.setblocking(False)
    with pytest.raises(BlockingIOError):  # no refusal either: it is repeated, and asked about then
        peer.recv(2000)
    assert [seat.state for room in served.core.rooms for seat in room.seats] == ["seated", "free"]
    assert served.verdicts.newest is None


def test_a_link_carries_messages_and_descriptors_and_counts_what_it_cannot() -> None:
    front, worker = (ProcessLink(end) for end in message_pair())
    read, write = socket.socketpair()
    ask = Ask((HOST, 5), b"hello", Grant("player", "0b9ee21b"), 17)
    assert front.send(ask)
    assert front.send(Path((HOST, 5), None, False), [write.fileno()])
    assert worker.take_at_worker() == (ask, [])
    path, (descriptor,) = worker.take_at_worker()
    assert path == Path((HOST, 5), None, False)
    with socket.socket(fileno=descriptor) as handed:
        handed.send(b"by it")
    assert read.recv(10) == b"by it"
    with pytest.raises(BlockingIOError):
        worker.take_at_worker()
    assert not worker.send(Say((HOST, 5), bytes(MOST_BYTES)))
    assert list(worker.dropped) == ["worker's link: Message too long"]
    worker.close()
    with pytest.raises(LinkEndedError):
        front.take_at_front()
    for each in (front, read, write):
        each.close()


def test_rooms_are_divided_in_turn() -> None:
    assert shares(["a", "b", "c", "d", "e"], 2) == [["a", "c", "e"], ["b", "d"]]


def test_answers_of_several_workers_become_one() -> None:
    anna, ben = (RosterEntry(name, room, "", 1.0, 0) for name, room in (("anna", "b"), ("ben", "a")))
    both = [OrderReply(True, "1 in 1 room", (anna,)), OrderReply(True, "1 in 1 room", (ben,))]
    assert merged(WhoOrder(), both, 4) == OrderReply(True, "2 in 4 rooms", (ben, anna))
    here = [OrderReply(False, "nobody here is 'anna'"), OrderReply(True, "anna was kicked")]
    assert merged(KickOrder("anna"), here, 4) == OrderReply(True, "anna was kicked")
    assert not merged(KickOrder("zoe"), here[:1] * 2, 4).ok
    assert not merged(WhoOrder(), [], 4).ok
    silent = OrderReply(False, "room attic has not answered; try again")
    assert merged(WhoOrder(), [silent, silent], 2) == silent, "nobody knows who is there"
    assert merged(WhoOrder(), [both[0], silent], 2).text.endswith("rooms; room attic has not answered; try again")
