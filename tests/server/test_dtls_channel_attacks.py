"""People on the way and off it: replays, changed and cut records, forged ones, alerts, answers to forged addresses."""

import random
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from OpenSSL.SSL import _lib  # type: ignore[attr-defined]

from cogrip.protocol.io.dtls import Association, client_context, is_client_hello
from cogrip.protocol.io.dtls_session import DtlsSession
from cogrip.protocol.secure.channel import PEER
from cogrip.server.io.dtls_channel import WAITS_NS

from tests.dtls_peer.records import CLIENT_HELLO, HANDSHAKE, Record, whole
from tests.recorded_end import flipped
from tests.server.encrypted_network import ANNA, BEN, Wire
from tests.server.fuzzed_channels import DOORS, mutated

MALLORY = ("10.66.6.6", 666)


def test_whole_sessions_played_again_deliver_nothing(wire: Wire) -> None:
    wire.seal(ANNA)
    for _ in range(20):
        wire.talk(ANNA)
    log, heard, said = list(wire.log), len(wire.heard), len(wire.answers[ANNA])
    chance = random.Random(1)
    for address in (ANNA, BEN, MALLORY):
        for order in (log, log[::-1], chance.sample(log, len(log))):
            for to_server, _, datagram in order:
                if to_server:
                    wire.inject(datagram, address)
                elif address == ANNA:
                    assert wire.calls[ANNA].receive(datagram, PEER, wire.now_ns) == ()
            wire.rest(0.05)
    assert len(wire.heard) == heard
    assert len(wire.answers[ANNA]) == said
    assert wire.listener.counts()["open"] == 1
    wire.talk(ANNA)
    wire.rest(WAITS_NS / 1e9 + 0.1)
    assert wire.listener.counts() == {"open": 1, "half open": 0}
    assert not wire.listener.renewed
    wire.talk(ANNA)


def test_a_session_played_again_after_it_ended_begins_no_new_one(wire: Wire) -> None:
    """The hello's cookie may still fit; what follows it was made for other keys."""
    call = wire.seal(ANNA)
    wire.talk(ANNA)
    log = list(wire.log)
    call.close(PEER)
    wire.rest()
    del wire.calls[ANNA]
    heard = len(wire.heard)
    for to_server, _, datagram in log:
        if to_server:
            wire.inject(datagram, ANNA)
            wire.rest(0.02)
    assert wire.listener.counts()["open"] == 0
    assert len(wire.heard) == heard
    wire.rest(WAITS_NS / 1e9 + 0.1)
    assert wire.listener.counts() == {"open": 0, "half open": 0}


def both_ways(wire: Wire) -> list[tuple[bytes, Callable[[bytes], Sequence[bytes]]]]:
    """A record that each end has yet to see, and how to hand it over."""
    call = wire.calls[ANNA]
    up, down = wire.record(b"m" * 60), wire.answer(b"m" * 60)

    def to_client(datagram: bytes) -> Sequence[bytes]:
        return call.receive(datagram, PEER, wire.now_ns)

    return [(up, lambda datagram: wire.inject(datagram, ANNA)), (down, to_client)]


def test_a_record_with_any_bit_flipped_or_cut_at_any_length_delivers_nothing(wire: Wire) -> None:
    call = wire.seal(ANNA)
    for record, feed in both_ways(wire):
        changed = [flipped(record, at, 1 << bit) for at in range(len(record)) for bit in range(8)]
        cut = [part for size in range(1, len(record)) for part in (record[:size], record[size:])]
        assert not any(feed(datagram) for datagram in [*changed, b"", *cut])
        assert list(feed(record)) == [b"m" * 60]  # none of them took its place in the window
        assert list(feed(record)) == []
    assert not call.failed
    wire.talk(ANNA)


def test_what_follows_a_record_in_its_datagram_is_inspected_by_itself(wire: Wire) -> None:
    wire.seal(ANNA)
    one, two, three = wire.record(b"one"), wire.record(b"two"), wire.record(b"three")
    assert list(wire.inject(one + b"\x00junk", ANNA)) == [b"one"]
    assert list(wire.inject(two + one + three, ANNA)) == [b"two", b"three"]
    wire.talk(ANNA)


