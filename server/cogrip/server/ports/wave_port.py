"""Port of the wave scheme: plays forward waves to the world within the seat's limits, sends the returning waves back."""

from typing import TypeVar

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.line.line_in_use import ImpedanceChanges
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.line.waves_encoding import encode_waves
from cogrip.protocol.settings.rates import NS_PER_S
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import PlayoutAccount
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Waves
from cogrip.server.ports.port import Port, Turned
from cogrip.server.ports.seat_limits import SeatLimits, WaveLimiter

T = TypeVar("T")

MOST_KEPT = 512  # most frames whose metadata are kept until the frame is popped
FEW_KEPT = 16  # number of kept entries above which those of skipped frames are deleted
SLACK_NS = 2  # largest difference by rounding between two times that are due together
MOST_M = 1e3  # largest distance of a hand from the middle of its person's own frame


class WavePort(Port):
    """See `Port`. Rows are waves [sqrt(W)], shape (axes,)."""

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat)
        axes, playout, frame_s = self.axes, seat.playout, seat.rates.frame_s
        self._half_frame_s = 0.5 * frame_s
        self._receiver: LineReceiver = LineReceiver(
            axes, playout.frames, frame_s, playout.tank_mj * 1e-3, playout.concealment,
            late=playout.late, ticks=seat.rates.ticks_per_frame, by_frames=True,
        )  # fmt: skip
        self._device_hz, self._ticks_per_frame = seat.rates.device_hz, seat.rates.ticks_per_frame
        self._neutral, self._turning = (0.0,) * axes, axes == POSE_AXES
        self._states = 2 * axes + PLACES * self._turning
        self._sender = LineSender(axes, playout.redundancy)
        coupling = seat.coupling
        self._limiter = WaveLimiter(coupling.impedance_nspm, frame_s, limits, power_left, coupling.further_impedance)
        self._begun_nspm = coupling.impedance_nspm
        self._impedances = ImpedanceChanges(coupling.impedance_nspm) if seat.line.auto_impedance else None
        self._since = 0  # number of the first returning frame with the present impedance
        self._port_j: float | None = None
        self._sent_j = 0.0  # energy of the forward waves at their sender, as last reported
        self._made_j = CompensatedSum()
        self.loops = LoopMeter(seat.rates.network_hz, seat.rates.ticks_per_frame) if seat.adapts_stiffness else None
        self._applied: dict[
            int, int
        ] = {}  # by frame number, until popped: ticks for which the client had applied the acknowledged wave
        self._poses: dict[int, Turned] = {}  # by frame number, until popped: pose of the hand at the end of the frame

    def receive(self, message: Waves, now_ns: int) -> bool:
        datagram = ReceivedWaves()
        datagram.read(message)
        return self.take_in(datagram, now_ns)

    def take_in(self, datagram: ReceivedWaves, now_ns: int) -> bool:
        axes = self.axes
        if datagram.states != self._states:
            return False
        newest = datagram.first + datagram.numbers // axes - 1
        if datagram.since > newest:
            return False
        if self.origin is None and not within(MOST_M, datagram.state_from(0, datagram.states)):
            return False  # no hand is there
        if not self._receiver.take_in(datagram, self._early(now_ns)):
            return False
        self.hand = datagram.state_from(axes, 2 * axes)
        if self.origin is None:
            self.origin = datagram.state_from(0, axes)
        if self._impedances is not None and datagram.impedance_nspm:
            self._impedances.add(datagram.since, datagram.impedance_nspm)
        if self._receiver.newest == newest:
            if self.loops is not None and len(self._applied) < MOST_KEPT:
                self._applied[newest] = datagram.applied
            if self._turning and len(self._poses) < MOST_KEPT:
                self._poses[newest] = self.hand[PLACES:], datagram.state_from(2 * axes, datagram.states)
        return True

    def let_impedance_change(self) -> None:
        if self._impedances is None:
            self._impedances = ImpedanceChanges(self._begun_nspm)

    def receiver(self) -> LineReceiver:
        return self._receiver

    def set_limits(self, limits: SeatLimits) -> None:
        self._limiter.set_limits(limits)

    def _early(self, now_ns: int) -> int:
        """Return the whole ticks from now to the next step."""
        left_ns = self.next_step_ns - now_ns + SLACK_NS
        return left_ns * self._device_hz // NS_PER_S if self.next_step_ns >= 0 and left_ns > 0 else 0

    @property
    def neutral(self) -> Row:
        return self._neutral

    def pop(self, frames: int) -> Row:
        receiver = self._receiver
        wave = receiver.pop(frames)
        self._port_j = self.turned = None
        popped = receiver.next_number() - 1
        if self._impedances is not None:
            self._set_impedance(self._impedances.at(popped))
        applied = None
        if self._applied:
            applied = self._applied.pop(popped, None)
            if len(self._applied) > FEW_KEPT:
                self._applied = later_than(popped, self._applied)
        if self._poses:
            self.turned = self._poses.pop(popped, None)
            if len(self._poses) > FEW_KEPT:
                self._poses = later_than(popped, self._poses)
        self.up_reserve.elapse(frames)
        metadata = receiver.metadata
        if metadata is not None:
            sent_j, acknowledged = metadata.made_j, metadata.acknowledged
            self._sent_j, self._port_j = sent_j, metadata.port_j
            margin = sent_j - receiver.energy_played_j() + self._rounding * sent_j
            self.up_reserve.update(margin)
            if self.up_margin_j is None or margin < self.up_margin_j:
                self.up_margin_j = margin
            if acknowledged:  # frames from a returning frame to the step that receives its acknowledgement
                behind = self._sender.next_number + frames - acknowledged
                self.behind = max(0, behind)
                if self.loops is not None and applied is not None:
                    self.loops.add((behind + 1) * self._ticks_per_frame - applied)
        for _ in range(frames - 1):
            self._sender.push(self._neutral)  # the steps that were missed sent nothing
        return self._limiter.limit(wave)

    def _set_impedance(self, impedance_nspm: float) -> None:
        """Set the impedance from the popped row on, and of the answers from its answer on."""
        if impedance_nspm != self.impedance_nspm:
            self.impedance_nspm = impedance_nspm
            self._since = self._sender.next_number
            self._limiter.set_impedance(impedance_nspm)

    @property
    def made_j(self) -> float:
        return self._made_j.value

    def rounding_j(self) -> float:
        return self._rounding * (self._sent_j + self._made_j.value)

    @property
    def used_j(self) -> float:
        return self._receiver.played_j - self._limiter.taken_j

    @property
    def power_left(self) -> float:
        return self._limiter.fullness

    @property
    def credit_left(self) -> float:
        return self._receiver.ledger.left

    @credit_left.setter
    def credit_left(self, left: float) -> None:
        ledger = self._receiver.ledger
        ledger.credit = min(ledger.credit, left)

    @property
    def deficit(self) -> list[float]:
        """Forward waves sent and not played, shape (axes,) [sqrt(W)]."""
        return self._receiver.deficit

    @property
    def limited(self) -> dict[str, int]:
        return self._limiter.counts

    def push(self, row: Row) -> None:
        self._sender.push(row)
        self._receiver.answer = row
        self._limiter.book(row)
        square = 0.0  # summed over the axes in the receiver's order, so that rounding makes no margin
        for value in row:
            square += value * value
        self._made_j.add(square * self._half_frame_s)

    def port_in_j(self) -> float | None:
        return self._port_j

    def message(self, session: int, clock: MessageClock, now_ns: int, object_state: Row, port_j: float) -> bytes:
        receiver = self._receiver
        return encode_waves(
            session, self._sender, self._made_j.value, port_j, receiver.next_number(), clock, now_ns, object_state,
            receiver.phase_to_spare(), self.impedance_nspm or 0.0, self._since, self.handle.taken,
        )  # fmt: skip

    @property
    def playout_frames(self) -> float:
        return self._receiver.playout_frames

    def playout_account(self) -> PlayoutAccount:
        return self._receiver.playout_account()


def within(most: float, numbers: Row) -> bool:
    """Return whether all are between -most and most."""
    return all(-most <= each <= most for each in numbers)


def later_than(number: int, kept: dict[int, T]) -> dict[int, T]:
    """Return the entries of frames after this one."""
    return {each: value for each, value in kept.items() if each > number}
