"""Steering: the kernel gives each peer to its worker's socket, all others to the front; what cannot be steered is refused."""

import socket
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from ipaddress import IPv4Address, IPv6Address
from random import Random

import pytest

from cogrip.server.hosting.workers.steering import Steering, open_path, open_public, replaces_safely
from cogrip.server.hosting.workers.steering_program import LEAF, hash_of

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
    steered.steering.refresh()
    assert steered.received(peers) == [0 if number % 2 == 0 else place for number, place in enumerate(places)]


def test_a_peer_that_is_steered_anew_comes_to_its_new_worker_alone(steered: Steered) -> None:
    peer, other = steered.peer(), steered.peer()
    for worker in (0, 2, 2, 1):
        assert steered.steering.add(steered.address(peer), worker)
        assert steered.received([peer, other]) == [worker + 1, 0]
    steered.steering.remove(lambda _: True)
    assert steered.received([peer, other]) == [2, 0], "until the kernel is told"
    steered.steering.refresh()
    assert steered.received([peer, other]) == [0, 0]


def test_a_peer_beyond_the_size_of_a_program_is_refused_and_those_before_stay(ipv4: Steered) -> None:
    first, last, stranger = ipv4.peer(), ipv4.peer(), ipv4.peer()
    assert ipv4.steering.add(ipv4.address(first), 0)
    steered = 1
    while ipv4.steering.add((f"10.{steered >> 16}.{steered >> 8 & 255}.{steered & 255}", 50_000), 1):
        steered += 1
        assert steered < 4096
    assert steered >= 500  # with the optmem_max of older kernels; 1272 of newer ones
    for _ in range(2):
        assert not ipv4.steering.add(ipv4.address(last), 2)
    path = open_path(ipv4.public, ipv4.address(last))  # its own socket, beside the program
    with path:
        path.settimeout(10.0)
        assert ipv4.received([first, last, stranger]) == [1, -1, 0]
        assert path.recv(10) == b"1"
    assert ipv4.received([first, last, stranger]) == [1, 0, 0]
    ipv4.steering.remove(lambda address: address[0] != "127.0.0.1")
    assert ipv4.steering.add(ipv4.address(last), 2), "there is room again"
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


def test_a_bit_of_one_part_of_an_address_is_not_undone_by_one_of_another() -> None:
    """For a plain sum of products the highest bits of two words cancel each other, whatever the secret multiplier."""
    draw = Random(21)
    flips = [
        ((first, high), (second, low))
        for first in range(4)
        for second in range(first)
        for high in (29, 30, 31)
        for low in (29, 30, 31)
    ]
    alike: Counter[object] = Counter()
    for _ in range(300):
        multiplier = draw.randrange(1 << 32) | 1

        def hash_with(*changes: tuple[int, int], multiplier: int = multiplier) -> int:
            words = [0x2001_0DB8, 1, 2, 3]
            for word, bit in changes:
                words[word] ^= 1 << bit
            place = IPv6Address(b"".join(each.to_bytes(4, "big") for each in words))
            return hash_of((str(place), 5, 0, 0), multiplier)

        plain = hash_with()
        alike.update(each for each in flips if hash_with(*each) == plain)
    assert alike.total() <= 2, alike


def test_what_the_kernel_refuses_is_tried_again(ipv4: Steered, monkeypatch: pytest.MonkeyPatch) -> None:
    peer = ipv4.peer()
    assert ipv4.steering.add(ipv4.address(peer), 0)
    ipv4.steering.remove(lambda _: True)
    attach = Steering._attach
    monkeypatch.setattr(Steering, "_attach", raising_once(OSError(12, "no memory"), attach))
    ipv4.steering.refresh()
    assert ipv4.received([peer]) == [1]
    ipv4.steering.refresh()
    assert ipv4.received([peer]) == [0]


def test_a_refusal_that_passes_by_keeps_nobody_out_for_ever(ipv4: Steered, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (ipv4.address(ipv4.peer()) for _ in range(3))
    assert ipv4.steering.add(first, 0)
    monkeypatch.setattr(Steering, "_attach", raising_once(OSError(12, "no memory"), Steering._attach))
    assert not ipv4.steering.add(second, 0)
    assert not ipv4.steering.add(second, 0), "not tried again for now: each try builds a program"
    ipv4.steering.remove(lambda address: address == first)
    assert ipv4.steering.add(second, 0)
    assert ipv4.steering.add(third, 1)


def raising_once(error: OSError, then: Callable[..., None]) -> Callable[..., None]:
    errors = [error]

    def call(*given: object) -> None:
        if errors:
            raise errors.pop()
        then(*given)

    return call


@pytest.mark.parametrize(
    ("release", "safely"),
    [
        ("7.1.0", True), ("7.1", True), ("8.0.3-amd64", True), ("7.0.99", False), ("6.18.36", True), ("6.18.44-fc-v669", True),
        ("6.18.35", False), ("6.17.99", False), ("6.12.48+deb13-amd64", False), ("5.15.210-generic", True),
        ("5.15.0-151-generic", False), ("4.4.0", False), ("", False), ("unknown", False),
    ],
)  # fmt: skip
def test_kernels_that_free_a_program_while_it_runs_get_none(release: str, safely: bool) -> None:
    assert replaces_safely(release) is safely


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
