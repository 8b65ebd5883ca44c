"""Encrypted channel in virtual time: handshakes on impaired networks, admission, state kept of a peer."""

import random
from pathlib import Path

import pytest

from cogrip.protocol.io import dtls_client as sealed_call
from cogrip.protocol.io.dtls import NOT_TRUSTED
from cogrip.protocol.io.dtls_client import NO_ANSWER_CURE, DtlsClient
from cogrip.protocol.secure.channel import PEER
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES, MAX_MESSAGE_BYTES, Refuse
from cogrip.protocol.wire.session import make_hello
from cogrip.server.io.dtls_channel import HELLO_WAITS_NS, MOST_ASKED, MOST_LEFT, REPORTED, WAITS_NS
from cogrip.server.io.dtls_peer import COOKIE_NS
from cogrip.server.rate_limit import LIMITS, Budget

from tests.protocol.foreign_peers import foreign
from tests.server.encrypted_network import ANNA, BEN, DOWN, FAULTS, NO_LIMITS, UP, Wire

HELLO = make_hello(
    software="test", nonce=77, room="", name="", digest="", device="sim:ideal", axes=1, rate_hz=1024.0
)  # fmt: skip


def half_open(wire: Wire, address: tuple[str, int]) -> None:
    """Someone hears what is sent to the address, and goes no further than to show it."""
    call = DtlsClient(wire.listener.fingerprint)
    call.poll(0)
    wire.inject(call.outbox.popleft()[1], address)
    call.receive(wire.listener.outbox.popleft()[1], PEER, 0)
    wire.inject(call.outbox.popleft()[1], address)
    wire.listener.outbox.clear()


def test_a_handshake_then_messages_both_ways(wire: Wire) -> None:
    call = wire.call()
    assert not call.ready(PEER)
    assert not call.send(b"too early", PEER)
    assert call.dropped == {"no association yet": 1}
    wire.until(lambda: call.ready(PEER))
    assert [to_server for to_server, *_ in wire.log] == [True, False, True, False, True, False]  # three round trips
    assert wire.listener.counts() == {"open": 1, "half open": 0}
    assert not wire.heard
    assert all(len(datagram) <= MAX_DATAGRAM_BYTES for *_, datagram in wire.log)
    wire.talk()
    assert not any(UP in datagram or DOWN in datagram for *_, datagram in wire.log)


def test_the_longest_message_fits_one_datagram_and_one_byte_more_is_counted(wire: Wire) -> None:
    call = wire.seal()
    longest = bytes(MAX_MESSAGE_BYTES)
    assert call.send(longest, PEER)
    assert wire.listener.send(longest, ANNA)
    wire.rest()
    assert wire.heard == [(ANNA, longest)]
    assert wire.answers[ANNA] == [longest]
    assert {len(datagram) for *_, datagram in wire.log[-2:]} == {MAX_DATAGRAM_BYTES}
    assert not call.send(longest + b"x", PEER)
    assert not wire.listener.send(longest + b"x", ANNA)
    assert not call.send(b"", PEER)
    assert not wire.listener.send(b"", ANNA)
    for dropped in (call.dropped, wire.listener.dropped):
        assert dropped["too large"] == dropped["empty"] == 1
    wire.talk()


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault != "pass"])
def test_any_datagram_of_a_handshake_may_be_lost_doubled_or_late(folder: Path, number: int, fault: str) -> None:
    wire = Wire(folder, fault=lambda nth: fault if nth == number else "pass")
    call = wire.call()
    wire.until(lambda: call.ready(PEER), within_s=0.1 if fault == "twice" else 2.0)
    if fault == "twice":  # which costs no second handshake
        assert "handshake begun again" not in {**call.dropped, **wire.listener.dropped}
        assert len(wire.log) == 6 + (number == 0)  # the cookie is sent once more: nobody knows of the first
    wire.rest(1.0)  # what is late may still come
    wire.talk()


def test_junk_does_not_pass_for_an_answer(folder: Path) -> None:
    """Only what brings a handshake on makes a call wait longer for the rest of it."""
    wire = Wire(folder, fault=lambda nth: "drop" if nth == 1 else "pass")
    call = wire.call()
    for _ in range(95):
        wire.step()
        call.receive(b"\x16\xfe\xfd" + bytes(60), PEER, wire.now_ns)
        call.receive(b"\x17\xfe\xfd" + bytes(60), PEER, wire.now_ns)
    assert "handshake begun again" not in call.dropped
    wire.until(lambda: call.ready(PEER), within_s=0.2)
    assert call.dropped["handshake begun again"] == 1


