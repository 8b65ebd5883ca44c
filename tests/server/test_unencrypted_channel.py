"""Unencrypted channel: of unauthenticated peers only hellos pass."""

from itertools import count

import msgpack  # type: ignore[import-untyped]
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.secure.channel import Address
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import HELLO_BYTES, MAX_DATAGRAM_BYTES, Heartbeat, Stamp
from cogrip.protocol.wire.session import make_hello
from cogrip.server.rate_limit import Budget, Limits, RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener, looks_like_hello

ANNA, BEN = ("10.0.0.1", 4001), ("10.0.0.2", 4002)
WAVE = messages.encode(Heartbeat(5, Stamp(1)))
HELLO = messages.padded(
    make_hello(software="test", nonce=1, room="", name="", digest="", device="sim:ideal", axes=1, rate_hz=1024.0)
)
LIMITS = Limits(Budget(20, 5), Budget(300, 8), Budget(1, 1), Budget(100, 10))


def authenticator(*seated: Address) -> UnencryptedListener:
    return UnencryptedListener(RateLimiter(b"s", LIMITS), seated.__contains__)


def test_of_unauthenticated_peers_only_hellos_pass() -> None:
    listener = authenticator(BEN)
    assert listener.receive(WAVE, ANNA, 0) == ()
    assert listener.receive(HELLO[:-1], ANNA, 0) == ()
    assert listener.receive(HELLO, ANNA, 0) == (HELLO,)
    for longest in (WAVE, bytes(MAX_DATAGRAM_BYTES), b"x"):
        assert listener.receive(longest, BEN, 0) == (longest,)
    assert listener.receive(bytes(MAX_DATAGRAM_BYTES + 1), BEN, 0) == ()
    assert listener.receive(b"", BEN, 0) == ()
    assert listener.dropped == {"unauthenticated": 2, "too large": 1, "empty": 1}


def test_hellos_have_budgets_by_address_and_in_all() -> None:
    listener = authenticator()
    assert sum(len(listener.receive(HELLO, ANNA, 0)) for _ in range(6)) == 5
    assert (
        sum(len(listener.receive(HELLO, (f"10.1.1.{number}", 1), 0)) for number in range(10)) == 7
    )  # and Anna was new
    assert listener.dropped == {"address budget": 1, "contact budget": 3}


def test_a_seated_peer_has_a_budget_of_its_own_whoever_shares_its_address() -> None:
    slot = RateLimiter(b"s", LIMITS)._peer_slot  # differs from process to process
    other = next((ANNA[0], port) for port in count(4002) if slot((ANNA[0], port)) != slot(ANNA))
    listener = authenticator(ANNA, other)
    assert sum(len(listener.receive(WAVE, ANNA, 0)) for _ in range(30)) == 10
    assert listener.dropped == {"flood of a peer": 20}
    assert listener.receive(WAVE, other, 0) == (WAVE,)
    assert listener.receive(HELLO, ("10.3.3.3", 1), 0) == (HELLO,)


def test_sending_is_not_held_back() -> None:
    listener = authenticator()
    assert listener.ready(ANNA)
    assert listener.send(WAVE, ANNA)
    listener.poll(0)
    listener.close(ANNA)
    assert list(listener.outbox) == [(ANNA, WAVE)]
    assert not listener.failed


@given(
    version=st.integers(0, 2**32),
    others=st.lists(
        st.one_of(st.integers(0, 2**60), st.text(max_size=20), st.floats(), st.binary(max_size=30)), max_size=40
    ),
)
def test_hellos_of_other_versions_pass_by_their_beginning(version: int, others: list[object]) -> None:
    """Written by another MessagePack library; how many fields there are does not matter."""
    fields = [1, "cogrip", version, "other", 5, *others]
    datagram = msgpack.packb([*fields, b"\x00" * HELLO_BYTES])
    assert looks_like_hello(datagram)
    assert not looks_like_hello(datagram[: HELLO_BYTES - 1])
    assert looks_like_hello(datagram[:HELLO_BYTES])
    assert not looks_like_hello(msgpack.packb([2, *fields[1:], b"\x00" * HELLO_BYTES]))
    assert not looks_like_hello(msgpack.packb([1, "cogrop", *fields[2:], b"\x00" * HELLO_BYTES]))


@pytest.mark.parametrize(
    "datagram",
    [
        b"\x16\xfe\xff" + bytes(1100),  # begins a hello of DTLS
        bytes(1100),
        b"\x9f" * 1100,
        b"\xdc" * 1100,
        b"\xdc\x00\x10\x01\xa6cogri" + bytes(1100),
    ],
)
def test_what_does_not_look_like_a_hello(datagram: bytes) -> None:
    listener = authenticator()
    assert listener.receive(datagram, ANNA, 0) == ()
    assert listener.dropped == {"unauthenticated": 1}
    assert not listener.outbox
