"""Playout by itself: one line's frames over an emulated link, played out adaptively and at every fixed depth. Virtual time.

The fixed depths are judged with hindsight over the very same arrivals: frame n is played at take n + o, for one whole number o
through the whole run. With x the lateness of a frame (take at which it first is there, less its number) as in
`cogrip.protocol.line.jitter_buffer`, the frames with x > o are late, and no receiver need be run for it. `play` runs the
receiver of the live ends, adaptive or with [playout] frames as a number.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf, sin

from cogrip.protocol.accounts import PlayoutAccount
from cogrip.protocol.line.jitter_buffer import Frames, cost, weight_frames
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.link_profile import LinkProfile
from cogrip.protocol.rates import due_ns
from cogrip.sim.session.link import LinkEmulator

REDUNDANCY = 8
_BYTES = 200  # of a datagram with as many frames of one axis: what a capped link sees of it


class NothingCameError(ValueError):
    """No frame was there at any take: nothing can be compared."""


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Arrivals at each take: the numbers of the datagrams, each that of its newest frame."""

    network_hz: int
    takes: tuple[tuple[int, ...], ...]

    @property
    def frames(self) -> int:
        """Number of frames that were sent."""
        return len(self.takes)


@dataclass(frozen=True, slots=True)
class Played:
    """delay_frames: from a frame's making to its playing, mean over the takes that were not gaps; late: frames not played
    that did come, what was passed over among them."""

    delay_frames: float
    sent: int
    late: int
    lost: int
    gaps: int
    account: PlayoutAccount

    @property
    def late_share(self) -> float:
        return self.late / self.sent if self.sent else 0.0


@dataclass(frozen=True, slots=True)
class Fixed:
    """One delay through a whole run, or through several. late: of `sent`."""

    delay_frames: int
    sent: int
    late: int
    lost: int

    def cost(self, network_hz: int) -> float:
        """J of `cogrip.protocol.line.jitter_buffer` [frames]."""
        in_time = self.sent - self.lost - self.late
        return cost(self.delay_frames, self.late, in_time, weight_frames(1.0 / network_hz))


def arrivals(
    link: LinkProfile, seed: str, seconds: float, network_hz: int, outages: Iterable[tuple[float, float]] = ()
) -> Arrivals:
    """One frame sent, and one taken, at each border; a take sees what has arrived by then."""
    emulator = LinkEmulator(link, seed, outages)
    takes = []
    padding = bytes(_BYTES - 8)
    for number in range(round(seconds * network_hz)):
        now_ns = due_ns(0, number, network_hz)
        emulator.send(number.to_bytes(8, "big") + padding, now_ns)
        takes.append(tuple([int.from_bytes(datagram[:8], "big") for datagram in emulator.due(now_ns)]))
    return Arrivals(network_hz, tuple(takes))


def play(arrived: Arrivals, frames: Frames) -> Played:
    """Play the arrivals out with the receiver of the live ends."""
    sender, receiver = LineSender(1, REDUNDANCY), LineReceiver(1, frames, 1.0 / arrived.network_hz)
    contents = []
    delays = played = gaps = 0
    for number, datagrams in enumerate(arrived.takes):
        sender.push((0.5 * sin(0.05 * number),))
        contents.append(sender.contents())
        for datagram in datagrams:
            receiver.receive(*contents[datagram])
        receiver.pop()
        if receiver.gap:
            gaps += 1
        elif receiver.acknowledged:
            delays += number + 1 - receiver.acknowledged
            played += 1
    count = receiver.count()
    return Played(delays / max(1, played), count.sent, count.late, count.lost, gaps, receiver.playout_account())


def lateness(arrived: Arrivals) -> dict[int, int]:
    """Return how many frames have each x. Frames that never came are the rest of `arrived.frames`."""
    first: dict[int, int] = {}
    found: dict[int, int] = {}
    for take, datagrams in enumerate(arrived.takes):
        for newest in datagrams:
            for number in range(max(0, newest - REDUNDANCY + 1), newest + 1):
                if number not in first:
                    first[number] = take
                    found[take - number] = found.get(take - number, 0) + 1
    return found


def fixed_delays(runs: Sequence[Arrivals]) -> list[Fixed]:
    """Every whole delay that makes sense over all of these runs together, the shortest first. Raises NothingCameError."""
    total: dict[int, int] = {}
    for run in runs:
        for x, count in lateness(run).items():
            total[x] = total.get(x, 0) + count
    sent, came = sum(run.frames for run in runs), sum(total.values())
    if not came:
        raise NothingCameError(f"of {sent} frames none was there before the end")
    found, late = [], came
    for delay in range(min(total), max(total) + 1):
        late -= total.get(delay, 0)
        found.append(Fixed(delay, sent, late, sent - came))
    return found


def best_fixed(delays: Sequence[Fixed], network_hz: int) -> Fixed:
    """The one of least cost J; of two alike the shorter."""
    return min(delays, key=lambda one: one.cost(network_hz))


def beaten(delays: Sequence[Fixed], delay_frames: float, late_share: float, factor: float = 1.2) -> bool:
    """Return True if one fixed delay is shorter, and loses less to lateness, by more than this factor in both."""
    return any(factor * one.delay_frames < delay_frames and factor * one.late / one.sent < late_share for one in delays)


def ratio(ours: float, best: float) -> float:
    """ours / best; 1 where both are nothing."""
    if best > 0.0:
        return ours / best
    return inf if ours > 0.0 else 1.0
