"""Steering: the kernel gives each peer to its worker's socket, all others to the front; what cannot be steered is refused."""

import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from ipaddress import IPv4Address
from random import Random

import pytest

from cogrip.server.io.workers.steering import Steering, open_path, open_public
from cogrip.server.io.workers.steering_program import LEAF, hash_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="several workers need Linux")

WORKERS = 3
PLACES = {"IPv4": ("127.0.0.1", "127.0.0.1"), "IPv6": ("::1", "::1"), "IPv4 at a socket of both": ("::", "127.0.0.1")}


class Steered:
    """A public port with its workers' sockets, and peers that send to it."""

    def __init__(self, stack: ExitStack, host: str, peers_at: str) -> None:
        try:
            self.public = stack.enter_context(open_public(host, 0))
        except OSError:
            pytest.skip(f"no {host} here")
        self.steering = Steering(self.public, WORKERS, stack)
        self._stack, self._host = stack, peers_at
        self._family = socket.AF_INET6 if ":" in peers_at else socket.AF_INET
        self._mapped = self.public.family != self._family

    def peer(self) -> socket.socket:
        made = self._stack.enter_context(socket.socket(self._family, socket.SOCK_DGRAM))
        made.bind((self._host, 0))
        return made

    def address(self, peer: socket.socket) -> tuple[str | int, ...]:
        """Return a peer's address as the public socket gives it."""
        place: tuple[str | int, ...] = peer.getsockname()
        return (f"::ffff:{place[0]}", place[1], 0, 0) if self._mapped else place

    def received(self, peers: list[socket.socket]) -> list[int]:
        """Let each peer send a datagram, and return where it came: 0 the front, from 1 on the workers."""
        for number, peer in enumerate(peers):
            peer.sendto(b"%d" % number, (self._host, self.public.getsockname()[1]))
        found = [-1] * len(peers)
        for place, end in enumerate([self.public, *self.steering.own]):
            with suppress(BlockingIOError):
                while True:
                    datagram, sender = end.recvfrom(100)
                    assert sender == self.address(peers[int(datagram)])
                    found[int(datagram)] = place
        return found


@pytest.fixture(params=PLACES.values(), ids=list(PLACES))
def steered(request: pytest.FixtureRequest) -> Iterator[Steered]:
    with ExitStack() as stack:
        yield Steered(stack, *request.param)


@pytest.fixture
def ipv4() -> Iterator[Steered]:
    with ExitStack() as stack:
        yield Steered(stack, *PLACES["IPv4"])


@pytest.mark.parametrize("count", [0, 1, 2, LEAF, LEAF + 1, 2 * LEAF + 1, 100])
def test_each_peer_comes_to_its_worker_and_whoever_is_not_steered_to_the_front(steered: Steered, count: int) -> None:
    peers, others = [steered.peer() for _ in range(count)], [steered.peer() for _ in range(10)]
    places = [number % WORKERS + 1 for number in range(count)]
    assert steered.received([*peers, *others]) == [0] * (count + 10)
    for peer, place in zip(peers, places, strict=True):
        assert steered.steering.add(steered.address(peer), place - 1)
    assert steered.received([*peers, *others]) == [*places, *[0] * 10]
    gone = {steered.address(peer) for peer in peers[::2]}
    steered.steering.remove(lambda address: address in gone)
    assert steered.received(peers) == [0 if number % 2 == 0 else place for number, place in enumerate(places)]


def test_a_peer_that_is_steered_anew_comes_to_its_new_worker_alone(steered: Steered) -> None:
    peer, other = steered.peer(), steered.peer()
    for worker in (0, 2, 2, 1):
        assert steered.steering.add(steered.address(peer), worker)
        assert steered.received([peer, other]) == [worker + 1, 0]
    steered.steering.remove(lambda _: True)
    assert steered.received([peer, other]) == [0, 0]


def test_a_peer_beyond_the_size_of_a_program_is_refused_and_those_before_stay(ipv4: Steered) -> None:
    first, last, stranger = ipv4.peer(), ipv4.peer(), ipv4.peer()
    assert ipv4.steering.add(ipv4.address(first), 0)
    steered = 1
    while ipv4.steering.add((f"10.{steered >> 16}.{steered >> 8 & 255}.{steered & 255}", 50_000), 1):
        steered += 1
        assert steered < 4096
    assert steered >= 500  # with the optmem_max of older kernels; 1272 of newer ones
    assert not ipv4.steering.add(ipv4.address(last), 2)
    path = open_path(ipv4.public, ipv4.address(last))  # its own socket, beside the program
    with path:
        path.settimeout(10.0)
        assert ipv4.received([first, last, stranger]) == [1, -1, 0]
        assert path.recv(10) == b"1"
    assert ipv4.received([first, last, stranger]) == [1, 0, 0]
    ipv4.steering.remove(lambda address: address[0] != "127.0.0.1")
    assert ipv4.steering.add(ipv4.address(last), 2)
    assert ipv4.received([first, last, stranger]) == [1, 3, 0]


def test_of_two_peers_with_one_hash_the_second_is_refused_and_its_leaving_changes_nothing(ipv4: Steered) -> None:
    met: dict[int, tuple[str, int]] = {}
    multiplier = ipv4.steering._multiplier
    draw = Random(21)
    for _ in range(1 << 20):
        second = (str(IPv4Address(draw.randrange(1 << 32))), draw.randrange(1 << 16))
        found = hash_of(second, multiplier)
        if found in met:
            break
        met[found] = second
    else:
        pytest.fail("no two addresses of a million have one hash of 31 bits")
    first = met[found]
    assert ipv4.steering.add(first, 0)
    assert not ipv4.steering.add(second, 0)
    assert not ipv4.steering.add(second, 1)
    ipv4.steering.remove(lambda address: address == second)
    assert not ipv4.steering.add(second, 1)
    ipv4.steering.remove(lambda address: address == first)
    assert ipv4.steering.add(second, 1)


def test_a_host_that_is_no_number_is_refused(ipv4: Steered) -> None:
    assert not ipv4.steering.add(("localhost", 5), 0)


def test_where_the_kernel_takes_no_program_the_port_stays_as_it_was() -> None:
    with (
        ExitStack() as stack,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as alone,
    ):  # it shares its port with nobody
        alone.bind(("127.0.0.1", 0))
        with pytest.raises(OSError, match=r"Invalid argument|not supported|not available"):
            Steering(alone, WORKERS, stack)
