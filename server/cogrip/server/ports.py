"""The server's end of each person's line: what comes in before a step, what goes out after it."""

from collections.abc import Callable

from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum, rounding_fraction
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.messages import Frame, Stamp, State, Waves
from cogrip.protocol.settings import SeatSettings
from cogrip.server.latest_state_port import LatestStatePort, Row
from cogrip.server.power_port import PowerPort
from cogrip.server.seat_limits import SeatLimits, WaveLimiter

MOST_M = 1e3  # from the middle of a person's own frame


class WavePort:
    """Plays forward waves to the world, within what the seat may bring in, and sends its answers back."""

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        axes, playout, frame_s = seat.object.axes, seat.playout, seat.rates.frame_s
        self._half_frame_s = 0.5 * frame_s
        self._receiver = LineReceiver(axes, playout.frames, frame_s, playout.tank_mj * 1e-3, playout.concealment)
        self._sender = LineSender(axes, playout.redundancy)
        self._limiter = WaveLimiter(seat.coupling.impedance_nspm, frame_s, limits, power_left)
        self._axes = axes
        self._port_j: float | None = None
        self._brought_j = 0.0  # energy of the forward waves where they were made, as last heard of
        self._made_j = CompensatedSum()
        self._rounding = rounding_fraction(seat.rates.ticks_per_frame)
        self.origin: Row | None = None  # the hand before its first frame [m]
        self.hand: Row | None = None  # the hand after its newest frame [m]
        self.up_margin_j: float | None = 0.0
        self.up_reserve = EnergyReserve(seat.rates.network_hz)
        self.loops = LoopMeter(seat.rates.network_hz) if seat.follows else None  # of the last second

    def receive(self, message: Frame) -> bool:
        if not isinstance(message, Waves) or len(message.state) != 2 * self._axes:
            return False
        if self.origin is None and not all(-MOST_M <= place <= MOST_M for place in message.state):
            return False  # no hand is there
        mark = (message.made_j, message.port_j, message.acknowledged)
        if not self._receiver.receive(message.first, message.waves, message.total, message.squares, mark):
            return False
        self.hand = message.state[self._axes :]
        if self.origin is None:
            self.origin = message.state[: self._axes]
        return True

    @property
    def neutral(self) -> Row:
        """Return what goes back of a step that did not count: nothing."""
        return (0.0,) * self._axes

    def take(self, frames: int) -> Row:
        """The row to step with; `frames` > 1 if the loop missed frames - 1 steps."""
        receiver = self._receiver
        wave = receiver.pop(frames)
        self._port_j = None
        self.up_reserve.elapse(frames)
        if receiver.metadata is not None:
            made_j, self._port_j, heard = receiver.metadata
            self._brought_j = made_j
            margin = made_j - receiver.played_j + self._rounding * made_j
            self.up_reserve.update(margin)
            if self.up_margin_j is None or margin < self.up_margin_j:
                self.up_margin_j = margin
            if heard and self.loops is not None:  # from a returning frame to the step that hears of its being felt
                self.loops.add(self._sender.next_number + frames - heard)
        for _ in range(frames - 1):
            self._sender.push((0.0,) * self._axes)  # the steps that were missed sent nothing
        return self._limiter.limit(wave)

    @property
    def made_j(self) -> float:
        """Energy of the returning waves sent so far."""
        return self._made_j.value

    @property
    def rounding_j(self) -> float:
        """What rounding alone can put the books of both directions together out by."""
        return self._rounding * (self._brought_j + self._made_j.value)

    @property
    def used_j(self) -> float:
        """Energy of the forward waves applied so far."""
        return self._receiver.played_j - self._limiter.taken_j

    @property
    def power_left(self) -> float:
        """How full the power's bucket is, of 1."""
        return self._limiter.fullness

    @property
    def deficit(self) -> list[float]:
        """Of the forward waves, shape (axes,) [sqrt(W)]: sent and not played."""
        return self._receiver.deficit

    @property
    def limited(self) -> dict[str, int]:
        """Waves that were taken down, by reason."""
        return self._limiter.counts

    def put(self, row: Row) -> None:
        self._sender.push(row)
        self._limiter.book(row)
        square = 0.0  # of all axes first, as the receiver adds them: else rounding alone would make a margin
        for value in row:
            square += value * value
        self._made_j.add(square * self._half_frame_s)

    def port_in_j(self) -> float | None:
        """Energy that had gone in at the client's port up to the frame just taken, where that is known."""
        return self._port_j

    def message(self, session: int, stamp: Stamp, object_state: Row, port_j: float) -> Waves:
        first, waves, total, squares = self._sender.contents()
        heard = self._receiver.acknowledged
        return Waves(session, first, waves, total, squares, self.made_j, port_j, heard, stamp, object_state)

    @property
    def lost(self) -> int:
        """Frames that were sent and never came."""
        return self._receiver.lost

    def playout_account(self) -> PlayoutAccount | None:
        return self._receiver.playout_account()

    def count(self) -> LinkCount:
        return self._receiver.count()


class StatePort(LatestStatePort[State]):
    """Virtual coupling: the newest device state in, the object's state out."""

    power_left = 1.0  # there is no such bucket

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat, limits)
        self._row: Row = (0.0,) * (2 * self._axes)
        self.made_j = self.used_j = 0.0
        self.up_margin_j: float | None = None
        self.up_reserve = EnergyReserve(seat.rates.network_hz)  # never seen: no ledger is kept of one direction

    def receive(self, message: Frame) -> bool:
        if not isinstance(message, State) or len(message.position_m) != self._axes:
            return False
        return self._accept(message)

    @property
    def limited(self) -> dict[str, int]:
        """States that were not believed."""
        return self._states.counts

    @property
    def neutral(self) -> Row:
        """Return what goes back of a step that did not count: an object that rests where the hand is."""
        return (self.hand or (0.0,) * self._axes) + (0.0,) * self._axes

    def take(self, frames: int) -> Row:
        newest = self._take(frames)
        return newest.position_m + newest.velocity_mps if newest else (0.0,) * (2 * self._axes)

    def put(self, row: Row) -> None:
        self._row = row
        self._number += 1

    @property
    def rounding_j(self) -> float:
        """What rounding alone can put the books out by, at least: of what went both ways only the difference is known."""
        return self._rounding * abs(self._receiver.latest.port_j) if self._receiver.latest else 0.0

    def message(self, session: int, stamp: Stamp, object_state: Row, port_j: float) -> State:
        row, axes = self._row, self._axes
        return State(session, self._number, row[:axes], row[axes:], port_j, self._receiver.acknowledged, stamp)


Port = WavePort | StatePort | PowerPort

PORTS: dict[str, Callable[[SeatSettings, SeatLimits, float], Port]] = {
    "wave": WavePort,
    "coupling": StatePort,
    "tdpa": PowerPort,
}
