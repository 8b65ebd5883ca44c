"""One direction of a network in virtual time: delay, jitter, loss, duplicates, reordering, a rate cap, outages. Sans-IO.

The path of a datagram: outage -> bottleneck queue (rate_kbps) -> loss -> duplication -> delay + jitter (+ hold) -> arrival.
A recorded trace adds its delay and its losses.

The fate of a datagram is drawn by its number, each impairment from its own stream of the seed: payload, times and the other
impairments do not change it. Two runs that differ in loss alone have the same jitter, datagram by datagram, so comparisons are
paired. Outages, traces and the queue depend on time, and draw nothing.

Loss is the Gilbert-Elliott chain with a lossless good and a lossy bad state, stepped once a datagram:
P(bad -> good) = 1 / burst_frames, P(good -> bad) = loss / (burst_frames (1 - loss)), started in its stationary law. So the rate
of loss is `loss`, and a run of losses is burst_frames datagrams long on average. Independent loss has runs of 1 / (1 - loss);
burst_frames = 1 asks for that, and values in between, where losses would repel, are refused.
"""

import heapq
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

from cogrip.protocol.settings.link_profile import Direction, Link, LinkProfile
from cogrip.sim.delay_trace import LOST_NS, DelayTrace, read_trace
from cogrip.sim.outages import NEVER_NS, Outages

HOLD_MS = (10.0, 30.0)
"""A reordered datagram is held back by a further uniform time in this range: 1 to 3 datagrams at 100 a second."""
QUEUE_NS = 500_000_000
"""The bottleneck drops a datagram that would wait longer than this before its first bit leaves."""
HEADER_BYTES = 28
"""IPv4 and UDP headers, which occupy a capped link as well as the payload does."""


class Fate(NamedTuple):
    """The fate of one datagram, the queue apart: extra_ns is jitter and hold, copy_extra_ns None without a copy."""

    lost: bool
    extra_ns: int
    copy_extra_ns: int | None
    held: bool


COUNTERS = ("sent", "delivered", "lost", "duplicated", "held", "reordered", "outage", "queue_dropped", "in_flight")

_CLEAR = Fate(False, 0, None, False)
_LOST = Fate(True, 0, None, False)


def check(profile: LinkProfile) -> None:
    """Check a profile. Raises ValueError, naming value, bound and cure, for one that no link can have."""
    for name in ("delay_ms", "jitter_ms", "rate_kbps"):
        value = getattr(profile, name)
        if not 0.0 <= value < math.inf:
            raise ValueError(f"link {name} = {value} must be finite and at least 0")
    for name in ("duplicate", "reorder"):
        value = getattr(profile, name)
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"link {name} = {value} must be a probability, 0 to 1")
    if not 0.0 <= profile.loss < 1.0:
        raise ValueError(f"link loss = {profile.loss} must be at least 0 and below 1")
    independent = 1.0 / (1.0 - profile.loss)
    burst = profile.burst_frames
    if not 1.0 <= burst < math.inf or (burst != 1.0 and burst < independent * (1.0 - 1e-9)):
        raise ValueError(
            f"link burst_frames = {burst} is out of reach at loss = {profile.loss}: independent losses already "
            f"come in runs of {independent:.4g}; give 1 for those, or at least {independent:.4g}"
        )


def _losses(profile: LinkProfile, seed: str) -> Iterator[bool]:
    """Step the Gilbert-Elliott chain, once a datagram: True is lost."""
    draw = Random(f"{seed}/loss").random
    loss = profile.loss
    if profile.burst_frames == 1.0:
        enter = stay = loss
    else:
        enter = loss / (profile.burst_frames * (1.0 - loss))
        stay = 1.0 - 1.0 / profile.burst_frames
    lost = draw() < loss
    while True:
        yield lost
        lost = draw() < (stay if lost else enter)


