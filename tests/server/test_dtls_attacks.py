"""An independent DTLS peer at a server's channel, in virtual time: it joins, and it attacks.

Records and handshake are `tests.dtls_peer`'s, so that both ends never have the same error.
"""

from collections.abc import Callable
from pathlib import Path

import pytest
from OpenSSL.SSL import _lib  # type: ignore[attr-defined]

from cogrip.protocol.secure.channel import PEER, Address
from cogrip.server.io import dtls_channel as sealed_channel
from cogrip.server.io.dtls_channel import HELLO_WAITS_NS, MOST_REPEATS, MOST_SHAKING, MOST_UNSEATED, WAITS_NS

from tests.dtls_peer.attack import ATTACKS, HalfOpen
from tests.dtls_peer.client import DtlsPeer, PeerError
from tests.dtls_peer.records import (
    ALERT,
    APPLICATION_DATA,
    CHANGE_CIPHER_SPEC,
    CLIENT_HELLO,
    CLIENT_KEY_EXCHANGE,
    FINISHED,
    HANDSHAKE,
    SUITES,
    Fragment,
    Suite,
    decode_records,
    whole,
)
from tests.server.encrypted_network import ANNA, BEN, FAULTS, Wire

MALLORY: Address = ("10.66.6.6", 666)


def call(wire: Wire, peer: DtlsPeer, address: Address = ANNA) -> DtlsPeer:
    wire.calls[address] = peer  # type: ignore[assignment]
    wire.answers.setdefault(address, [])
    return peer


def joined(wire: Wire, address: Address = ANNA, suites: tuple[Suite, ...] = SUITES) -> DtlsPeer:
    peer = call(wire, DtlsPeer(wire.listener.fingerprint, suites), address)
    wire.until(lambda: peer.ready() and wire.listener.ready(address))
    return peer


def halted(wire: Wire, address: Address = MALLORY) -> HalfOpen:
    """Its handshake stands after the server's flight."""
    peer = HalfOpen()
    call(wire, peer, address)
    wire.until(lambda: peer.halted)
    return peer


def goes_on(wire: Wire, peer: DtlsPeer, address: Address = MALLORY) -> None:
    """It comes to an end with its handshake, and talks."""
    wire.until(lambda: peer.ready() and wire.listener.ready(address))
    wire.talk(address)


def put(wire: Wire, *datagrams: bytes, address: Address = MALLORY) -> None:
    for datagram in datagrams:
        wire.inject(datagram, address)
    wire.rest(0.03)


@pytest.mark.parametrize("suite", SUITES, ids=lambda suite: f"{suite.number:04x}")
def test_it_joins_with_every_suite(wire: Wire, suite: Suite) -> None:
    peer = joined(wire, suites=(suite,))
    for _ in range(20):
        wire.talk()
    assert not peer.dropped
    peer.close()
    wire.rest()
    ended = {"not authentic": 1, "association ended: the other end closed the DTLS association": 1}
    assert wire.listener.dropped == {"cookie sent": 1, **ended}


def test_it_knows_the_server_by_its_certificate(wire: Wire) -> None:
    call(wire, DtlsPeer("0" * 64))
    with pytest.raises(PeerError, match="another certificate"):
        wire.rest()


@pytest.mark.parametrize("number", [0, 1, 2, 4, 5])  # 3 is repeated by OpenSSL's own timer, on the machine's clock
@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault != "pass"])
def test_any_datagram_of_its_handshake_may_be_lost_doubled_or_late(folder: Path, number: int, fault: str) -> None:
    """It repeats a flight after a second, as the standard asks; the server's last one as well, by its own last one."""
    wire = Wire(folder, fault=lambda nth: fault if nth == number else "pass")
    peer = call(wire, DtlsPeer(wire.listener.fingerprint))
    wire.until(peer.ready)
    assert peer.repeats == (fault == "drop")
    wire.rest(1.0)
    wire.talk()


@pytest.mark.parametrize("order", [(2, 1, 0), (1, 0, 2), (0, 2, 1), (2, 0, 1)])
def test_a_last_flight_whose_records_come_in_another_order(wire: Wire, order: tuple[int, ...]) -> None:
    peer = halted(wire, ANNA)
    DtlsPeer.answer_server_hello(peer)
    apart = [record.encode() for record in decode_records(peer.outbox.pop()[1])]
    put(wire, *[apart[each] for each in order], address=ANNA)
    peer._repeat_ns = wire.now_ns + 1_000_000_000
    goes_on(wire, peer, ANNA)  # by its flight once more, in order