@pytest.mark.parametrize("seed", range(12))
def test_handshakes_on_a_bad_network(folder: Path, seed: int) -> None:
    chance = random.Random(seed)
    wire = Wire(folder, fault=lambda _: chance.choices(list(FAULTS), [10, 1, 1, 1, 1, 1])[0])
    for address in (ANNA, BEN):
        wire.call(address)
    wire.until(lambda: all(call.ready(PEER) for call in wire.calls.values()), within_s=9.9)
    wire._fault = lambda _: "pass"
    wire.rest(1.0)
    wire.talk(ANNA)
    wire.talk(BEN)


@pytest.mark.parametrize("checked", [True, False])
def test_another_certificate_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch, checked: bool) -> None:
    """In the handshake, where the server hears why; were the check missing there, after it."""
    if not checked:
        monkeypatch.setattr(sealed_call, "client_context", lambda *_: foreign())
    wire = Wire(folder)
    call = wire.call(fingerprint="12345678" * 8)
    wire.until(lambda: call.failed)
    wire.rest()
    assert "the link names 1234567812345678…" in call.failed
    assert wire.listener.fingerprint[:16] in call.failed
    assert "ask for a new link" in call.failed
    assert not call.ready(PEER)
    assert not call.send(b"secret", PEER)
    assert not wire.heard
    assert wire.listener.counts() == {"open": 0, "half open": 0}
    if checked:
        assert wire.listener.dropped[f"handshake failed: {NOT_TRUSTED}"] == 1
        (event,) = wire.listener.events
        assert (event.event, event.code, event.address) == ("refused", "handshake", "10.0.0.1:4001")
        assert "another fingerprint" in event.text


def test_a_call_that_nobody_answers_gives_up_in_words(folder: Path) -> None:
    wire = Wire(folder, fault=lambda _: "drop")
    call = wire.call()
    wire.until(lambda: bool(call.failed), within_s=10.1)
    assert call.failed == f"no encrypted server answered within 10 s: {NO_ANSWER_CURE}"
    assert call.dropped["handshake begun again"] >= 10


def test_an_unencrypted_hello_is_refused_with_the_cure(wire: Wire) -> None:
    hello = messages.padded(HELLO)
    assert wire.inject(hello, ANNA) == ()
    ((address, answer),) = wire.listener.outbox
    refuse = messages.decode(answer)
    assert isinstance(refuse, Refuse)
    assert (address, refuse.code, refuse.nonce) == (ANNA, "sealed", 77)
    assert len(answer) <= len(hello)
    assert wire.listener.dropped == {"refused: not encrypted": 1}
    assert [event.code for event in wire.listener.events] == ["sealed"]
    assert wire.inject(hello[:-1], ANNA) == ()
    assert len(wire.listener.outbox) == 1
    assert wire.listener.dropped == {"refused: not encrypted": 1, "unauthenticated": 1}


def test_an_unencrypted_refusal_is_a_hint_and_no_more(wire: Wire) -> None:
    call = wire.call()
    call.poll(0)
    refuse = messages.encode(Refuse(2, 0, "full", "go away"))
    assert call.receive(refuse, PEER, 0) == ()
    assert call.dropped == {"not encrypted": 1}
    assert not call.failed
    call.outbox.clear()
    wire.listener.poll(wire.now_ns)
    for second in range(11):
        call.poll(second * 1_000_000_000)
    assert call.failed.endswith("unencrypted came, perhaps from anyone: go away [full]")


def test_unencrypted_datagrams_into_an_association_are_dropped_on_both_sides(wire: Wire) -> None:
    call = wire.seal()
    for datagram in (messages.padded(HELLO), messages.encode(Refuse(2, 77, "full", "go away")), b"\x17", b"\x90"):
        assert wire.inject(datagram, ANNA) == ()
        assert call.receive(datagram, PEER, wire.now_ns) == ()
    assert wire.inject(b"", ANNA) == ()
    assert wire.inject(bytes(MAX_DATAGRAM_BYTES + 1), ANNA) == ()
    assert not wire.listener.outbox
    assert wire.listener.dropped.keys() == {"cookie sent", "no record", "empty", "too large"}
    wire.talk()