def _jitters(jitter_ms: float, seed: str) -> Iterator[int]:
    """Draw jitter in ns, gamma of shape 2 and mean jitter_ms: the sum of two exponentials, always two draws."""
    draw = Random(seed).random
    scale_ns = jitter_ms * 1e6 / 2.0
    log = math.log
    while True:
        yield int(0.5 - scale_ns * log((1.0 - draw()) * (1.0 - draw())))


def fates(profile: LinkProfile, seed: str) -> Iterator[Fate]:
    """Return the fates of datagrams 0, 1, 2, ... on this link, without end. Raises ValueError for an impossible profile."""
    check(profile)
    return _fates(profile, seed)


def _fates(profile: LinkProfile, seed: str) -> Iterator[Fate]:
    duplicate, reorder = profile.duplicate, profile.reorder
    losses = _losses(profile, seed) if profile.loss else None
    jitters = _jitters(profile.jitter_ms, f"{seed}/jitter") if profile.jitter_ms else None
    copy_jitters = _jitters(profile.jitter_ms, f"{seed}/copy-jitter")
    draw_copy = Random(f"{seed}/duplicate").random
    draw_hold = Random(f"{seed}/reorder").random
    hold_ns, hold_span_ns = HOLD_MS[0] * 1e6, (HOLD_MS[1] - HOLD_MS[0]) * 1e6
    if losses is None and jitters is None and not duplicate and not reorder:
        while True:
            yield _CLEAR
    while True:
        # Every stream advances by the same number of draws a datagram, lost or not: that keeps comparisons paired.
        extra_ns = next(jitters) if jitters is not None else 0
        copy_extra_ns = None
        held = False
        if duplicate:
            copy_jitter_ns = next(copy_jitters)
            if draw_copy() < duplicate:
                copy_extra_ns = copy_jitter_ns
        if reorder:
            chance, share = draw_hold(), draw_hold()
            if chance < reorder:
                held = True
                extra_ns += int(hold_ns + share * hold_span_ns)
        if losses is not None and next(losses):
            yield _LOST
        else:
            yield Fate(False, extra_ns, copy_extra_ns, held)