def test_its_last_flight_is_answered_again_a_few_times_and_not_longer_than_it_is(folder: Path) -> None:
    wire = Wire(folder, fault=lambda nth: "drop" if nth == 5 else "pass")
    peer = call(wire, DtlsPeer(wire.listener.fingerprint))
    wire.until(lambda: wire.listener.ready(ANNA))
    del wire.calls[ANNA]
    answers = 0
    for _ in range(MOST_REPEATS + 3):
        peer.put_flight()
        query = peer.outbox.pop()[1]
        wire.inject(query, ANNA)
        wire.inject(query, ANNA)  # the network's copy gets no answer
        for _, answer in wire.listener.outbox:
            answers += 1
            assert len(answer) <= len(query)
            peer.receive(answer, PEER, wire.now_ns)
        wire.listener.outbox.clear()
    assert answers == MOST_REPEATS
    assert peer.ready()
    call(wire, peer)
    wire.talk()
    peer.put_flight()
    wire.inject(peer.outbox.pop()[1], ANNA)
    assert not wire.listener.outbox, "after a message nobody lacks the end of the handshake"


AFTER: dict[str, Callable[[DtlsPeer], list[bytes]]] = {
    "a long message in parts": lambda peer: [
        peer.fragment(kind, seq, b"x" * 12, 100_000) for kind in (CLIENT_HELLO, FINISHED, 24) for seq in range(4, 15)
    ],
    "overlapping parts": lambda peer: [
        peer.fragment(CLIENT_HELLO, 4, b"x" * 100, 200, offset) for offset in (0, 50, 150, 99, 100)
    ],
    "renegotiation": lambda peer: [peer.record(HANDSHAKE, whole(CLIENT_HELLO, 4, peer.client_hello().body).encode())],
    "a ClientHello in the clear": lambda peer: [peer.record(HANDSHAKE, peer.client_hello().encode(), 0)],
    "a change of ciphers": lambda peer: [peer.record(CHANGE_CIPHER_SPEC, b"\x01", epoch) for epoch in (0, 1)],
    "data in the clear": lambda peer: [peer.record(APPLICATION_DATA, b"up", 0)],
    "a fatal alert in the clear": lambda peer: [peer.record(ALERT, b"\x02\x28", 0)],
    "the next epoch": lambda peer: [peer.record(APPLICATION_DATA, b"up", epoch) for epoch in (2, 3, 0xFFFF)],
    "no type": lambda peer: [peer.record(kind, b"up") for kind in (0, 19, 24, 25, 255)],
    "an empty handshake record": lambda peer: [peer.record(HANDSHAKE, b"")],
}


@pytest.mark.parametrize("attack", AFTER)
@pytest.mark.parametrize("seated", [True, False])
def test_after_the_handshake_it_brings_nothing_about_but_counts(wire: Wire, attack: str, seated: bool) -> None:
    if seated:
        wire.seats.add(MALLORY)
    wire.seal(BEN)
    peer = joined(wire, MALLORY)
    if seated:
        wire.talk(MALLORY)
    heard, before = len(wire.heard), sum(wire.listener.dropped.values())
    datagrams = AFTER[attack](peer)
    put(wire, *datagrams[:20])
    assert len(wire.heard) == heard
    assert sum(wire.listener.dropped.values()) >= before + len(datagrams[:20])
    assert _lib.ERR_peek_error() == 0
    assert wire.listener.ready(MALLORY), "what is not DTLS' to judge ends nothing"
    wire.talk(MALLORY)
    wire.talk(BEN)


def test_messages_in_any_order_come_once_and_old_ones_never(wire: Wire) -> None:
    peer = joined(wire)
    records = [peer.record(APPLICATION_DATA, bytes([number])) for number in range(100)]
    for number in (3, 1, 2, 3, 1, 90, 89, 30, 3, 26, 90):  # the window is 64 wide: RFC 6347 section 4.1.2.6
        wire.inject(records[number], ANNA)
    assert [message[0] for _, message in wire.heard] == [3, 1, 2, 90, 89, 30]
    wire.talk()


BEFORE: dict[str, Callable[[HalfOpen], list[bytes]]] = {
    "long messages in parts": lambda peer: [
        peer.fragment(kind, seq, b"x" * 12, length)
        for kind in (CLIENT_HELLO, CLIENT_KEY_EXCHANGE, FINISHED) for seq in (2, 3, 9) for length in (1025, 100_000)
    ],
    "messages far ahead": lambda peer: [peer.fragment(CLIENT_KEY_EXCHANGE, seq, b"x" * 12, 66) for seq in range(5, 16)],
    "early records": lambda peer: [peer.record(kind, b"x" * 48, 1, 7) for kind in (HANDSHAKE, APPLICATION_DATA)],
    "a change of ciphers": lambda peer: [peer.record(CHANGE_CIPHER_SPEC, b"\x01", 0)],
    "parts out of range": lambda peer: [
        peer.fragment(CLIENT_KEY_EXCHANGE, 2, b"x" * 12, 66, offset) for offset in (55, 66, 0xFFFFFF)
    ],
    "a certificate": lambda peer: [peer.fragment(11, 2, b"\0\0\0")],
}  # fmt: skip


