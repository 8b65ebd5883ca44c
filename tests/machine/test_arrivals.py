"""Arrival times of datagrams: the kernel's stamp on the loop's own clock, never falling, never after the loop's time."""

import socket
import struct
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from cogrip.machine import arrivals as module
from cogrip.machine.arrivals import Arrivals
from cogrip.machine.platform import system

UTC_NS, MONOTONIC_NS = 1_790_000_000 * 10**9, 50 * 10**9  # the two clocks now
MS = 10**6
ANYBODY = ("127.0.0.1", 4000)


@pytest.fixture
def stamped(monkeypatch: pytest.MonkeyPatch) -> tuple[Arrivals, SimpleNamespace]:
    """Arrivals at a socket with one datagram, stamped with `stamp_ns` [UTC]; None: not stamped."""

    def received(*_: Any) -> tuple[bytes, list[tuple[int, int, bytes]], int, Any]:
        if receiver.stamp_ns is None:
            return b"x", [], 0, ANYBODY
        data = struct.pack("@ll", *divmod(receiver.stamp_ns, 10**9))
        return b"x", [(socket.SOL_SOCKET, module._SO_TIMESTAMPNS, data)], 0, ANYBODY

    receiver = SimpleNamespace(stamp_ns=None, setsockopt=lambda *_: None, recvmsg=received, recvfrom=received)
    monkeypatch.setattr(module, "time", SimpleNamespace(time_ns=lambda: UTC_NS, monotonic_ns=lambda: MONOTONIC_NS))
    monkeypatch.setattr(system, "LINUX", True)
    return Arrivals(receiver), receiver  # type: ignore[arg-type]


def test_a_stamp_is_read_on_the_loops_own_clock_and_without_one_it_is_the_loops_time(
    stamped: tuple[Arrivals, SimpleNamespace],
) -> None:
    arrivals, receiver = stamped
    assert arrivals.receive(100, 123) == (b"x", ANYBODY, 123)
    for age_ms in (7, 5, 5, 1):
        receiver.stamp_ns = UTC_NS - age_ms * MS
        assert arrivals.receive(100, MONOTONIC_NS) == (b"x", ANYBODY, MONOTONIC_NS - age_ms * MS)


def test_no_arrival_is_before_an_earlier_one_or_after_the_loops_time(stamped: tuple[Arrivals, SimpleNamespace]) -> None:
    """Whatever is done to UTC meanwhile, and where a datagram comes while the loop is at it."""
    arrivals, receiver = stamped
    times = []
    for age_ms, now_ms in ((5, 0), (3_600_000, 0), (4, 0), (-3_600_000, 0), (8, 2), (0, 1)):
        receiver.stamp_ns = UTC_NS - age_ms * MS
        now_ns = MONOTONIC_NS + now_ms * MS
        times.append(arrivals.receive(100, now_ns)[2])
        assert times[-1] <= now_ns
    assert times == sorted(times)
    assert [MONOTONIC_NS - at_ns for at_ns in times] == [5 * MS, 5 * MS, 4 * MS, 0, 0, 0]


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel gives no arrival times here")
def test_the_kernel_stamps_every_datagram_of_a_real_socket_in_order() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        receiver.bind(("127.0.0.1", 0))
        receiver.setblocking(False)
        sender.bind(("127.0.0.1", 0))
        arrivals = Arrivals(receiver)
        for number in range(5):
            sender.sendto(bytes([number]), receiver.getsockname())
        far_ns = 2**62  # the loop's time bounds nothing here
        came = [arrivals.receive(100, far_ns) for _ in range(5)]
        assert [(data, address) for data, address, _ in came] == [(bytes([n]), sender.getsockname()) for n in range(5)]
        times = [at_ns for _, _, at_ns in came]
        assert times == sorted(times)
        assert 0 < times[-1] < far_ns, "stamped, each of them"
        with pytest.raises(BlockingIOError):
            arrivals.receive(100, far_ns)
        assert arrivals.poll(100, far_ns) is None
        sender.sendto(b"one more", receiver.getsockname())
        found = arrivals.poll(100, far_ns)
        assert found is not None
        assert found[:2] == (b"one more", sender.getsockname())
        assert times[-1] <= found[2] < far_ns


@pytest.mark.parametrize("there", [False, True])
def test_a_socket_with_nothing_is_not_asked_for_a_datagram(
    stamped: tuple[Arrivals, SimpleNamespace], monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    arrivals, _ = stamped
    monkeypatch.setattr(system, "arrival_check", lambda receiver: lambda: there)
    monkeypatch.setattr(arrivals, "receive", lambda most_bytes, now_ns: (b"asked", None, now_ns))
    assert arrivals.poll(100, 7) == ((b"asked", None, 7) if there else None)