class LinkEmulator:
    """One direction of a link: datagrams in by `send`, out by `due`. Two directions are two emulators, two seeds.

    At any time sent + duplicated = delivered + outage + queue_dropped + lost + in_flight.

    next_ns  time of the next arrival; None when nothing is under way
    """

    __slots__ = (
        "_busy_ns", "_check_ns", "_delay_ns", "_fates", "_flight", "_highest", "_ns_per_byte", "_origin_ns", "_outages",
        "_trace", "delivered", "duplicated", "held", "lost", "next_ns", "outage", "queue_dropped", "reordered", "sent",
    )  # fmt: skip

    def __init__(
        self,
        profile: LinkProfile,
        seed: str,
        outages: Iterable[tuple[float, float]] = (),
        trace: DelayTrace | None = None,
        origin_ns: int | None = None,
    ) -> None:
        """Prepare an idle link. Raises ValueError for an impossible one.

        outages: by script, (start_s, length_s) of each, besides the profile's; trace: further delays and losses; origin_ns: the
        time that these and the periodic outages count from, else that of the first datagram.
        """
        self._fates = fates(profile, seed)
        self._outages = Outages(profile.outage_s, profile.outage_every_s, outages)
        self._trace = trace
        self._origin_ns = origin_ns
        self._check_ns = -NEVER_NS if self._outages else NEVER_NS  # until then the link is up
        self._delay_ns = round(profile.delay_ms * 1e6)
        self._ns_per_byte = 8e6 / profile.rate_kbps if profile.rate_kbps else 0.0
        self._busy_ns: int | None = None  # when the bottleneck falls idle
        self._flight: list[tuple[int, int, int, bytes]] = []  # arrival_ns, number, 0 or 1 for a copy, payload
        self.next_ns: int | None = None
        self._highest = -1
        self.sent = 0
        self.delivered = 0
        self.lost = 0
        self.duplicated = 0  # copies made
        self.held = 0  # held back by `reorder`
        self.reordered = 0  # delivered after one that was sent later, by hold or jitter
        self.outage = 0  # sent while the link was down
        self.queue_dropped = 0

    @property
    def in_flight(self) -> int:
        """The number of datagrams and copies under way."""
        return len(self._flight)

    @property
    def counters(self) -> dict[str, int]:
        """Every counter by name."""
        return {name: getattr(self, name) for name in COUNTERS}

    def send(self, payload: bytes, now_ns: int) -> None:
        """Put a datagram on the link at now_ns, which never falls."""
        number = self.sent
        self.sent = number + 1
        lost, extra_ns, copy_extra_ns, held = next(self._fates)
        if now_ns >= self._check_ns and self._down_at(now_ns):
            self.outage += 1
            return
        leaves_ns = now_ns
        if self._ns_per_byte:
            queued_ns = self._queue(len(payload), now_ns)
            if queued_ns is None:
                self.queue_dropped += 1
                return
            leaves_ns = queued_ns
        arrival_ns = leaves_ns + self._delay_ns
        if self._trace is not None:
            traced_ns = self._trace.delay_ns(self._elapsed_ns(now_ns))
            lost = lost or traced_ns == LOST_NS
            arrival_ns += traced_ns
        if lost:
            self.lost += 1
            return
        heapq.heappush(self._flight, (arrival_ns + extra_ns, number, 0, payload))
        if held:
            self.held += 1
        if copy_extra_ns is not None:
            self.duplicated += 1
            heapq.heappush(self._flight, (arrival_ns + copy_extra_ns, number, 1, payload))
        self.next_ns = self._flight[0][0]

    def _down_at(self, now_ns: int) -> bool:
        """Return whether the link is down now; if not, `_check_ns` is when it next will be."""
        elapsed_ns = self._elapsed_ns(now_ns)
        if self._outages.down_at(elapsed_ns):
            return True
        self._check_ns = now_ns - elapsed_ns + self._outages.next_begin_ns(elapsed_ns)
        return False

    def _elapsed_ns(self, now_ns: int) -> int:
        """Return the time since the link's origin, which is now if it has none yet."""
        if self._origin_ns is None:
            self._origin_ns = now_ns
        return now_ns - self._origin_ns

    def _queue(self, size: int, now_ns: int) -> int | None:
        """Return when the datagram's last bit leaves the bottleneck, or None when the queue is full."""
        starts_ns = now_ns if self._busy_ns is None or self._busy_ns < now_ns else self._busy_ns
        if starts_ns - now_ns > QUEUE_NS:
            return None
        self._busy_ns = starts_ns + round((size + HEADER_BYTES) * self._ns_per_byte)
        return self._busy_ns

    def due(self, now_ns: int) -> list[bytes]:
        """Remove and return what has arrived by now_ns, in order of arrival, ties in order of sending."""
        return [payload for _, payload in self.arrivals(now_ns)]

    def arrivals(self, now_ns: int) -> list[tuple[int, bytes]]:
        """Remove and return what has arrived by now_ns, each with its time."""
        flight = self._flight
        arrived: list[tuple[int, bytes]] = []
        while flight and flight[0][0] <= now_ns:
            at_ns, number, copy, payload = heapq.heappop(flight)
            arrived.append((at_ns, payload))
            if number > self._highest:
                self._highest = number
            elif number < self._highest and not copy:
                self.reordered += 1
        self.delivered += len(arrived)
        self.next_ns = flight[0][0] if flight else None
        return arrived


def configured_link(
    link: Link,
    direction: Direction,
    seed: str,
    outages: Iterable[tuple[float, float]] = (),
    origin_ns: int | None = None,
) -> LinkEmulator:
    """Return one direction of [link], with what a welcome does not carry: scripts of outages, and a recorded trace.

    outages: (start_s, length_s) of each, besides [link]'s; origin_ns: the time that outages and trace count from, else that of
    the first datagram. Raises TraceError where its trace cannot be read.
    """
    path = link.trace_of(direction)
    trace = read_trace(Path(path)) if path else None
    return LinkEmulator(link.direction(direction), seed, (*link.script(direction), *outages), trace, origin_ns)
