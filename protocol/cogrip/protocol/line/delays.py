"""What a delay comes to: links are as long as they are, ends act on ticks and frame borders (P eq. 14, 15).

A datagram that was sent at a frame border comes in after the link's delay, is seen at the receiver's next device tick,
waits for the next frame border, and then as many frames as the playout holds. Symbols: M device ticks in a frame.

How many frames a playout that measures (frames = "auto") comes to hold on a link that is known follows from the chance that
a frame is not there o frames after it was sent: every one of the datagrams that carry it and were sent since is lost, or
still under way. Losses are a chain of two states (Gilbert-Elliott), delays are drawn for each datagram by itself.
"""

from math import ceil, exp
from typing import NamedTuple, Protocol

from cogrip.protocol.line.jitter_buffer import DEEPEST, Frames, cost, weight_frames
from cogrip.protocol.rates import Rates

_WHOLE = 1e-6  # of a tick: what is nearer to a whole number than this is one, written with rounded milliseconds


class OneWayDelay(NamedTuple):
    """One way through a line, stage by stage, in device ticks; the sum is a whole number of frames."""

    link_ticks: float  # as configured
    tick_wait_ticks: float  # to the next device tick
    frame_wait_ticks: float  # from there to the next frame border
    playout_ticks: float
    frames: int

    @property
    def whole(self) -> bool:
        """Whether the link's delay is a whole number of ticks as it stands."""
        return self.tick_wait_ticks == 0.0


def one_way(delay_ms: float, playout_frames: int, rates: Rates) -> OneWayDelay:
    """The stages of a link of `delay_ms` with `playout_frames` of playout."""
    exact = delay_ms * 1e-3 * rates.device_hz
    near = round(exact)
    link = float(near) if abs(exact - near) < _WHOLE else exact
    ticks = ceil(link)
    M = rates.ticks_per_frame
    border = -(-ticks // M)
    return OneWayDelay(
        link, ticks - link, float(border * M - ticks), float(playout_frames * M), border + playout_frames
    )


class Waiting(Protocol):
    """[playout], as far as it decides on delays."""

    @property
    def frames(self) -> Frames: ...
    @property
    def redundancy(self) -> int: ...


class Direction(Protocol):
    """One direction of a link, as far as it decides on delays."""

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


HELD_MS = (10.0, 30.0)  # a datagram that is reordered is held back by so much more, uniformly
_SLICES = 8  # of that range
_NEVER = 1e-9  # share of late frames that is none


def expected_frames(playout: Waiting, direction: Direction, rates: Rates) -> int:
    """Frames that the playout holds on this link beyond its delay: as set, or as "auto" comes to hold in the end.

    What queues before a bottleneck and what outages do is left out.
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
    """Chance that a frame is not there so many frames after it was sent; quickest None: that it never comes.

    Datagram j after the frame's own brings it in time if it is not lost and its delay is at most (frames - j) T_n.
    """
    loss = direction.loss
    if direction.burst_frames > 1.0:
        enter, stay = loss / (direction.burst_frames * (1.0 - loss)), 1.0 - 1.0 / direction.burst_frames
    else:
        enter = stay = loss
    good, bad = 1.0 - loss, loss  # not there so far, and the chain's state
    for sent in range(redundancy if quickest is None else min(redundancy, frames - quickest + 1)):
        slack_ms = (frames - sent) * frame_ms - direction.delay_ms
        good *= 0.0 if quickest is None else _under_way(slack_ms, direction)
        good, bad = good * (1.0 - enter) + bad * (1.0 - stay), good * enter + bad * stay
    return good + bad


def _under_way(slack_ms: float, direction: Direction) -> float:
    """Chance that a datagram that is not lost needs more than the link's delay and this, its copy too where it has one."""
    late = _exceeds(slack_ms, direction.jitter_ms)
    copy = 1.0 - direction.duplicate + direction.duplicate * late
    if direction.reorder:
        low, high = HELD_MS
        step = (high - low) / _SLICES
        held = sum(_exceeds(slack_ms - low - (k + 0.5) * step, direction.jitter_ms) for k in range(_SLICES)) / _SLICES
        late = (1.0 - direction.reorder) * late + direction.reorder * held
    return late * copy


def _exceeds(slack_ms: float, jitter_ms: float) -> float:
    """Of a delay of gamma shape 2 and mean jitter_ms: 1 - its distribution."""
    if slack_ms < -_WHOLE:
        return 1.0
    if not jitter_ms:
        return 0.0
    x = 2.0 * max(0.0, slack_ms) / jitter_ms
    return (1.0 + x) * exp(-x)
