"""Budgets: both sides of each boundary, who shares a bucket, and that nothing grows."""

import sys
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.messages import MAX_DATAGRAM_BYTES
from cogrip.server.gate import LIMITS, SEATED_NS, Budget, Gate, Limits, limits_for, network_of

PLENTY = Budget(1_000_000, 1_000_000)
OPEN = Limits(PLENTY, PLENTY, PLENTY, PLENTY)
ANNA, BEN = ("10.0.0.1", 4001), ("10.0.0.2", 4002)


def gate(**limits: Budget) -> Gate:
    return Gate(b"secret of a test", OPEN._replace(**limits))


def test_sizes() -> None:
    doors = gate()
    assert doors.size(b"") == "empty"
    assert doors.size(b"x") == doors.size(bytes(MAX_DATAGRAM_BYTES)) == ""
    assert doors.size(bytes(MAX_DATAGRAM_BYTES + 1)) == "too large"


@pytest.mark.parametrize(
    ("question", "budget", "says"),
    [
        ("contact", "address", "address budget"),
        ("contact", "contacts", "contact budget"),
        ("handshake", "address", "address budget"),
        ("handshake", "handshakes", "handshake budget"),
        ("peer", "peer", "flood of a peer"),
    ],
)
def test_a_budget_gives_its_burst_then_its_rate(question: str, budget: str, says: str) -> None:
    ask = getattr(gate(**{budget: Budget(10, 3)}), question)
    now_ns = 5_000_000_000
    assert [ask(ANNA, now_ns) for _ in range(5)] == ["", "", "", says, says]
    assert ask(ANNA, now_ns + 99_999_999) == says
    assert ask(ANNA, now_ns + 100_000_000) == ""
    assert ask(ANNA, now_ns + 199_999_999) == says
    assert ask(ANNA, now_ns + 200_000_000) == ""
    later_ns = now_ns + 3_600_000_000_000  # however long it rested, there is one burst
    assert [ask(ANNA, later_ns) for _ in range(5)] == ["", "", "", says, says]


def test_the_limits_that_are_there_by_default() -> None:
    assert Limits() == LIMITS == Limits(Budget(20, 250), Budget(300, 600), Budget(100, 50), Budget(512, 512))
    assert limits_for(1024).peer == Budget(4096, 4096)
    doors = Gate(b"s")
    assert [doors.handshake((f"10.0.{number}.1", 1), 1) for number in range(51)].count("") == 50
    assert [doors.contact((f"10.0.{number >> 8}.{number & 255}", 1), 1) for number in range(601)].count("") == 600
    laboratory = [doors.contact(("192.0.2.1", 1000 + number), 10**10) for number in range(251)]
    assert laboratory == [""] * 250 + ["address budget"]


@given(
    rate=st.integers(1, 5000), burst=st.integers(1, 50), gaps_ms=st.lists(st.integers(0, 400), min_size=1, max_size=150)
)
def test_a_budget_is_a_token_bucket(rate: int, burst: int, gaps_ms: list[int]) -> None:
    """Against a bucket of exact fractions."""
    doors = gate(peer=Budget(rate, burst))
    tokens, now_ns = Fraction(burst), 1_000_000_000
    each_ns = 1_000_000_000 // rate
    for gap_ms in gaps_ms:
        now_ns += gap_ms * 1_000_000
        tokens = min(Fraction(burst), tokens + Fraction(gap_ms * 1_000_000, each_ns))
        passes = doors.peer(ANNA, now_ns) == ""
        assert passes == (tokens >= 1)
        tokens -= passes


def test_one_address_spends_its_own_budget_whatever_its_port() -> None:
    doors = gate(address=Budget(10, 2))
    assert [doors.contact((ANNA[0], port), 1) for port in (1, 2, 3)] == ["", "", "address budget"]
    assert [doors.handshake((ANNA[0], port), 1) for port in (1, 2, 3)] == ["", "", "address budget"]
    assert doors.contact(BEN, 1) == doors.handshake(BEN, 1) == ""


def test_a_flood_of_forged_addresses_does_not_keep_proven_ones_out() -> None:
    doors = gate(contacts=Budget(10, 4))
    doors.proven(ANNA, 0)
    flood = [doors.contact((f"10.66.{number}.1", 1), 0) for number in range(50)]
    assert flood == [""] * 4 + ["contact budget"] * 46
    assert doors.contact(BEN, 0) == "contact budget"
    assert [doors.contact((ANNA[0], port), 0) for port in range(5)] == [""] * 4 + [
        "contact budget"
    ]  # another port, too
    assert [doors.contact(ANNA, SEATED_NS) for _ in range(3)] == [""] * 3  # like everyone's by then
    assert [doors.contact(BEN, SEATED_NS) for _ in range(2)] == ["", "contact budget"]


def test_peers_are_told_apart_by_port() -> None:
    doors = gate(peer=Budget(10, 1))
    assert doors.peer(ANNA, 1) == ""
    assert doors.peer(ANNA, 1) == "flood of a peer"
    slot = doors._peer_slot  # differs from process to process
    port = next(port for port in range(4009, 5000) if slot((ANNA[0], port)) != slot(ANNA))
    assert doors.peer((ANNA[0], port), 1) == ""


@pytest.mark.parametrize(
    ("address", "network"),
    [
        (("192.0.2.7", 1), "192.0.2.7"),
        (("::ffff:192.0.2.7", 1, 0, 0), "192.0.2.7"),  # else all of IPv4 were one network
        (("2001:db8:1:2:3:4:5:6", 1, 0, 0), "20010db800010002"),
        (("2001:db8:1:2::", 9, 0, 0), "20010db800010002"),
        (("2001:db8:1:3::", 9, 0, 0), "20010db800010003"),
        (("fe80::1%eth0", 1, 0, 2), "fe80000000000000"),
        (("fe80::zz", 1, 0, 2), "fe80::zz"),
        ("peer", "peer"),
        ((), "()"),
        (("\udce9", 1), "\udce9"),
    ],
)
def test_the_network_of_an_address(address: object, network: str) -> None:
    assert network_of(address) == network
    assert Gate(b"s").contact(address, 1) == ""


def test_a_flood_of_forged_addresses_takes_no_memory_and_evicts_nobody() -> None:
    doors = gate(address=Budget(20, 3))
    for _ in range(3):
        doors.contact(ANNA, 1)
    before = size_of(doors)
    for number in range(20_000):
        doors.contact((f"{number % 251}.{number % 241}.{number % 239}.{number % 233}", number), 1)
        doors.peer((f"{number}", number), 1)
    assert size_of(doors) == before
    assert doors.contact(ANNA, 1) == "address budget"  # it is still known


def size_of(doors: Gate) -> int:
    tables = [doors._addresses, doors._shaking, doors._peers, doors._contacts, doors._handshakes]
    return sum(sys.getsizeof(table._full_ns) for table in tables)


def test_where_an_address_falls_is_known_to_nobody_outside() -> None:
    addresses = [(f"10.{number}.0.1", 1) for number in range(200)]
    slots = [[Gate(secret)._slot(address) for address in addresses] for secret in (b"one", b"two")]
    assert sum(one == two for one, two in zip(*slots, strict=True)) <= 5
    assert len(set(slots[0])) >= 180