@pytest.mark.parametrize("attack", BEFORE)
def test_amid_a_handshake_it_is_dropped_and_the_handshake_goes_on(wire: Wire, attack: str) -> None:
    peer = halted(wire)
    datagrams = BEFORE[attack](peer)
    before = sum(wire.listener.dropped.values())
    put(wire, *datagrams)
    assert sum(wire.listener.dropped.values()) >= before + len(datagrams)
    DtlsPeer.answer_server_hello(peer)
    goes_on(wire, peer)


def test_a_key_exchange_in_overlapping_parts_is_put_together(wire: Wire) -> None:
    peer = halted(wire)
    peer.read_server()
    body = peer.key_exchange()[12:]
    for first, last in ((20, len(body)), (0, 25), (10, 22)):
        part = Fragment(CLIENT_KEY_EXCHANGE, len(body), 2, first, body[first:last])
        put(wire, peer.record(HANDSHAKE, part.encode(), 0))
    put(wire, peer.record(CHANGE_CIPHER_SPEC, b"\x01", 0) + peer.record(HANDSHAKE, peer.finished()))
    goes_on(wire, peer)


def wrong_finished(peer: DtlsPeer) -> None:
    peer.read_server()
    flight = peer.record(HANDSHAKE, peer.key_exchange(), 0) + peer.record(CHANGE_CIPHER_SPEC, b"\x01", 0)
    peer.put(flight + peer.record(HANDSHAKE, whole(FINISHED, 3, bytes(12)).encode()))


@pytest.mark.parametrize(
    ("attack", "why"),
    [(ATTACKS["encrypted before Finished"][1], sealed_channel.UNFINISHED), (wrong_finished, "")],
    ids=["parts", "wrong"],
)
def test_what_is_no_finished_ends_the_handshake(wire: Wire, attack: Callable[[DtlsPeer], None], why: str) -> None:
    attack(halted(wire))
    wire.rest(0.1)
    assert wire.listener.counts() == {"open": 0, "half open": 0}
    assert any(name.startswith(f"handshake failed: {why}") for name in wire.listener.dropped)


def test_a_handshake_has_so_many_datagrams(wire: Wire) -> None:
    peer = halted(wire)
    assert wire.listener.counts()["half open"] == 1
    put(wire, *[peer.record(HANDSHAKE, bytes(20), 1, number) for number in range(MOST_SHAKING + 1)])
    assert wire.listener.counts()["half open"] == 0
    assert wire.listener.dropped["handshake too long"] == 1


def crowd(wire: Wire, addresses: list[Address]) -> None:
    """Handshakes of all of them, that stop half open or open."""
    peers = [call(wire, DtlsPeer() if number % 2 else HalfOpen(), at) for number, at in enumerate(addresses)]
    wire.until(lambda: all(peer.ready() or peer.halted for peer in peers))
    for address in addresses:
        del wire.calls[address], wire.answers[address]


def test_handshakes_from_many_addresses_displace_no_newcomer(wire: Wire) -> None:
    """Twice as many as there is a budget for, while the newcomer's is under way."""
    crowd(wire, [(f"10.67.0.{number}", 1) for number in range(MOST_UNSEATED)])
    assert sum(wire.listener.counts().values()) == MOST_UNSEATED
    newcomer = wire.call(ANNA)
    wire.rest(0.03)
    for turn in range(4):
        crowd(wire, [(f"10.67.{1 + turn}.{number}", 1) for number in range(8)])
    assert newcomer.ready(PEER)
    wire.talk(ANNA)
    assert wire.listener.dropped["too many without a seat"] == 4 * 8 + 1
    assert sum(wire.listener.counts().values()) <= MOST_UNSEATED + 1  # Anna has a seat


def test_one_address_with_many_handshakes_displaces_only_itself(wire: Wire) -> None:
    wire.seats.discard(BEN)
    wire.seal(BEN)
    for turn in range(4):
        crowd(wire, [("10.67.0.1", 50 * turn + number) for number in range(50)])
        wire.talk(BEN)
    assert wire.listener.dropped["too many without a seat"] == 4 * 50 + 1 - MOST_UNSEATED
    assert sum(wire.listener.counts().values()) == MOST_UNSEATED


def test_who_had_a_seat_lately_goes_last(wire: Wire) -> None:
    wire.seal(BEN)
    wire.talk(BEN)
    wire.seats.discard(BEN)
    wire.rest(0.6)  # until it was looked at
    wire.seal((BEN[0], 4999))
    for turn in range(4):
        crowd(wire, [(f"10.67.{turn}.{number}", 1) for number in range(50)])
    assert wire.listener.ready(BEN)
    assert wire.listener.ready((BEN[0], 4999))


def test_memory_is_given_back_once_the_handshakes_are_over(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trims: list[int] = []
    wire = Wire(folder)
    monkeypatch.setattr(sealed_channel, "trim", lambda: trims.append(wire.now_ns))
    for number in range(sealed_channel.TRIM_AFTER):
        halted(wire, address := ("10.68.0.1", number))
        del wire.calls[address], wire.answers[address]
    assert not trims
    wire.rest(max(WAITS_NS, HELLO_WAITS_NS) / 1e9 + 0.6)
    assert len(trims) == 1
