"""Tests of the relay's core: flows, bounds, counters, and fates equal to the laboratory's, datagram by datagram."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.settings.link_profile import Direction, Link
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import resolve
from cogrip.sim.laboratory import Laboratory
from cogrip.sim.link import configured_link
from cogrip.sim.relay import KEEPING_BYTES, Relay

MS = 1_000_000
DIRECTIONS: tuple[Direction, Direction] = ("up", "down")
STEADY = {
    "delay_ms": 20.0, "jitter_ms": 15.0, "loss": 0.3, "burst_frames": 3.0, "duplicate": 0.2, "reorder": 0.1,
    "rate_kbps": 500.0,
}  # fmt: skip
ROUGH = {**STEADY, "outage_s": 0.2, "outage_every_s": 1.0, "outages": [[0.3, 0.05]]}
"""Outages count from the relay's first datagram, in the laboratory from each link's."""


def link_of(**keys: object) -> Link:
    return resolve({"link": keys}).link


def relay_of(link: Link, seed: int = 7, **bounds: int) -> Relay:
    return Relay(
        lambda n, direction, origin_ns: configured_link(link, direction, f"{seed}/{n}/{direction}", (), origin_ns),
        **bounds,
    )


def drained(relay: Relay, until_ns: int) -> list[tuple[int, int, Direction, bytes]]:
    """Return (time, flow, direction, datagram) of all that leaves, each at its time."""
    found = []
    while (next_ns := relay.next_ns) is not None and next_ns <= until_ns:
        relay.due(next_ns)
        found += [(next_ns, lane.flow.number, lane.direction, datagram) for lane, datagram in relay.outbox]
        relay.outbox.clear()
    return found


@pytest.mark.parametrize("keys", [STEADY, *({"profile": name} for name in PROFILES)])
def test_its_fates_are_those_of_the_laboratorys_links(keys: dict) -> None:
    """The same datagrams at the same times, of three people in both directions, leave at the same times."""
    link, origin_ns, chance = link_of(**keys), 10**12, Random(3)
    relay = relay_of(link)
    people = Laboratory(resolve({"seed": 7, "link": keys, "users": [{"name": name} for name in "abc"]})).people
    links = {(n, direction): getattr(people[n], direction) for n in range(3) for direction in DIRECTIONS}
    flows = {}
    expected: list[tuple[int, int, Direction, bytes]] = []
    got: list[tuple[int, int, Direction, bytes]] = []

    def up_to(now_ns: int) -> None:
        got.extend(drained(relay, now_ns))
        for (n, direction), each in links.items():
            while (next_ns := each.next_ns) is not None and next_ns <= now_ns:
                expected.extend((next_ns, n, direction, datagram) for datagram in each.due(next_ns))

    for frame in range(400):
        for n in range(3):
            now_ns = origin_ns + frame * 7_812_500 + n * 1_000_000
            up_to(now_ns)
            for direction in DIRECTIONS:
                datagram = f"{frame} {n} {direction} ".encode() + bytes(chance.randrange(300))
                links[n, direction].send(datagram, now_ns)
                if direction == "up":
                    flows[n] = relay.from_client(datagram, n, now_ns)
                else:
                    relay.from_server(datagram, flows[n], now_ns)
    up_to(origin_ns + 10**11)
    assert sorted(got) == sorted(expected)
    assert len(got) > 1000
    assert [each[0] for each in got] == sorted(each[0] for each in got), "in order of arrival over all flows"
    for (n, direction), each in links.items():
        lane = flows[n].up if direction == "up" else flows[n].down
        assert lane.link.counters == each.counters
    assert relay.held_bytes == 0


def test_what_is_not_delayed_is_due_at_once() -> None:
    relay = relay_of(link_of())
    flow = relay.from_client(b"up", "a", 5)
    relay.due(5)
    assert [(lane.direction, datagram) for lane, datagram in relay.outbox] == [("up", b"up")]
    relay.from_server(b"down", flow, 6)
    assert relay.next_ns == 6
    relay.due(6)
    assert relay.outbox[-1] == (flow.down, b"down")
    assert relay.next_ns is None


def test_outages_hit_every_flow_and_direction_at_once() -> None:
    relay = relay_of(link_of(outage_s=0.5, outage_every_s=3.0))
    relay.from_client(b"0", "first", 1_000 * MS)  # all count from here
    late = relay.from_client(b"1", "late", 3_900 * MS)
    down = relay.from_client(b"2", "late", 4_000 * MS)
    relay.from_server(b"3", down, 4_499 * MS)
    relay.from_server(b"4", down, 4_500 * MS)
    assert late is down
    assert [each[3] for each in drained(relay, 10**12)] == [b"0", b"1", b"4"]
    assert (relay.totals("up")["outage"], relay.totals("down")["outage"]) == (1, 1)


def test_clients_beyond_the_limit_are_counted_and_get_nothing() -> None:
    relay = relay_of(link_of(), most_flows=2)
    assert [relay.from_client(b"x", address, 0) is not None for address in "abca"] == [True, True, False, True]
    assert (relay.beyond_limit, relay.begun, len(relay.flows)) == (1, 2, 2)


def test_an_idle_flow_expires_once_nothing_is_under_way_and_its_counts_stay() -> None:
    relay = relay_of(link_of(delay_ms=5_000.0), most_flows=1, idle_ns=1_000 * MS)
    flow = relay.from_client(b"x", "a", 0)
    assert relay.expire(999 * MS) == []
    assert relay.expire(1_000 * MS) == [], "its datagram is under way"
    assert len(drained(relay, 5_000 * MS)) == 1
    assert relay.expire(5_000 * MS) == [flow]
    assert (relay.expired, relay.flows) == (1, {})
    assert relay.totals("up")["delivered"] == 1
    again = relay.from_client(b"y", "a", 6_000 * MS)
    assert again.number == 1, "a number is never given twice: another one's fates"
    assert relay.totals("up")["sent"] == 2


def test_either_end_keeps_a_flow() -> None:
    relay = relay_of(link_of(), idle_ns=1_000 * MS)
    flow = relay.from_client(b"x", "a", 0)
    relay.from_server(b"y", flow, 900 * MS)
    relay.due(900 * MS)
    assert relay.expire(1_800 * MS) == []
    assert relay.expire(1_900 * MS) == [flow]


@pytest.mark.parametrize("size", [0, 100])
def test_memory_is_bounded(size: int) -> None:
    relay = relay_of(link_of(delay_ms=1_000.0, duplicate=0.5), most_held_bytes=30_000)
    for number in range(200):
        relay.from_client(bytes(size), "a", number)
        assert relay.held_bytes <= 30_000
    totals = relay.totals("up")
    each = size + KEEPING_BYTES
    assert totals["crowded"] == 200 - totals["sent"] > 0
    assert relay.held_bytes == each * totals["in_flight"]
    assert relay.held_bytes > 30_000 - 2 * each
    drained(relay, 10**10)
    assert relay.held_bytes == 0


@given(
    st.lists(
        st.tuples(st.sampled_from(["a", "b", "c"]), st.booleans(), st.integers(0, 30 * MS), st.integers(0, 1200)),
        max_size=60,
    ),
    st.booleans(),
)
def test_nothing_appears_or_vanishes(events: list[tuple[str, bool, int, int]], lazily: bool) -> None:
    """The same datagrams leave in the same order, however often the relay is asked."""
    link = link_of(**ROUGH)
    eager, lazy = relay_of(link), relay_of(link)
    now_ns, got, late = 0, [], []
    for address, up, gap_ns, size in events:
        now_ns += gap_ns
        got += [each[1:] for each in drained(eager, now_ns)]
        if lazily:
            lazy.due(now_ns)
        for relay in (eager, lazy):
            flow = relay.flows.get(address)
            if up or flow is None:
                relay.from_client(bytes(size), address, now_ns)
            else:
                relay.from_server(bytes(size), flow, now_ns)
            for direction in DIRECTIONS:
                each = relay.totals(direction)
                gone = each["lost"] + each["queue_dropped"] + each["outage"]
                assert each["sent"] + each["duplicated"] == each["delivered"] + gone + each["in_flight"]
    got += [each[1:] for each in drained(eager, now_ns + 10**12)]
    lazy.due(now_ns + 10**12)
    late = [(lane.flow.number, lane.direction, datagram) for lane, datagram in lazy.outbox]
    assert got == late
    assert eager.held_bytes == lazy.held_bytes == 0
    assert all(eager.totals(direction) == lazy.totals(direction) for direction in DIRECTIONS)


def test_lateness_is_counted() -> None:
    relay = relay_of(link_of(delay_ms=10.0))
    relay.from_client(b"x", "a", 0)
    relay.from_client(b"y", "a", 5 * MS)
    relay.due(18 * MS)
    assert (relay.late["up"].count, relay.late["up"].max_ns, relay.late["up"].total_ns) == (2, 8 * MS, 11 * MS)
    assert relay.late["down"].count == 0
