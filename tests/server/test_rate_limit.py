"""Budgets: both sides of each boundary, who shares a bucket, and that nothing grows."""

import heapq
import random
import sys
from array import array
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.server.rate_limit import (
    ADDRESS_SLOTS,
    LIMITS,
    NEW,
    NEW_NS,
    REPEATED,
    SEATED_NS,
    Budget,
    Limits,
    RateLimiter,
    limits_for,
    network_of,
)

from tests.extent import long

PLENTY = Budget(1_000_000, 1_000_000)
OPEN = Limits(PLENTY, PLENTY, PLENTY, PLENTY)
ANNA, BEN = ("10.0.0.1", 4001), ("10.0.0.2", 4002)


def rate_limiter(**limits: Budget) -> RateLimiter:
    return RateLimiter(b"secret of a test", OPEN._replace(**limits))


@pytest.mark.parametrize(
    ("query", "budget", "says"),
    [
        ("contact", "address", "address budget"),
        ("contact", "contacts", "contact budget"),
        ("handshake", "address", "address budget"),
        ("handshake", "handshakes", "handshake budget"),
        ("peer", "peer", "flood of a peer"),
    ],
)
def test_a_budget_gives_its_burst_then_its_rate(query: str, budget: str, says: str) -> None:
    ask = getattr(repeated(rate_limiter(**{budget: Budget(10, 3)})), query)
    now_ns = 5_000_000_000
    assert [ask(ANNA, now_ns) for _ in range(5)] == ["", "", "", says, says]
    assert ask(ANNA, now_ns + 99_999_999) == says
    assert ask(ANNA, now_ns + 100_000_000) == ""
    assert ask(ANNA, now_ns + 199_999_999) == says
    assert ask(ANNA, now_ns + 200_000_000) == ""
    later_ns = now_ns + NEW_NS - 1_000_000_000  # however long it rested, there is one burst
    assert [ask(ANNA, later_ns) for _ in range(5)] == ["", "", "", says, says]


def repeated(limiter: RateLimiter) -> RateLimiter:
    """Return a limiter that let all addresses through just now: they spend the budget of repeated ones."""
    for seen_ns in (limiter._contact_ns, limiter._handshake_ns):
        seen_ns[:] = array("q", [5_000_000_000]) * ADDRESS_SLOTS
    return limiter


def test_the_limits_that_are_there_by_default() -> None:
    assert Limits() == LIMITS == Limits(Budget(20, 250), Budget(300, 600), Budget(100, 50), Budget(512, 512))
    assert limits_for(1024).peer == Budget(4096, 4096)
    limiter, now_ns = repeated(RateLimiter(b"s")), 5_000_000_000
    assert [limiter.handshake((f"10.0.{number}.1", 1), now_ns) for number in range(51)].count("") == 50
    assert [limiter.contact((f"10.0.{number >> 8}.{number & 255}", 1), now_ns) for number in range(601)].count(
        ""
    ) == 600
    laboratory = [limiter.contact(("192.0.2.1", 1000 + number), 10**10) for number in range(251)]
    assert laboratory == [""] * 250 + ["address budget"]


@given(
    rate=st.integers(1, 5000), burst=st.integers(1, 50), gaps_ms=st.lists(st.integers(0, 400), min_size=1, max_size=150)
)
def test_a_budget_is_a_token_bucket(rate: int, burst: int, gaps_ms: list[int]) -> None:
    """Against a bucket of exact fractions."""
    limiter = rate_limiter(peer=Budget(rate, burst))
    tokens, now_ns = Fraction(burst), 1_000_000_000
    each_ns = 1_000_000_000 // rate
    for gap_ms in gaps_ms:
        now_ns += gap_ms * 1_000_000
        tokens = min(Fraction(burst), tokens + Fraction(gap_ms * 1_000_000, each_ns))
        passes = limiter.peer(ANNA, now_ns) == ""
        assert passes == (tokens >= 1)
        tokens -= passes


def test_one_address_spends_its_own_budget_whatever_its_port() -> None:
    limiter = rate_limiter(address=Budget(10, 2))
    assert [limiter.contact((ANNA[0], port), 1) for port in (1, 2, 3)] == ["", "", "address budget"]
    assert [limiter.handshake((ANNA[0], port), 1) for port in (1, 2, 3)] == ["", "", "address budget"]
    assert limiter.contact(BEN, 1) == limiter.handshake(BEN, 1) == ""


