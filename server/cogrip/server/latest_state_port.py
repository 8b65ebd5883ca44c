"""What the ports have in common whose newest message wins: virtual coupling and power variables."""

from typing import Generic, TypeVar

from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.latest_state import StateReceiver
from cogrip.protocol.line.energy_sums import rounding_fraction
from cogrip.protocol.messages import Power, State
from cogrip.protocol.settings import SeatSettings
from cogrip.server.seat_limits import SeatLimits, StateLimiter

M = TypeVar("M", State, Power)
Row = tuple[float, ...]


class LatestStatePort(Generic[M]):
    """Takes in states that a hand can have, and keeps the newest."""

    def __init__(self, seat: SeatSettings, limits: SeatLimits) -> None:
        self._axes = seat.object.axes
        self._states = StateLimiter(seat.rates.frame_s, limits)
        self._receiver: StateReceiver[M] = StateReceiver()
        self._number = -1
        self._fresh = False
        self._rounding = rounding_fraction(seat.rates.ticks_per_frame)
        self.origin: Row | None = None  # the hand before the first frame that came [m]
        self.hand: Row | None = None

    def _origin(self, message: M) -> Row:
        """Where the hand was before this first message."""
        return message.position_m

    def _accept(self, message: M) -> bool:
        """Whether it belongs to this line; what no hand does is counted, and left out."""
        if not self._states.fits(message):
            return True  # counted there
        before = self._receiver.newest
        if not self._receiver.receive(message):
            return False
        self._states.took(message)
        if self._receiver.newest > before:
            self.hand = message.position_m
        if self.origin is None:
            self.origin = self._origin(message)
        return True

    def _take(self, frames: int) -> M | None:
        """The newest, now taken; `frames` as in `WavePort.take`."""
        self._states.step(frames)
        self._fresh = self._receiver.pop()
        return self._receiver.latest

    def port_in_j(self) -> float | None:
        """Energy that had gone in at the client's port, less what came out, up to the message just taken."""
        return self._receiver.latest.port_j if self._fresh and self._receiver.latest else None

    @property
    def lost(self) -> int:
        """Frames that were sent and never came."""
        return self._receiver.lost

    def playout_account(self) -> PlayoutAccount | None:
        """There is no playout."""
        return None

    def count(self) -> LinkCount:
        return self._receiver.count()