def test_a_new_handshake_from_a_known_address_replaces_the_old_one_when_it_is_done(wire: Wire) -> None:
    old = wire.seal()
    new = wire.call()
    steps = 0
    while not wire.listener.renewed:  # by the old seal, until there is a new one
        assert old.receive(wire.answer(b"still here"), PEER, wire.now_ns) == (b"still here",)
        assert old.send(b"here too", PEER)
        assert list(wire.inject(old.outbox.pop()[1], ANNA)) == [b"here too"]
        wire.step()
        steps += 1
    assert steps > 5
    assert not new.ready(PEER)
    wire.until(lambda: new.ready(PEER))
    wire.heard.clear()
    assert list(wire.listener.renewed) == [ANNA]
    assert wire.listener.counts() == {"open": 1, "half open": 0}
    wire.talk()
    old.send(b"from the past", PEER)
    assert wire.inject(old.outbox.pop()[1], ANNA) == ()


def test_a_client_hello_from_the_address_of_a_peer_leaves_it_alone(folder: Path) -> None:
    """Hellos with no cookie, a wrong one, and the right one but nothing after it."""
    wire, other = Wire(folder), Wire(folder)
    wire.seal()
    other.seal()
    for datagram in [*other.hellos(), *wire.hellos()]:
        assert wire.inject(datagram, ANNA) == ()
        wire.listener.outbox.clear()
    assert wire.listener.counts() == {"open": 1, "half open": 0}  # its own hello is known to be an old one
    half_open(wire, ANNA)
    assert wire.listener.counts() == {"open": 1, "half open": 1}
    wire.talk()
    wire.rest(WAITS_NS / 1e9 + 0.1)
    assert wire.listener.counts() == {"open": 1, "half open": 0}
    assert wire.listener.dropped["handshake timed out"] == 1
    assert not wire.listener.renewed
    wire.talk()


def test_a_cookie_belongs_to_an_address_and_a_time(wire: Wire) -> None:
    wire.seal()
    hello = wire.hellos()[1]
    for port in (4002, 4001 ^ 1):
        wire.inject(hello, (ANNA[0], port))
    wire.inject(hello, BEN)
    assert wire.listener.counts() == {"open": 1, "half open": 0}
    wire.listener.close(ANNA)
    wire.inject(hello, ANNA)
    assert wire.listener.counts() == {"open": 0, "half open": 1}
    wire.listener.close(ANNA)
    wire.now_ns += 2 * COOKIE_NS
    wire.inject(hello, ANNA)
    assert wire.listener.counts() == {"open": 0, "half open": 0}


def test_associations_are_bounded(folder: Path) -> None:
    wire = Wire(folder, most=2)
    wire.seal(ANNA)
    wire.seal(BEN)
    late = wire.call(("10.0.0.3", 1))
    wire.rest(1.0)
    assert not late.ready(PEER)
    assert wire.listener.counts() == {"open": 2, "half open": 0}
    assert wire.listener.dropped["too many associations"] >= 1
    again = wire.seal(ANNA)  # who is in may begin anew
    assert again.ready(PEER)
    wire.listener.close(BEN)
    wire.until(lambda: late.ready(PEER))


def test_two_last_places_taken_at_once(folder: Path) -> None:
    wire = Wire(folder, most=1)
    calls = [wire.call(ANNA), wire.call(BEN)]
    wire.rest(0.08)
    assert wire.listener.counts()["open"] == 1
    assert sum(bool(call.failed) for call in calls) == 1


@pytest.mark.parametrize(
    ("asks", "waits_ns", "why"), [(True, WAITS_NS, "no seat in time"), (False, HELLO_WAITS_NS, "no hello in time")]
)
def test_an_association_without_a_seat_is_closed(wire: Wire, asks: bool, waits_ns: int, why: str) -> None:
    wire.seats.discard(BEN)
    anna, ben = wire.seal(ANNA), wire.seal(BEN)
    if asks:
        ben.send(b"may I?", PEER)
    wire.rest(waits_ns / 1e9 - 0.6)
    assert wire.listener.counts()["open"] == 2
    wire.rest(1.2)
    assert wire.listener.counts()["open"] == 1
    assert wire.listener.dropped[why] == 1
    assert ben.failed == "the other end closed the DTLS association"
    assert anna.ready(PEER)
    wire.seats.discard(ANNA)  # Anna left: some seconds for what remains to be said, then it is over
    wire.talk(ANNA)
    wire.rest(WAITS_NS / 1e9 + 0.6)
    assert wire.listener.counts()["open"] == 0
    assert anna.failed


