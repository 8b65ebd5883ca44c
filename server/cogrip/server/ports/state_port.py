"""Ports of schemes whose newest message wins: the base of both, and the port of virtual coupling."""

from typing import Generic, TypeVar

from cogrip.machine.rows import Row
from cogrip.protocol.line.latest_state import StateReceiver
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Latest, State, encode
from cogrip.server.ports.port import Port
from cogrip.server.ports.seat_limits import SeatLimits, StateLimiter

M = TypeVar("M", bound=Latest)


class LatestStatePort(Port, Generic[M]):
    """Receives the states of a client, keeps the newest, and drops those that no hand can have."""

    def __init__(self, seat: SeatSettings, limits: SeatLimits) -> None:
        super().__init__(seat)
        self._states = StateLimiter(seat.rates.frame_s, limits)
        self._receiver: StateReceiver[M] = StateReceiver()
        self._number = -1
        self._fresh = False

    def set_limits(self, limits: SeatLimits) -> None:
        self._states.set_limits(limits)

    def _origin(self, message: M) -> Row:
        """Return the hand before this first message."""
        return message.position_m

    def _accept(self, message: M) -> bool:
        """Receive a state; an implausible one is counted and not used. Return False for one that cannot be of this line."""
        if not self._states.fits(message):
            return True
        before = self._receiver.newest
        if not self._receiver.receive(message):
            return False
        self._states.took(message)
        if self._receiver.newest > before:
            self.hand = message.position_m
        if self.origin is None:
            self.origin = self._origin(message)
        return True

    def receiver(self) -> StateReceiver[M]:
        return self._receiver

    def _pop(self, frames: int) -> M | None:
        """Return the newest message; `frames` as in `pop`."""
        self._states.step(frames)
        self._fresh = self._receiver.pop()
        latest = self._receiver.latest
        if self._fresh and latest is not None and latest.acknowledged:
            self.behind = max(0, self._number + 1 - latest.acknowledged)
        return latest

    def port_in_j(self) -> float | None:
        """Return the energy that had gone in at the client's port, less what came out, where a new message reports it."""
        return self._receiver.latest.port_j if self._fresh and self._receiver.latest else None


class StatePort(LatestStatePort[State]):
    """Port of virtual coupling: the newest device state in, the object's state out. No ledger is kept of one direction."""

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat, limits)
        self.up_margin_j = None
        self._row: Row = (0.0,) * (2 * self.axes)

    def receive(self, message: State, now_ns: int) -> bool:
        return len(message.position_m) == len(message.velocity_mps) == self.axes and self._accept(message)

    @property
    def limited(self) -> dict[str, int]:
        return self._states.counts

    @property
    def neutral(self) -> Row:
        """An object that rests where the hand is."""
        return (self.hand or (0.0,) * self.axes) + (0.0,) * self.axes

    def pop(self, frames: int) -> Row:
        newest = self._pop(frames)
        return newest.position_m + newest.velocity_mps if newest else (0.0,) * (2 * self.axes)

    def push(self, row: Row) -> None:
        self._row = row
        self._number += 1

    def rounding_j(self) -> float:
        """Least such error: of the energy of both directions only the difference is known."""
        return self._rounding * abs(self._receiver.latest.port_j) if self._receiver.latest else 0.0

    def message(self, session: int, clock: MessageClock, now_ns: int, object_state: Row, port_j: float) -> bytes:
        row, axes = self._row, self.axes
        return encode(State(
            session, self._number, row[:axes], row[axes:], port_j, self._receiver.acknowledged, clock.stamp(now_ns),
            edges=self.handle.taken,
        ))  # fmt: skip