@pytest.mark.parametrize(("query", "budget"), [("contact", "contacts"), ("handshake", "handshakes")])
def test_each_class_of_addresses_has_a_budget_of_its_own(query: str, budget: str) -> None:
    limiter = rate_limiter(**{budget: Budget(10, 4)})
    ask = getattr(limiter, query)
    says = f"{query} budget"
    limiter.seated(ANNA, 0)
    flood = [ask((f"10.66.{number}.1", 1), 0) for number in range(50)]
    assert flood == [""] * 4 + [says] * 46
    assert ask(BEN, 0) == says, "new, as they are"
    assert [ask((ANNA[0], port), 0) for port in range(5)] == [""] * 4 + [says], "whatever the port"
    assert [ask(("10.66.0.1", port), 0) for port in range(5)] == [""] * 4 + [says], "come before, and come again"
    later_ns = NEW_NS - 1
    assert [ask(("10.66.1.1", 1), later_ns), ask(("10.66.2.1", 1), NEW_NS)] == ["", ""]
    classes = limiter._contacts if query == "contact" else limiter._handshakes
    assert classes._full_ns[REPEATED] > classes._full_ns[NEW] - 1_000_000_000 > 0
    assert limiter.was_seated(ANNA, SEATED_NS - 1)
    assert not limiter.was_seated(ANNA, SEATED_NS)


ATTACKERS, EACH_PER_S, NEWCOMERS = 250, 20, 60
PATIENCE_S = (0.5, 0.7, 0.9)  # of a client, `sealed_call.PATIENCE_NS`
GIVE_UP_S = 10.0
MOST_SHUT_OUT = 0.03  # one in 260 has the bucket of an attacker's address


@pytest.mark.long
@pytest.mark.parametrize("had_seat", [long(False), True])
def test_hundreds_of_addresses_with_cookies_shut_hardly_anybody_out(had_seat: bool) -> None:
    """They ask as often as one address may, all the time; each newcomer dials as a client does, and comes once."""
    chance, limiter, start_ns = random.Random(3), RateLimiter(b"s" * 16), 10**13
    queue: list[tuple[float, str, str, int]] = []
    for attacker in range(ATTACKERS):
        phase_s = chance.random() / EACH_PER_S
        asked = range(EACH_PER_S * 25)
        queue += [(phase_s + turn / EACH_PER_S, "attack", f"10.66.0.{attacker}", 0) for turn in asked]
    begun_s = {f"10.1.0.{number}": 5.0 + 0.1 * number for number in range(NEWCOMERS)}
    for host, at_s in begun_s.items():
        queue.append((at_s, "dial", host, 0))
        if had_seat:
            limiter.seated((host, 1), start_ns)
    heapq.heapify(queue)
    inside: set[str] = set()
    while queue and len(inside) < NEWCOMERS:
        at_s, what, host, dials = heapq.heappop(queue)
        now_ns = start_ns + round(at_s * 1e9)
        if what == "attack":
            limiter.contact((host, 1), now_ns)
            limiter.handshake((host, 1), now_ns)
        elif host in inside or at_s - begun_s[host] > GIVE_UP_S:
            continue
        elif what == "dial":
            heapq.heappush(queue, (at_s + PATIENCE_S[min(dials, 2)], "dial", host, dials + 1))
            if not limiter.contact((host, 1), now_ns):
                heapq.heappush(queue, (at_s + 0.05, "cookie", host, 0))
        elif not limiter.handshake((host, 1), now_ns):
            inside.add(host)
    assert 1.0 - len(inside) / NEWCOMERS <= MOST_SHUT_OUT


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
    assert RateLimiter(b"s").contact(address, 1) == ""


def test_a_flood_of_forged_addresses_takes_no_memory_and_evicts_nobody() -> None:
    limiter = rate_limiter(address=Budget(20, 3))
    for _ in range(3):
        limiter.contact(ANNA, 1)
    before = size_of(limiter)
    for number in range(20_000):
        limiter.contact((f"{number % 251}.{number % 241}.{number % 239}.{number % 233}", number), 1)
        limiter.peer((f"{number}", number), 1)
    assert size_of(limiter) == before
    assert limiter.contact(ANNA, 1) == "address budget"  # it is still known


def size_of(limiter: RateLimiter) -> int:
    tables = [limiter._addresses, limiter._shaking, limiter._peers, limiter._contacts, limiter._handshakes]
    times = [limiter._seated_ns, limiter._contact_ns, limiter._handshake_ns]
    return sum(map(sys.getsizeof, [*times, *(table._full_ns for table in tables)]))


def test_where_an_address_falls_is_known_to_nobody_outside() -> None:
    addresses = [(f"10.{number}.0.1", 1) for number in range(200)]
    slots = [[RateLimiter(secret)._slot(address) for address in addresses] for secret in (b"one", b"two")]
    assert sum(one == two for one, two in zip(*slots, strict=True)) <= 5
    assert len(set(slots[0])) >= 180
