"""Arrival times of datagrams on a real socket: between the sending and the receiving, never falling."""

import socket
import sys
import time

import pytest

from cogrip.protocol.io.arrivals import Arrivals


@pytest.fixture
def ends():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        receiver.bind(("127.0.0.1", 0))
        receiver.setblocking(False)
        sender.bind(("127.0.0.1", 0))
        yield Arrivals(receiver), sender, receiver.getsockname()


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel gives no arrival times here")
def test_a_datagram_came_after_it_was_sent_and_before_what_came_later(ends) -> None:
    arrivals, sender, address = ends
    sent = []
    for number in range(5):
        sent.append(time.monotonic_ns())
        sender.sendto(bytes([number]), address)
    came = [arrivals.receive(100, time.monotonic_ns() + 10**9) for _ in range(5)]
    assert [data for data, _, _ in came] == [bytes([number]) for number in range(5)]
    assert [sender_address for _, sender_address, _ in came] == [sender.getsockname()] * 5
    times = [at_ns for _, _, at_ns in came]
    assert times == sorted(times)
    slack_ns = 1_000_000  # by which UTC may be slewed meanwhile; a pause between reading the clocks only makes it later
    assert all(one - slack_ns <= at_ns for one, at_ns in zip(sent, times, strict=True))
    assert times[-1] <= time.monotonic_ns()


def test_none_came_after_the_time_that_the_loop_goes_by(ends) -> None:
    arrivals, sender, address = ends
    now_ns = time.monotonic_ns()
    sender.sendto(b"x", address)
    assert arrivals.receive(100, now_ns)[2] == now_ns
    with pytest.raises(BlockingIOError):
        arrivals.receive(100, now_ns)


def test_where_the_kernel_stamps_nothing_it_is_the_loops_time(ends) -> None:
    arrivals, sender, address = ends
    arrivals._stamped = False
    sender.sendto(b"x", address)
    assert arrivals.receive(100, 123) == (b"x", sender.getsockname(), 123)
