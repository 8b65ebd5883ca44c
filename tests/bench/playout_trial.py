"""Playout by itself: one line's frames over an emulated link, played out adaptively and at every fixed depth. Virtual time.

The fixed depths are judged with hindsight over the very same arrivals: frame n is played at tick n M + o, for one whole number
o through the whole run. With x the lateness of a frame (tick at which it first is there, less n M) as in
`cogrip.protocol.line.jitter_buffer`, the frames with x > o are late, and no receiver need be run for it. `play` runs the
receiver of a client, adaptive or with [playout] frames as a number.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf, sin

from cogrip.protocol.line.receiver import LATE, LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.delays import Frames
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.wire.accounts import PlayoutAccount
from cogrip.sim.link import LinkEmulator

REDUNDANCY = 8
TICKS = 8  # in a frame
_BYTES = 200  # of a datagram with as many frames of one axis: what a capped link sees of it


class NothingCameError(ValueError):
    """No frame was there at any tick: nothing can be compared."""


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Arrivals at each tick: the numbers of the datagrams, each that of its newest frame."""

    network_hz: int
    ticks: tuple[tuple[int, ...], ...]

    @property
    def frames(self) -> int:
        """Number of frames that were sent."""
        return -(-len(self.ticks) // TICKS)


@dataclass(frozen=True, slots=True)
class Played:
    """delay_ticks: from a frame's making to its playing, mean over the frames that were; late: frames not played in time that
    did come, what was passed over among them."""

    delay_ticks: float
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

    delay_ticks: int
    sent: int
    late: int
    lost: int

    @property
    def late_share(self) -> float:
        """Share of the frames that came."""
        return self.late / max(1, self.sent - self.lost)


def arrivals(
    link: LinkProfile, seed: str, seconds: float, network_hz: int, outages: Iterable[tuple[float, float]] = ()
) -> Arrivals:
    """One frame sent every TICKS ticks; a tick sees what has arrived by then."""
    emulator = LinkEmulator(link, seed, outages)
    ticks = []
    padding = bytes(_BYTES - 8)
    for tick in range(round(seconds * network_hz) * TICKS):
        now_ns = due_ns(0, tick, network_hz * TICKS)
        if not tick % TICKS:
            emulator.send((tick // TICKS).to_bytes(8, "big") + padding, now_ns)
        ticks.append(tuple([int.from_bytes(datagram[:8], "big") for datagram in emulator.due(now_ns)]))
    return Arrivals(network_hz, tuple(ticks))


def play(arrived: Arrivals, frames: Frames) -> Played:
    """Play the arrivals out with the receiver of a client."""
    sender, receiver = LineSender(1, REDUNDANCY), LineReceiver(1, frames, 1.0 / arrived.network_hz, ticks=TICKS)
    contents = []
    delays = played = gaps = border = 0
    for tick, datagrams in enumerate(arrived.ticks):
        if not tick % TICKS:
            sender.push((0.5 * sin(0.05 * tick / TICKS),))
            contents.append(sender.contents())
        for datagram in datagrams:
            receiver.receive(*contents[datagram], early=border - tick)
        if tick < border:
            continue
        receiver.pop()
        border = tick + receiver.hold
        if receiver.gap:
            gaps += 1
        elif receiver.acknowledged:
            delays += tick - (receiver.acknowledged - 1) * TICKS
            played += 1
    count = receiver.count()
    return Played(delays / max(1, played), count.sent, count.late, count.lost, gaps, receiver.playout_account())


def lateness(arrived: Arrivals) -> dict[int, int]:
    """Return how many frames have each x. Frames that never came are the rest of `arrived.frames`."""
    first: dict[int, int] = {}
    found: dict[int, int] = {}
    for tick, datagrams in enumerate(arrived.ticks):
        for newest in datagrams:
            for number in range(max(0, newest - REDUNDANCY + 1), newest + 1):
                if number not in first:
                    first[number] = tick
                    x = tick - number * TICKS
                    found[x] = found.get(x, 0) + 1
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


def best_fixed(delays: Sequence[Fixed], late: float = LATE) -> Fixed:
    """The shortest at which no more than this rate of what came is late."""
    return next(one for one in delays if one.late_share <= late)


def beaten(delays: Sequence[Fixed], delay_ticks: float, late_share: float, factor: float = 1.2) -> bool:
    """Return True if one fixed delay is shorter, and loses less to lateness, by more than this factor in both."""
    return any(factor * one.delay_ticks < delay_ticks and factor * one.late / one.sent < late_share for one in delays)


def ratio(ours: float, best: float) -> float:
    """ours / best; 1 where both are nothing."""
    if best > 0.0:
        return ours / best
    return inf if ours > 0.0 else 1.0
