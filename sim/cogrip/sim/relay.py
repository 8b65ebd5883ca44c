"""A UDP relay between any two programs: every client is a flow, each direction an emulated link. Sans-IO.

Flow n is the n-th new address, from 0. Its directions are emulated as the laboratory emulates those of seat n: the same
profile and the seeds SEED/n/up and SEED/n/down, so the same fate for the same datagram number. Outages and traces, which count
from each link's first datagram in the laboratory, count from the first datagram of all here: the network is one.

A driver feeds datagrams, asks `next_ns` when to call again, calls `due`, and sends what `outbox` holds.
"""

import heapq
from collections import Counter, deque
from collections.abc import Callable, Hashable

from cogrip.machine.histogram import DurationHistogram
from cogrip.protocol.settings.link_profile import Direction
from cogrip.sim.link import COUNTERS, LinkEmulator

Address = Hashable
MakeLink = Callable[[int, Direction, int], LinkEmulator]
"""Function that makes a link, from a flow number, a direction, and the time that outages and traces count from [ns]."""

MOST_FLOWS = 64
IDLE_NS = 60_000_000_000
MOST_HELD_BYTES = 64 << 20
"""Most bytes of all datagrams under way. Forty people at 128 Hz over the longest delay hold 54 MB."""
KEEPING_BYTES = 200  # approximate memory of a datagram beside its content: objects, its place in the queue

OWN_COUNTERS = ("crowded", "not_sent", "refused")
"""Counters beside the link's: datagrams for which MOST_HELD_BYTES had no room; those that the socket refused; those that an
ICMP error refused."""


class Lane:
    """One direction of a flow: its link, and counters of its datagrams."""

    __slots__ = ("bytes_in", "bytes_out", "crowded", "direction", "flow", "link", "not_sent", "refused")

    def __init__(self, flow: "Flow", direction: Direction, link: LinkEmulator) -> None:
        self.flow = flow
        self.direction = direction
        self.link = link
        self.bytes_in = self.bytes_out = 0  # of what came in; of what the link delivered
        self.crowded = self.not_sent = self.refused = 0

    def counters(self) -> dict[str, int]:
        """Return every counter by name."""
        own = {name: getattr(self, name) for name in ("bytes_in", "bytes_out", *OWN_COUNTERS)}
        return {**self.link.counters, **own}


class Flow:
    """One client, and both directions of its path to the server."""

    __slots__ = ("address", "down", "heard_ns", "number", "up")

    def __init__(self, number: int, address: Address, make_link: MakeLink, origin_ns: int) -> None:
        self.number = number
        self.address = address
        self.up = Lane(self, "up", make_link(number, "up", origin_ns))
        self.down = Lane(self, "down", make_link(number, "down", origin_ns))
        self.heard_ns = 0  # time of the last datagram of either end

    @property
    def lanes(self) -> tuple[Lane, Lane]:
        return self.up, self.down


class Relay:
    """All flows. late: by how much after its time each datagram was put into `outbox`, the error of the emulation."""

    def __init__(
        self,
        make_link: MakeLink,
        most_flows: int = MOST_FLOWS,
        idle_ns: int = IDLE_NS,
        most_held_bytes: int = MOST_HELD_BYTES,
    ) -> None:
        self.flows: dict[Address, Flow] = {}
        self.outbox: deque[tuple[Lane, bytes]] = deque()
        self.beyond_limit = 0  # datagrams of addresses beyond the limit of flows
        self.expired = 0  # flows
        self.begun = 0  # flows
        self.held_bytes = 0
        self.late: dict[Direction, DurationHistogram] = {"up": DurationHistogram(), "down": DurationHistogram()}
        self._make_link = make_link
        self._most_flows = most_flows
        self._idle_ns = idle_ns
        self._most_held_bytes = most_held_bytes
        self._origin_ns: int | None = None
        self._turns: list[tuple[int, int, int, Lane]] = []  # heap of (ns when due, flow, direction, lane)
        self._gone: dict[Direction, Counter[str]] = {"up": Counter(), "down": Counter()}  # counters of expired flows

    def from_client(self, datagram: bytes, address: Address, now_ns: int) -> Flow | None:
        """Accept a client's datagram, and return its flow; None for a new client beyond the limit of flows."""
        flow = self.flows.get(address)
        if flow is None:
            if len(self.flows) >= self._most_flows:
                self.beyond_limit += 1
                return None
            if self._origin_ns is None:
                self._origin_ns = now_ns
            flow = self.flows[address] = Flow(self.begun, address, self._make_link, self._origin_ns)
            self.begun += 1
        self._push(flow.up, datagram, now_ns)
        return flow

    def from_server(self, datagram: bytes, flow: Flow, now_ns: int) -> None:
        """Accept the server's datagram to that flow's client."""
        self._push(flow.down, datagram, now_ns)

    def _push(self, lane: Lane, datagram: bytes, now_ns: int) -> None:
        lane.flow.heard_ns = now_ns
        size = len(datagram) + KEEPING_BYTES
        if self.held_bytes + 2 * size > self._most_held_bytes:
            lane.crowded += 1
            return
        link = lane.link
        next_ns, flying = link.next_ns, link.in_flight
        link.send(datagram, now_ns)
        lane.bytes_in += len(datagram)
        if (more := link.in_flight - flying) and (first_ns := link.next_ns) is not None:
            self.held_bytes += more * size
            if next_ns is None or first_ns < next_ns:
                heapq.heappush(self._turns, (first_ns, lane.flow.number, lane.direction == "down", lane))

    @property
    def next_ns(self) -> int | None:
        """The time of the next arrival; None while nothing is under way."""
        return self._turns[0][0] if self._turns else None

    def due(self, now_ns: int) -> None:
        """Put what has arrived by now into `outbox`, in order of arrival over all flows."""
        turns = self._turns
        while turns and turns[0][0] <= now_ns:
            at_ns, number, direction, lane = heapq.heappop(turns)
            link = lane.link
            if link.next_ns != at_ns:  # a later datagram was due earlier, and took this turn
                continue
            for datagram in link.due(at_ns):
                self.outbox.append((lane, datagram))
                self.late[lane.direction].add(now_ns - at_ns)
                lane.bytes_out += len(datagram)
                self.held_bytes -= len(datagram) + KEEPING_BYTES
            if link.next_ns is not None:
                heapq.heappush(turns, (link.next_ns, number, direction, lane))

    def expire(self, now_ns: int) -> list[Flow]:
        """End flows without a datagram for so long, once nothing of theirs is under way, and return them."""
        over = [
            flow
            for flow in self.flows.values()
            if now_ns - flow.heard_ns >= self._idle_ns and not any(lane.link.in_flight for lane in flow.lanes)
        ]
        for flow in over:
            del self.flows[flow.address]
            self.expired += 1
            for lane in flow.lanes:
                self._gone[lane.direction].update(lane.counters())
        return over

    def totals(self, direction: Direction) -> dict[str, int]:
        """Return every counter of a direction over all flows, expired ones too, by name."""
        total = Counter(dict.fromkeys(("bytes_in", "bytes_out", *COUNTERS, *OWN_COUNTERS), 0))
        total.update(self._gone[direction])
        for flow in self.flows.values():
            total.update((flow.up if direction == "up" else flow.down).counters())
        return dict(total)
