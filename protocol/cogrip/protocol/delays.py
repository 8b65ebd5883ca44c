"""What a constant delay comes to: links are as long as they are, ends act on ticks and frame borders (P eq. 14, 15).

A datagram that was sent at a frame border comes in after the link's delay, is seen at the receiver's next device tick,
waits for the next frame border, and then as many frames as the playout holds. Symbols: M device ticks in a frame.
"""

from math import ceil
from typing import NamedTuple

from cogrip.protocol.rates import Rates

_WHOLE = 1e-6  # of a tick: what is nearer to a whole number than this is one, written with rounded milliseconds


class OneWay(NamedTuple):
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


def one_way(delay_ms: float, playout_frames: int, rates: Rates) -> OneWay:
    """The stages of a link of `delay_ms` with `playout_frames` of playout."""
    exact = delay_ms * 1e-3 * rates.device_hz
    near = round(exact)
    link = float(near) if abs(exact - near) < _WHOLE else exact
    ticks = ceil(link)
    M = rates.ticks_per_frame
    border = -(-ticks // M)
    return OneWay(link, ticks - link, float(border * M - ticks), float(playout_frames * M), border + playout_frames)
