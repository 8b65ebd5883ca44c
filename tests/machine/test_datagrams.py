"""Datagrams of a socket, one by one and in batches: both forms give the same."""

import importlib
import importlib.util
import socket
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from cogrip.machine.arrivals import Arrivals
from cogrip.machine.datagrams import BATCH, Datagrams, open_arrivals, open_datagrams
from cogrip.protocol.secure.channel import Address

from tests.fair_time import FairTime

FORMS = ["one by one", "batches"]
LIMIT_S = 10.0


def ends_of(form: str, own: socket.socket, few_peers: bool = False) -> Any:
    if form == "one by one":
        return Arrivals(own) if few_peers else Datagrams(own)
    if importlib.util.find_spec(BATCH) is None:
        pytest.skip("datagram_batch is not compiled (`python3 dev.py compile`)")
    made = open_arrivals(own) if few_peers else importlib.import_module(BATCH).DatagramBatch(own)
    assert not isinstance(made, Arrivals)
    return made


@pytest.fixture(params=[(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")], ids=["IPv4", "IPv6"])
def sockets(request: pytest.FixtureRequest) -> Iterator[tuple[socket.socket, socket.socket]]:
    family, host = request.param
    with socket.socket(family, socket.SOCK_DGRAM) as own, socket.socket(family, socket.SOCK_DGRAM) as other:
        try:
            own.bind((host, 0))
            other.bind((host, 0))
        except OSError:
            pytest.skip(f"no {host} here")
        own.setblocking(False)
        other.settimeout(LIMIT_S)
        yield own, other


def received(ends: Any, count: int) -> list[tuple[bytes, Address, int]]:
    found: list[tuple[bytes, Address, int]] = []
    waited = FairTime()
    while len(found) < count and waited.spent_s() < LIMIT_S:
        try:
            found.append(ends.receive(1233, time.monotonic_ns()))
        except BlockingIOError:
            continue
    return found


@pytest.mark.parametrize("few_peers", [False, True])
@pytest.mark.parametrize("form", FORMS)
def test_datagrams_come_whole_and_in_order_with_their_sender(
    form: str, few_peers: bool, sockets: tuple[socket.socket, socket.socket]
) -> None:
    own, other = sockets
    ends = ends_of(form, own, few_peers)
    with socket.socket(own.family, socket.SOCK_DGRAM) as third:
        third.bind((own.getsockname()[0], 0))
        begun_ns = time.monotonic_ns()
        sent = [(each, bytes([number]) * number) for number in range(45) for each in (other, other, third)]
        for sender, datagram in sent:
            sender.sendto(datagram, own.getsockname())
        found = received(ends, len(sent))
        assert [(address, datagram) for datagram, address, _ in found] == [
            (sender.getsockname(), datagram) for sender, datagram in sent
        ]
    stamps = [arrived_ns for _, _, arrived_ns in found]
    assert stamps == sorted(stamps)
    assert begun_ns - 50_000_000 <= stamps[0] <= time.monotonic_ns()
    with pytest.raises(BlockingIOError):
        ends.receive(1233, time.monotonic_ns())
    assert not few_peers or ends.poll(1233, time.monotonic_ns()) is None
    other.sendto(bytes(1300), own.getsockname())
    ((longest, _, _),) = received(ends, 1)
    assert len(longest) == 1233, "as much as was asked for"


@pytest.mark.parametrize("form", FORMS)
def test_a_peer_from_which_nothing_came_is_sent_to(form: str, sockets: tuple[socket.socket, socket.socket]) -> None:
    own, other = sockets
    ends = ends_of(form, own)
    outbox: deque[tuple[Address, bytes]] = deque([(other.getsockname(), b"first"), (other.getsockname(), b"second")])
    assert ends.send_all(outbox) == []
    assert [other.recvfrom(16) for _ in range(2)] == [(b"first", own.getsockname()), (b"second", own.getsockname())]
    here = ("localhost", other.getsockname()[1]) if own.family == socket.AF_INET else other.getsockname()
    assert ends.send_all(deque([(here, b"by name")])) == []
    assert other.recv(16) == b"by name"


@pytest.mark.parametrize("form", FORMS)
def test_all_of_a_queue_is_sent_but_what_the_system_refuses_which_is_returned(
    form: str, sockets: tuple[socket.socket, socket.socket]
) -> None:
    own, other = sockets
    ends = ends_of(form, own)
    other.sendto(b"known", own.getsockname())
    ((_, address, _),) = received(ends, 1)
    for place in (address, other.getsockname()):
        outbox: deque[tuple[Address, bytes]] = deque((place, bytes([number])) for number in range(130))
        assert ends.send_all(outbox) == []
        assert not outbox
        assert [other.recv(16) for _ in range(130)] == [bytes([number]) for number in range(130)]
    (refused,) = ends.send_all(deque([(address, b"1"), (address, bytes(70_000)), (address, b"2")]))
    assert "long" in refused.lower()
    assert [other.recv(16), other.recv(16)] == [b"1", b"2"]


def test_a_bound_socket_gets_the_form_that_is_there(sockets: tuple[socket.socket, socket.socket]) -> None:
    ends = open_datagrams(sockets[0])
    assert isinstance(ends, Datagrams) is (importlib.util.find_spec(BATCH) is None)


def link_local() -> tuple[str, int] | None:
    """Return an address of this machine that is valid on one link alone, and that link's number."""
    with suppress(OSError), open("/proc/net/if_inet6", encoding="ascii") as known:
        for line in known:
            digits, number, _, scope, *_ = line.split()
            if scope == "20":
                return socket.inet_ntop(socket.AF_INET6, bytes.fromhex(digits)), int(number, 16)
    return None


@pytest.mark.parametrize("few_peers", [False, True])
@pytest.mark.parametrize("form", FORMS)
def test_an_address_of_a_link_is_as_the_socket_gives_it(form: str, few_peers: bool) -> None:
    if (place := link_local()) is None:
        pytest.skip("this machine has no address of a link (IPv6)")
    with ExitStack() as stack:
        own, plain, other = (stack.enter_context(socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)) for _ in range(3))
        for each in (own, plain, other):
            each.bind((place[0], 0, 0, place[1]))
        own.setblocking(False)
        plain.settimeout(LIMIT_S)
        for each in (own, plain):
            other.sendto(b"a datagram", each.getsockname())
        ends = ends_of(form, own, few_peers)
        ((_, address, _),) = received(ends, 1)
        assert address == plain.recvfrom(100)[1]
        if not few_peers:
            assert ends.send_all(deque([(address, b"an answer")])) == []
            other.settimeout(LIMIT_S)
            assert other.recv(100) == b"an answer"
