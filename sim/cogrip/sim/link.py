"""One direction of a network in virtual time: delay, jitter, loss, duplicates, reordering, a rate cap. Sans-IO.

The path of a datagram: bottleneck queue (rate_kbps) -> loss -> duplication -> delay + jitter (+ hold) -> arrival.

Fates are drawn by datagram number, each impairment from its own stream of the seed: payloads, the times of send and due
and the other impairments do not touch them. Two runs that differ in loss only have the same jitter, datagram by
datagram, so comparisons are paired. Only the queue looks at sizes and times, and it draws nothing.

Loss is the Gilbert-Elliott chain with a lossless good and a lossy bad state, stepped once a datagram:
P(bad -> good) = 1 / burst_frames, P(good -> bad) = loss / (burst_frames (1 - loss)), started in its stationary law. So
the rate of loss is `loss` and a run of losses is burst_frames datagrams long on average. Independent loss has runs of
1 / (1 - loss); burst_frames = 1 asks for just that, and values in between, where losses would repel, are refused.
"""

import heapq
import math
from collections.abc import Iterator
from random import Random
from typing import NamedTuple, Protocol

HOLD_MS = (10.0, 30.0)
"""A reordered datagram is held back by a further uniform time in this range: 1 to 3 datagrams at 100 a second."""
QUEUE_NS = 500_000_000
"""The bottleneck drops a datagram that would wait longer than this before its first bit leaves."""
HEADER_BYTES = 28
"""IPv4 and UDP headers, which occupy a capped link as well as the payload does."""


class LinkProfile(Protocol):
    """What a link does to datagrams. Any object with these attributes will do."""

    @property
    def delay_ms(self) -> float:
        """Constant one-way delay."""

    @property
    def jitter_ms(self) -> float:
        """Mean of the extra delay, gamma of shape 2, drawn for every datagram: they may overtake one another."""

    @property
    def loss(self) -> float:
        """Stationary rate of loss, 0 <= loss < 1."""

    @property
    def burst_frames(self) -> float:
        """Mean length of a run of lost datagrams: 1 (independent) or at least 1 / (1 - loss)."""

    @property
    def duplicate(self) -> float:
        """Probability that a datagram arrives twice; the copy draws its own jitter."""

    @property
    def reorder(self) -> float:
        """Probability that a datagram is held back by HOLD_MS."""

    @property
    def rate_kbps(self) -> float:
        """Bottleneck in kbit/s, 0 for none."""


class Fate(NamedTuple):
    """What happens to one datagram, the queue apart: extra_ns is jitter and hold, copy_extra_ns None without a copy."""

    lost: bool
    extra_ns: int
    copy_extra_ns: int | None
    held: bool


_CLEAR = Fate(False, 0, None, False)
_LOST = Fate(True, 0, None, False)


def check(profile: LinkProfile) -> None:
    """Raises ValueError, naming value, bound and cure, for a profile no link can have."""
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
    """The Gilbert-Elliott chain, one step a datagram: True is lost."""
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
    """Gamma of shape 2 and mean jitter_ms, in ns: the sum of two exponentials, always two draws."""
    draw = Random(seed).random
    scale_ns = jitter_ms * 1e6 / 2.0
    log = math.log
    while True:
        yield int(0.5 - scale_ns * log((1.0 - draw()) * (1.0 - draw())))


def fates(profile: LinkProfile, seed: str) -> Iterator[Fate]:
    """The fate of datagram 0, 1, 2, ... on this link, without end. Raises ValueError for an impossible profile."""
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

    At any time sent + duplicated = delivered + lost + queue_dropped + in_flight.
    """

    __slots__ = (
        "_busy_ns",
        "_delay_ns",
        "_fates",
        "_flight",
        "_highest",
        "_ns_per_byte",
        "delivered",
        "duplicated",
        "held",
        "lost",
        "queue_dropped",
        "reordered",
        "sent",
    )

    def __init__(self, profile: LinkProfile, seed: str) -> None:
        self._fates = fates(profile, seed)
        self._delay_ns = round(profile.delay_ms * 1e6)
        self._ns_per_byte = 8e6 / profile.rate_kbps if profile.rate_kbps else 0.0
        self._busy_ns: int | None = None  # when the bottleneck falls idle
        self._flight: list[tuple[int, int, int, bytes]] = []  # arrival_ns, number, 0 or 1 for a copy, payload
        self._highest = -1
        self.sent = 0
        self.delivered = 0
        self.lost = 0
        self.duplicated = 0  # copies made
        self.held = 0  # held back by `reorder`
        self.reordered = 0  # delivered after one that was sent later, by hold or jitter
        self.queue_dropped = 0

    @property
    def in_flight(self) -> int:
        """Datagrams and copies under way."""
        return len(self._flight)

    @property
    def next_ns(self) -> int | None:
        """When the next datagram arrives; None when none is under way."""
        return self._flight[0][0] if self._flight else None

    @property
    def counters(self) -> dict[str, int]:
        """Every counter by name."""
        names = ("sent", "delivered", "lost", "duplicated", "held", "reordered", "queue_dropped", "in_flight")
        return {name: getattr(self, name) for name in names}

    def send(self, payload: bytes, now_ns: int) -> None:
        """Puts a datagram on the link at now_ns."""
        number = self.sent
        self.sent = number + 1
        lost, extra_ns, copy_extra_ns, held = next(self._fates)
        leaves_ns = now_ns
        if self._ns_per_byte:
            queued_ns = self._queue(len(payload), now_ns)
            if queued_ns is None:
                self.queue_dropped += 1
                return
            leaves_ns = queued_ns
        if lost:
            self.lost += 1
            return
        arrival_ns = leaves_ns + self._delay_ns
        heapq.heappush(self._flight, (arrival_ns + extra_ns, number, 0, payload))
        if held:
            self.held += 1
        if copy_extra_ns is not None:
            self.duplicated += 1
            heapq.heappush(self._flight, (arrival_ns + copy_extra_ns, number, 1, payload))

    def _queue(self, size: int, now_ns: int) -> int | None:
        """When the datagram's last bit leaves the bottleneck, or None when the queue is full."""
        starts_ns = now_ns if self._busy_ns is None or self._busy_ns < now_ns else self._busy_ns
        if starts_ns - now_ns > QUEUE_NS:
            return None
        self._busy_ns = starts_ns + round((size + HEADER_BYTES) * self._ns_per_byte)
        return self._busy_ns

    def due(self, now_ns: int) -> list[bytes]:
        """Takes out what has arrived by now_ns, in order of arrival, ties in order of sending."""
        flight = self._flight
        arrived: list[bytes] = []
        while flight and flight[0][0] <= now_ns:
            _, number, copy, payload = heapq.heappop(flight)
            arrived.append(payload)
            if number > self._highest:
                self._highest = number
            elif number < self._highest and not copy:
                self.reordered += 1
        self.delivered += len(arrived)
        return arrived
