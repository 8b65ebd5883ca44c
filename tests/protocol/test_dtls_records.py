"""Filter of a client's DTLS records: both sides of each bound."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.secure import dtls_records
from cogrip.protocol.secure.dtls_records import ALERT, CLIENT_KEY_EXCHANGE, DATA, HANDSHAKE, MOST_MESSAGE_BYTES, records

from tests.dtls_peer.records import Fragment, Record, whole

CCS = Record(dtls_records.CHANGE_CIPHER_SPEC, 0, 9, b"\x01").encode()
FATAL = Record(ALERT, 0, 9, b"\x02\x28").encode()


def handshake(fragment: Fragment, number: int = 0) -> bytes:
    return Record(HANDSHAKE, 0, number, fragment.encode()).encode()


HELLO = handshake(whole(dtls_records.CLIENT_HELLO, 1, bytes(150)))
EXCHANGE = handshake(whole(CLIENT_KEY_EXCHANGE, 2, bytes(66)))


def finished(number: int = 0, size: int = 48) -> bytes:
    return Record(HANDSHAKE, 1, number, bytes(size)).encode()


class Inspected:
    """A client's records up to a state."""

    def __init__(self, state: str = "key exchange") -> None:
        self.dropped: list[str] = []
        self.records = dtls_records.ClientRecords(self.dropped.append)
        if state != "key exchange":
            assert self.records.passed(EXCHANGE + CCS) == EXCHANGE + CCS
        if state == "open":
            assert self.records.passed(finished()) == finished()
            self.records.open()
        assert self.records.state == state

    def fault(self, datagram: bytes) -> str:
        """The name under which it is dropped, "" if it passes."""
        self.dropped.clear()
        passed = self.records.passed(datagram)
        assert passed == (b"" if self.dropped else datagram)
        return ", ".join(self.dropped)


def test_the_records_of_a_client_that_joins_pass() -> None:
    inspected = Inspected()
    assert inspected.fault(HELLO) == ""
    assert inspected.fault(EXCHANGE + CCS + finished()) == ""
    inspected.records.open()
    for number in range(5):
        assert inspected.fault(Record(DATA, 1, 1 + number, bytes(500)).encode()) == ""
    assert inspected.fault(Record(ALERT, 1, 9, bytes(26)).encode()) == ""


@pytest.mark.parametrize(
    ("fragment", "says"),
    [
        (Fragment(CLIENT_KEY_EXCHANGE, MOST_MESSAGE_BYTES, 2, 0, b"x"), ""),
        (Fragment(CLIENT_KEY_EXCHANGE, MOST_MESSAGE_BYTES + 1, 2, 0, b"x"), "handshake message too long"),
        (Fragment(CLIENT_KEY_EXCHANGE, 100_000, 2, 0, b"x"), "handshake message too long"),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, dtls_records.MOST_MESSAGE_SEQ, 0, b"x"), ""),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, dtls_records.MOST_MESSAGE_SEQ + 1, 0, b"x"), "handshake message ahead"),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, 0xFFFF, 0, b"x"), "handshake message ahead"),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, 2, 60, b"x" * 6), ""),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, 2, 60, b"x" * 7), "handshake fragment out of range"),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, 2, 0xFFFFFF, b"x"), "handshake fragment out of range"),
        (Fragment(CLIENT_KEY_EXCHANGE, 66, 2, 0, b""), "handshake fragment out of range"),
        (Fragment(11, 66, 2, 0, b"x"), "handshake message of no client"),  # Certificate: nobody was asked for one
        (Fragment(20, 12, 3, 0, b"x" * 12), "handshake message of no client"),  # Finished in the clear
    ],
)
@pytest.mark.parametrize("state", ["key exchange", "finishing"])
def test_handshake_messages_in_the_clear(state: str, fragment: Fragment, says: str) -> None:
    assert Inspected(state).fault(handshake(fragment)) == says


def test_the_second_message_of_a_record_is_looked_at_as_well() -> None:
    first, second = whole(CLIENT_KEY_EXCHANGE, 2, bytes(66)), Fragment(CLIENT_KEY_EXCHANGE, 100_000, 3, 0, b"x")
    record = Record(HANDSHAKE, 0, 1, first.encode() + second.encode()).encode()
    assert Inspected().fault(record) == "handshake message too long"
    for cut in (b"", first.encode()[:-1], first.encode() + b"x"):
        assert Inspected().fault(Record(HANDSHAKE, 0, 1, cut).encode()) == "handshake message cut"


