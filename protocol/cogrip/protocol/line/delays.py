"""Delays of a link: ends act on ticks and frame borders only (P eq. 14, 15).

A datagram that was sent at a frame border arrives after the link's delay, is seen at the receiver's next device tick, waits
for the next frame border, and then for the playout delay. Symbols: M device ticks in a frame, T_n frame period.

The playout delay that an adaptive jitter buffer (frames = "auto") chooses on a known link follows from the probability that a
frame is not there o frames after it was sent: every datagram that carries it and was sent since is lost, or still under way.
Losses are a chain of two states (Gilbert-Elliott), delays are drawn for each datagram independently.
"""

from math import ceil, exp
from typing import NamedTuple, Protocol

from cogrip.protocol.line.jitter_buffer import DEEPEST, Frames, cost, weight_frames
from cogrip.protocol.rates import Rates

_WHOLE = 1e-6  # ticks: a delay this close to a whole number is one, written in rounded milliseconds


class OneWayDelay(NamedTuple):
    """Delay of one direction, stage by stage [device ticks]; the sum is a whole number of frames."""

    link_ticks: float  # as configured
    tick_wait_ticks: float  # to the next device tick
    frame_wait_ticks: float  # from there to the next frame border
    playout_ticks: float
    frames: int

    @property
    def whole(self) -> bool:
        """True where the link's delay as configured is a whole number of ticks."""
        return self.tick_wait_ticks == 0.0


def one_way(delay_ms: float, playout_frames: int, rates: Rates) -> OneWayDelay:
    """Return the stages of a link of `delay_ms` [ms] with a playout delay of `playout_frames`."""
    exact = delay_ms * 1e-3 * rates.device_hz
    near = round(exact)
    link = float(near) if abs(exact - near) < _WHOLE else exact
    ticks = ceil(link)
    M = rates.ticks_per_frame
    border = -(-ticks // M)
    return OneWayDelay(
        link, ticks - link, float(border * M - ticks), float(playout_frames * M), border + playout_frames
    )


class PlayoutDelay(Protocol):
    """Settings [playout], as far as delays depend on them."""

    @property
    def frames(self) -> Frames: ...
    @property
    def redundancy(self) -> int: ...


class Direction(Protocol):
    """Settings of one direction of a link, as far as delays depend on them."""

    @property
    def delay_ms(self) -> float: ...
    @property
    def jitter_ms(self) -> float: ...
    @property
    def loss(self) -> float: ...
    @property
    def burst_frames(self) -> float: ...
    @property
    def duplicate(self) -> float: ...
    @property
    def reorder(self) -> float: ...


HELD_MS = (10.0, 30.0)  # additional delay of a datagram that is reordered, uniformly distributed
_SLICES = 8  # of that range
_NEVER = 1e-9  # fraction of late frames that counts as none


def expected_frames(playout: PlayoutDelay, direction: Direction, rates: Rates) -> int:
    """Return the playout delay on this link [frames]: as set, or as "auto" chooses it in the long run.

    Queues before a bottleneck and outages are not considered.
    """
    if playout.frames != "auto":
        return playout.frames
    frame_ms = 1e3 / rates.network_hz
    quickest = one_way(direction.delay_ms, 0, rates).frames
    if not (direction.jitter_ms or direction.loss or direction.reorder):
        return 0
    weight = weight_frames(rates.frame_s)
    never = _late(playout.redundancy, None, direction, frame_ms, playout.redundancy)
    best, least = 0, float("inf")
    for depth in range(DEEPEST + 1):
        late = _late(quickest + depth, quickest, direction, frame_ms, playout.redundancy) - never
        found = cost(depth, late, 1.0 - never - late, weight)
        if found < least:
            best, least = depth, found
        if late < _NEVER or depth > least:
            break
    return best


def _late(frames: int, quickest: int | None, direction: Direction, frame_ms: float, redundancy: int) -> float:
    """Return the probability that a frame is not there `frames` after it was sent; quickest None: that it never comes.

    Datagram j after the frame's own brings it in time if it is not lost and its delay is at most (frames - j) T_n.
    """
    loss = direction.loss
    enter = stay = loss
    if direction.burst_frames > 1.0:
        enter, stay = loss / (direction.burst_frames * (1.0 - loss)), 1.0 - 1.0 / direction.burst_frames
    good, bad = 1.0 - loss, loss  # probability of the chain's states with the frame not there
    for sent in range(redundancy if quickest is None else min(redundancy, frames - quickest + 1)):
        slack_ms = (frames - sent) * frame_ms - direction.delay_ms
        good *= 0.0 if quickest is None else _under_way(slack_ms, direction)
        good, bad = good * (1.0 - enter) + bad * (1.0 - stay), good * enter + bad * stay
    return good + bad


def _under_way(slack_ms: float, direction: Direction) -> float:
    """Return the probability that a datagram, not lost, and its duplicate take `slack_ms` more than the link's delay."""
    late = _exceeds(slack_ms, direction.jitter_ms)
    copy = 1.0 - direction.duplicate + direction.duplicate * late
    if direction.reorder:
        low, high = HELD_MS
        step = (high - low) / _SLICES
        held = sum(_exceeds(slack_ms - low - (k + 0.5) * step, direction.jitter_ms) for k in range(_SLICES)) / _SLICES
        late = (1.0 - direction.reorder) * late + direction.reorder * held
    return late * copy


def _exceeds(slack_ms: float, jitter_ms: float) -> float:
    """Return 1 - distribution function of a gamma delay of shape 2 and mean `jitter_ms`, at `slack_ms`."""
    if slack_ms < -_WHOLE:
        return 1.0
    if not jitter_ms:
        return 0.0
    x = 2.0 * max(0.0, slack_ms) / jitter_ms
    return (1.0 + x) * exp(-x)
