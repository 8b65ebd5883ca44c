"""Delays of a link, from the border at which a frame ends to the one at which it is played (P eq. 14, 15).

A datagram arrives after the link's delay, and ends act at device ticks only. With a playout delay of a number of frames
both ends act at common frame borders: a frame waits for the next border, and then for the playout delay. With "auto" it is
played at the tick by which all but `playout.late` of the frames have arrived; a client sends its frames that much before
the server's step. Symbols: M device ticks in a frame, T_n frame period.

A frame has not arrived some time after it was sent if every datagram that carries it, and was sent in that time, is lost or
still under way. Losses are a chain of two states (Gilbert-Elliott), delays are drawn for each datagram independently.
"""

from math import ceil, exp
from typing import Literal, NamedTuple, Protocol

from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.rates import Rates

DEEPEST = 256  # largest playout delay [frames]
Frames = int | Literal["auto"]
_WHOLE = 1e-6
"""Difference to a whole number [ticks] below which a delay counts as whole: it was written in rounded milliseconds."""


class OneWayDelay(NamedTuple):
    """Delay of one direction, stage by stage [device ticks]; the sum is a whole number."""

    link_ticks: float  # delay of the link, as configured
    tick_wait_ticks: float  # wait for the next device tick
    frame_wait_ticks: float  # wait from that tick to the next frame border
    playout_ticks: float
    ticks_per_frame: int

    @property
    def ticks(self) -> int:
        """All stages together."""
        return round(self.link_ticks + self.tick_wait_ticks + self.frame_wait_ticks + self.playout_ticks)

    @property
    def frames(self) -> float:
        """All stages together [frames]."""
        return self.ticks / self.ticks_per_frame

    @property
    def whole(self) -> bool:
        """True where the link's delay as configured is a whole number of ticks."""
        return self.tick_wait_ticks == 0.0


def one_way(delay_ms: float, playout_frames: int, rates: Rates) -> OneWayDelay:
    """Return the stages of a link of `delay_ms` [ms] whose ends act at common frame borders, `playout_frames` held back."""
    link, ticks = _in_ticks(delay_ms, rates)
    M = rates.ticks_per_frame
    border = -(-ticks // M) * M
    return OneWayDelay(link, ticks - link, float(border - ticks), float(playout_frames * M), M)


def _in_ticks(delay_ms: float, rates: Rates) -> tuple[float, int]:
    """Return a delay in ticks, and the tick at which it is over."""
    exact = delay_ms * 1e-3 * rates.device_hz
    near = round(exact)
    link = float(near) if abs(exact - near) < _WHOLE else exact
    return link, ceil(link)


class PlayoutDelay(Protocol):
    """Settings [playout], as far as delays depend on them."""

    @property
    def frames(self) -> Frames: ...
    @property
    def late(self) -> float: ...
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
_SLICES = 8  # number of parts into which the range of HELD_MS is cut to integrate over it


def line_delay(playout: PlayoutDelay, direction: Direction, rates: Rates) -> OneWayDelay:
    """Return the stages of a line on this link: with the playout delay as set, or as "auto" chooses it in the long run.

    Queues before a bottleneck and outages are not considered.
    """
    if playout.frames != "auto":
        return one_way(direction.delay_ms, playout.frames, rates)
    link, ticks = _in_ticks(direction.delay_ms, rates)
    M, tick_ms, frame_ms = rates.ticks_per_frame, 1e3 * rates.tick_s, 1e3 * rates.frame_s
    held = 0
    if direction.jitter_ms or direction.loss or direction.reorder:
        never = _late(None, 0.0, direction, frame_ms, playout.redundancy)
        least, most = 0, DEEPEST * M  # bisection: late falls with the time
        while least < most:
            middle = (least + most) // 2
            after_ms = (ticks + middle) * tick_ms
            late = _late(after_ms, direction.delay_ms, direction, frame_ms, playout.redundancy) - never
            least, most = (middle + 1, most) if late > playout.late * (1.0 - never) else (least, middle)
        held = least
    return OneWayDelay(link, ticks - link, 0.0, float(held), M)


def _late(after_ms: float | None, quickest_ms: float, direction: Direction, frame_ms: float, redundancy: int) -> float:
    """Return the probability that a frame is not there `after_ms` after it was sent; None: that it never comes.

    Datagram j after the frame's own brings it in time if it is not lost and its delay is at most after_ms - j T_n.
    """
    loss = direction.loss
    enter = stay = loss
    if direction.burst_frames > 1.0:
        enter, stay = loss / (direction.burst_frames * (1.0 - loss)), 1.0 - 1.0 / direction.burst_frames
    good, bad = 1.0 - loss, loss  # probability of the chain's states with the frame not there
    for sent in range(redundancy):
        slack_ms = None if after_ms is None else after_ms - sent * frame_ms - quickest_ms
        if slack_ms is not None and slack_ms < -_WHOLE:
            break
        good *= 0.0 if slack_ms is None else _under_way(slack_ms, direction)
        good, bad = good * (1.0 - enter) + bad * (1.0 - stay), good * enter + bad * stay
    return good + bad


def _under_way(slack_ms: float, direction: Direction) -> float:
    """Return the probability that a datagram, not lost, and its duplicate take `slack_ms` more than the link's delay."""
    late = _exceeds(slack_ms, direction.jitter_ms)
    copy = 1.0 - direction.duplicate + direction.duplicate * late
    if direction.reorder:
        low, high = HELD_MS
        step = (high - low) / _SLICES
        held = (
            add_floats(_exceeds(slack_ms - low - (k + 0.5) * step, direction.jitter_ms) for k in range(_SLICES))
            / _SLICES
        )
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