@pytest.mark.parametrize(
    ("state", "record", "says"),
    [
        ("key exchange", CCS, "record too early"),  # the library would lose it
        ("key exchange", finished(), "record too early"),  # the library would keep it
        ("key exchange", Record(DATA, 1, 0, bytes(40)).encode(), "record too early"),
        ("key exchange", Record(DATA, 0, 0, bytes(40)).encode(), "record too early"),
        ("key exchange", FATAL, ""),
        ("key exchange", Record(ALERT, 0, 0, bytes(3)).encode(), "alert of no length"),
        ("key exchange", Record(24, 0, 0, bytes(20)).encode(), "record of no type"),
        ("finishing", finished(size=dtls_records.MOST_FINISHED_BYTES), ""),
        ("finishing", finished(size=dtls_records.MOST_FINISHED_BYTES + 1), "handshake message too long"),
        ("finishing", Record(DATA, 1, 0, bytes(40)).encode(), "record too early"),
        ("finishing", Record(HANDSHAKE, 2, 0, bytes(48)).encode(), "record of no epoch"),
        ("finishing", Record(ALERT, 1, 0, bytes(26)).encode(), ""),
        ("open", Record(DATA, 1, 1, bytes(40)).encode(), ""),
        ("open", Record(DATA, 0, 1, bytes(40)).encode(), "record in the clear"),
        ("open", Record(DATA, 2, 1, bytes(40)).encode(), "record of no epoch"),
        ("open", Record(24, 1, 1, bytes(40)).encode(), "record of no type"),
        ("open", FATAL, "record in the clear"),
        ("open", HELLO, "handshake after its end"),
        ("open", CCS, "handshake after its end"),
        ("open", finished(1), "handshake after its end"),
    ],
)
def test_each_state_has_its_records(state: str, record: bytes, says: str) -> None:
    assert Inspected(state).fault(record) == says


def test_a_handshake_that_goes_on_where_it_must_end_is_overdue() -> None:
    inspected = Inspected("finishing")
    for number in range(dtls_records.MOST_FINISHED):
        assert not inspected.records.overdue
        assert inspected.fault(finished(number)) == ""
    assert inspected.records.overdue
    assert inspected.fault(finished(dtls_records.MOST_FINISHED)) == "handshake message ahead"


def test_a_flight_that_is_sent_again_is_told_from_a_copy() -> None:
    inspected = Inspected("open")
    for number, repeats in ((0, False), (1, True), (1, False), (0, False), (7, True), (6, False)):
        inspected.fault(EXCHANGE + CCS + finished(number))
        assert inspected.records.repeats is repeats, number


def test_good_records_of_a_datagram_pass_without_the_bad_ones() -> None:
    inspected = Inspected("open")
    one, two = (Record(DATA, 1, number, bytes(20)).encode() for number in (1, 2))
    assert inspected.records.passed(one + finished(3) + two + b"rest") == one + two
    assert inspected.dropped == ["handshake after its end", "no record"]
    assert inspected.records.passed(one[:-1]) == b""
    assert inspected.records.passed(b"\x17\x03\x03" + one[3:]) == b""  # TLS


@given(
    data=st.binary(max_size=300),
    seed=st.integers(0, 1000),
    state=st.sampled_from(["key exchange", "finishing", "open"]),
)
def test_whatever_comes_only_whole_records_pass_and_only_bounded_messages(data: bytes, seed: int, state: str) -> None:
    chance, inspected = random.Random(seed), Inspected(state)
    mixed = bytearray(EXCHANGE + CCS + finished() + data + HELLO)
    for _ in range(seed % 7):
        mixed[chance.randrange(len(mixed))] = chance.randrange(256)
    passed = inspected.records.passed(bytes(mixed))
    assert passed == b"".join(passed[each.begin : each.end] for each in records(passed))
    for each in records(passed):
        if each.type == HANDSHAKE and not each.epoch:
            assert int.from_bytes(passed[each.begin + 14 : each.begin + 17], "big") <= MOST_MESSAGE_BYTES
    assert state != "open" or all(each.type in (DATA, ALERT) and each.epoch == 1 for each in records(passed))