@pytest.mark.parametrize("handed_over", [False, True])
def test_a_forged_number_behind_a_true_record_makes_nobody_deaf(wire: Wire, handed_over: bool) -> None:
    wire.seats.clear()
    wire.seal(ANNA)
    true = wire.record(b"hello")
    forged = true[:5] + b"\xff" * 6 + true[11:]
    assert list(wire.inject(true + forged, ANNA)) == [b"hello"]
    if handed_over:
        keys = wire.listener.hand_over(ANNA, b"welcome")
        assert keys is not None
        assert DtlsSession(keys).receive(wire.record(b"next")) == [b"next"]
    else:
        wire.seats.add(ANNA)
        wire.talk(ANNA)


BODIES = (b"", b"\x01", b"\x02\x28", b"\x01\x00", bytes(8), b"\x0e" + bytes(11), b"\x14" + bytes(40), bytes(300))
FORGED = [
    Record(kind, epoch, number, body).encode()
    for kind in (20, 21, 22, 23, 24, 25)
    for epoch in (0, 1, 2, 0xFFFF)
    for number in (0, 1, 5, 2**47)
    for body in BODIES
]


def test_forged_records_from_the_right_address_do_nothing(wire: Wire) -> None:
    """Alerts, a change of ciphers, handshake messages, data: without the keys none of it counts."""
    call = wire.seal(ANNA)
    for datagram in FORGED:
        assert wire.inject(datagram, ANNA) == ()
        assert call.receive(datagram, PEER, wire.now_ns) == ()
    wire.rest()
    assert not call.failed
    assert wire.listener.counts() == {"open": 1, "half open": 0}
    wire.talk(ANNA)
    assert not wire.listener.events


def test_forged_records_amid_a_handshake_cost_that_handshake_at_most(folder: Path) -> None:
    """Until there are keys, an alert can be anyone's: the call begins anew."""
    for seed in range(6):
        wire, chance = Wire(folder), random.Random(seed)
        wire.seal(BEN)
        call = wire.call(ANNA)
        for _ in range(4):
            wire.step(4_000_000)
            for datagram in chance.sample(FORGED, 20):
                wire.inject(datagram, ANNA)
        wire.until(lambda wire=wire, call=call: call.ready(PEER) and wire.listener.ready(ANNA))  # type: ignore[misc]
        wire.talk(ANNA)
        wire.talk(BEN)


def test_unauthenticated_peers_get_no_state_and_no_answer_longer_than_their_request(folder: Path) -> None:
    chance = random.Random(5)
    call = Association(client_context("0" * 64, lambda _: None))
    call.connect()
    (hello,) = call.pop_datagrams()
    assert is_client_hello(hello)
    wire = Wire(folder)
    answered = 0
    for number in range(5000):
        datagram = mutated(chance, hello, [hello]) if number else hello
        wire.inject(datagram, (f"10.1.{number >> 8}.{number & 255}", 1000))
        sent = sum(len(answer) for _, answer in wire.listener.outbox)
        answered += bool(sent)
        wire.listener.outbox.clear()
        assert sent <= len(datagram)
    assert answered > 500
    assert wire.listener.counts() == {"open": 0, "half open": 0}
    assert _lib.ERR_peek_error() == 0


def test_shortest_hello_gets_no_more_than_it_brought(folder: Path) -> None:
    body = b"\xfe\xfd" + bytes(32) + b"\x00" + b"\x00" + b"\x00\x02\xc0\x2b" + b"\x01\x00"
    hello = Record(HANDSHAKE, 0, 0, whole(CLIENT_HELLO, 0, body).encode()).encode()
    wire = Wire(folder)
    wire.inject(hello, MALLORY)
    ((_, cookie),) = wire.listener.outbox
    assert len(cookie) <= len(hello)


def test_a_failure_of_one_peer_disturbs_no_other(wire: Wire) -> None:
    """OpenSSL keeps its errors in one place for all of them."""
    wire.seal(BEN)
    for number in range(20):
        bad = wire.call(("10.2.0.1", number), fingerprint="1" * 64)
        wire.until(lambda bad=bad: bad.failed)  # type: ignore[misc]
        assert _lib.ERR_peek_error() == 0
        for datagram in FORGED[number::20]:
            wire.inject(datagram, BEN)
            wire.inject(datagram, ("10.2.0.1", number))
        assert _lib.ERR_peek_error() == 0
        wire.talk(BEN)


@pytest.mark.parametrize(
    ("door", "datagrams", "seed"), [("sealed", 25_000, 1), ("open", 5_000, 2), ("plain", 20_000, 3), ("call", 5_000, 4)]
)
def test_fuzzed_datagrams_bring_nothing_about(folder: Path, door: str, datagrams: int, seed: int) -> None:
    DOORS[door](datagrams, folder, seed)