def test_who_has_no_seat_may_ask_so_often_and_who_had_one_may_finish(wire: Wire) -> None:
    """Each hello of an unauthenticated peer costs a decryption and a look into the tokens."""
    wire.seats.discard(BEN)
    wire.seal(ANNA)
    wire.seal(BEN)
    delivered = [len(wire.inject(wire.record(b"may I?", BEN), BEN)) for _ in range(MOST_ASKED + 1)]
    assert delivered == [1] * MOST_ASKED + [0]
    assert wire.listener.dropped["asked too often"] == 1
    assert not wire.listener.ready(BEN)
    wire.talk(ANNA)
    wire.seats.discard(ANNA)
    wire.rest(0.6)  # until it was looked at again
    delivered = [len(wire.inject(wire.record(b"goodbye"), ANNA)) for _ in range(MOST_LEFT + 1)]
    assert delivered == [1] * MOST_LEFT + [0]
    assert not wire.listener.ready(ANNA)


def test_closing_tells_the_other_end(wire: Wire) -> None:
    anna, ben = wire.seal(ANNA), wire.seal(BEN)
    wire.listener.close(ANNA)
    ben.close(PEER)
    wire.rest()
    assert anna.failed == "the other end closed the DTLS association"
    assert wire.listener.dropped["association ended: the other end closed the DTLS association"] == 1
    assert wire.listener.counts() == {"open": 0, "half open": 0}
    assert not wire.listener.send(b"x", ANNA)
    assert not wire.listener.ready(ANNA)
    assert wire.listener.dropped["no association"] == 1
    wire.listener.close(ANNA)  # nobody there: nothing happens


def test_budgets_hold_for_encrypted_and_unencrypted_hellos(folder: Path) -> None:
    wire = Wire(folder, NO_LIMITS._replace(contacts=Budget(10, 3)))
    stranger = wire.call()
    stranger.poll(0)
    datagram = stranger.outbox.pop()[1]
    del wire.calls[ANNA]
    for number in range(4):
        wire.inject(datagram, ("10.0.0.7", number))
        wire.inject(messages.padded(HELLO), ("10.0.0.8", number))
    answered = {"cookie sent": 3, "refused: not encrypted": 3}  # the first of each address is of those who are new
    assert len(wire.listener.outbox) == 5
    assert sum(wire.listener.dropped[each] for each in answered) == 5
    assert wire.listener.dropped["contact budget"] == 3


def test_whoever_knocks_often_is_counted_and_does_not_fill_the_journal(wire: Wire) -> None:
    for number in range(50):
        wire.inject(messages.padded(HELLO), ("10.0.0.7", number))
    assert len(wire.listener.events) == REPORTED.burst
    assert wire.listener.dropped == {"refused: not encrypted": 50}
    wire.now_ns += 1_000_000_000
    wire.inject(messages.padded(HELLO), ("10.0.0.7", 99))
    assert len(wire.listener.events) == REPORTED.burst + 1


def test_a_flood_of_hellos_from_forged_addresses_keeps_nobody_out_who_was_in(folder: Path) -> None:
    wire = Wire(folder, LIMITS)
    wire.seal(ANNA)
    for number in range(2000):
        wire.inject(wire.hellos()[0], (f"10.1.{number % 250}.{number // 250}", 1000))
    assert wire.listener.dropped["contact budget"] > 1000
    moved = (ANNA[0], 4999)  # another port, as after a restart of the router
    wire.listener.outbox.clear()
    wire.seal(moved)
    wire.talk(moved)


def test_handshakes_have_a_budget_of_their_own(folder: Path) -> None:
    wire = Wire(folder, NO_LIMITS._replace(handshakes=Budget(1, 2)))
    for number in range(3):
        call = wire.call((f"10.0.0.{number}", 7))
        wire.until(lambda call=call: call.ready(PEER) or "handshake budget" in wire.listener.dropped)  # type: ignore[misc]
    assert wire.listener.counts()["open"] == 2
    wire.until(lambda: call.ready(PEER))  # a second later there is one more


def test_a_peer_that_floods_is_cut_to_its_budget_and_nobody_else_is(folder: Path) -> None:
    wire = Wire(folder, NO_LIMITS._replace(peer=Budget(1000, 50)))
    wire.seal(ANNA)
    wire.seal(BEN)
    wire.rest(0.2)
    assert sum(len(wire.inject(wire.record(b"flood"), ANNA)) for _ in range(80)) == 50
    assert wire.listener.dropped["flood of a peer"] == 30
    wire.talk(BEN)
