"""The receiving end of a line: keeps what arrives, counts the fate of every frame, pops one wave a frame (SPEC.md 5 and 6).

A client may play a frame, or a filling (the wave in place of a missing frame), for fewer ticks than M, so that its jitter
buffer moves by ticks. All sums then count the played fraction of the frame; the rest is added to the position deficit.

Every frame that is known to have been sent, and whose time has come, is applied (played in time), late (arrived after its
time) or lost (never arrived): sent = applied + late + lost. No frame is played twice. `WaveLedger` bounds the energy of
fillings and compensation.
"""

from array import array
from collections.abc import Sequence

from cogrip.protocol.laws.square_root import square_root
from cogrip.protocol.line.arrived_frame import ArrivedFrame
from cogrip.protocol.line.concealment import CONCEALMENTS, clamped
from cogrip.protocol.line.energy_ledger import HISTORY, WaveLedger
from cogrip.protocol.line.energy_sums import BOUND_FRACTION, NOTHING, CompensatedSum
from cogrip.protocol.line.jitter_buffer import make_jitter_buffer
from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.line.sender import Frame
from cogrip.protocol.settings.delays import Frames
from cogrip.protocol.settings.types import Concealed
from cogrip.protocol.wire.accounts import LinkCount, PlayoutAccount

FURTHEST_JUMP = 1 << 14  # highest number of the newest frame in the first datagram of a line
LATE = 0.01  # rate of late frames by default
MOST_FRAMES = 32  # most frames of one datagram: the largest redundancy
MOST_UNHEARD = 4
"""Most frames in a row without a wave after which an overdue one is still played: later the line would jump to it past the
cross-fade."""


class LineReceiver:
    """Plays one direction's frames out. Call `receive` with any number of datagrams, then `pop` once a frame.

    newest    number of the newest frame received; -1 before the first
    metadata  the frame popped last, where a datagram ended with it, so that its ledger is known
    played    the frame popped last had come in time
    gap       the wave popped last is a filling: its frame had not come, or the jitter buffer waits longer
    hold      ticks for which the wave popped last is to be played; a server plays every wave for one step
    overdue   the frame in whose place a filling is being played, if it has arrived meanwhile, and the gap is a short one
    ledger    energy ledger of this direction
    answer    wave that the end sent last: its owner sets it before `pop`
    """

    def __init__(
        self, axes: int, delay_frames: Frames, frame_s: float, credit_j: float = 0.0, concealment: Concealed = "elastic",
        *, late: float = LATE, ticks: int = 1, by_frames: bool = False,
    ) -> None:  # fmt: skip
        """Make a receiver that has received nothing.

        axes          degrees of freedom, 1 to 6
        delay_frames  playout delay D in frames, or "auto" to adapt it to the jitter (SPEC 5.5, 5.6)
        frame_s       period T_n of a frame [s]
        credit_j      energy E_0 that the line may lend in all [J] (SPEC 5.4)
        concealment   strategy for gaps (SPEC 5.4)
        late          rate of late frames that "auto" aims at
        ticks         device ticks in a frame, M
        by_frames     each frame is played for M ticks: by a server
        """
        self._axes, self._zero, self._ticks = axes, (0.0,) * axes, ticks
        self._jitter_buffer = make_jitter_buffer(delay_frames, frame_s, late, ticks, ticks if by_frames else 1)
        # of the newest frame: ticks from its arrival to the next frame border, and its sender's phase
        self._early = self._phase = 0
        self.hold = 1 if self._jitter_buffer.adapts else ticks
        self._half_frame_s = 0.5 * frame_s
        self._concealment = CONCEALMENTS[concealment](axes, frame_s)
        self.ledger = WaveLedger(axes, credit_j / self._half_frame_s / axes)
        self.answer: Sequence[float] = self._zero

        self._begun = False  # something has been popped
        self.newest, self._cursor = -1, 0  # the second: number of the frame that `pop` plays next, once it has begun
        self._waiting: dict[int, ArrivedFrame] = {}
        self._missing: set[int] = set()  # frames that had not arrived when they were due; they may still arrive late
        # newest frame of recent datagrams: a datagram with the same one is a duplicate
        self._recent = array("q", [-1]) * 256
        self._arrived = array("q", [-1]) * 64  # numbers of the newest frames that have arrived, at n modulo 64
        self._anchor = -1  # newest frame of the first datagram: reference of `_is_near` until playing begins
        self._late_wave: Frame | None = None  # the newest wave received, where it came too late to be played
        self._fresh = False  # a newer frame than any before has come since the last pop
        self._last = self._zero  # wave popped last
        self._concealing = False  # the wave popped last is played in place of a missing frame
        self.overdue: Frame | None = None

        self._due_frames = self._received = self._applied = self._late = self._duplicate = 0
        self._concealed = self._gap_length = self._longest_gap = 0
        self._unheard = 0  # frames in a row of which no wave was played
        self._compensated, self._spent = list(NOTHING), list(NOTHING)  # of the wave popped last
        self._played_j = CompensatedSum()
        self.metadata: ArrivedFrame | None = None
        self.gap = self.played = False

    @property
    def played_j(self) -> float:
        """Energy of all waves played so far [J]."""
        return self._played_j.value

    def energy_played_j(self) -> float:
        """Return `played_j`."""
        return self._played_j.value

    @property
    def acknowledged(self) -> int:
        """Number after the frame popped last; 0 before the first."""
        return self.next_number()

    def next_number(self) -> int:
        """Return `acknowledged`."""
        return self._cursor if self._cursor > 0 else 0

    @property
    def deficit(self) -> list[float]:
        """Position deficit: sum of the waves sent less sum of those played, shape (axes,) [sqrt(W)], as far as known."""
        return self.ledger.deficit

    @property
    def gain(self) -> float:
        """Gain of sqrt(b) that the end is to keep now: below 1 where its wave is missing (docs/decisions/0003-gaps.md)."""
        concealment = self._concealment
        return concealment.yielding_gain + (1.0 - concealment.yielding_gain) * concealment.line_quality

    def receive(
        self, first: int, waves: Frame, total: Frame, squares: Frame, metadata: tuple[float, float, int] = (0.0, 0.0, 0),
        early: int = 0, phase: int = 0,
    ) -> bool:  # fmt: skip
        """Take in what a datagram says of this line: see `take_in`."""
        datagram = ReceivedWaves()
        datagram.put(first, waves, total, squares, metadata, phase)
        return self.take_in(datagram, early)

    def take_in(self, datagram: ReceivedWaves, early: int) -> bool:
        """Store the contents of one datagram (SPEC 3.6). Return False, and change nothing, if they cannot be of this line.

        early: ticks that are left before the next pop. For `phase` see `AdaptiveJitterBuffer.arrived`.
        """
        axes, first, phase = self._axes, datagram.first, datagram.phase
        count = datagram.numbers // axes
        newest = first + count - 1
        fits = count * axes == datagram.numbers and 0 < count <= MOST_FRAMES and datagram.axes == axes
        if not fits or not self._is_near(newest):
            return False
        slot = newest & 255
        if self._recent[slot] == newest:
            self._duplicate += 1
            return True
        self._recent[slot] = newest
        if newest > self.newest:
            self.newest, self._fresh, self._early, self._phase = newest, True, early, phase
            self._late_wave = datagram.frame(count - 1) if newest < self._cursor else None
        stored = self._store(datagram, count, early)
        if newest >= self._cursor:
            (self._waiting[newest] if stored is None else stored).set_ledger(datagram)
        self.ledger.add_totals(datagram, self._cursor if self._begun else -1)
        return True

    def _store(self, datagram: ReceivedWaves, count: int, early: int) -> ArrivedFrame | None:
        """Keep those of `count` frames that had not arrived before. Return the newest frame, where it is kept."""
        first, phase, cursor = datagram.first, datagram.phase, self._cursor
        newest, oldest = first + count - 1, cursor - HISTORY
        waiting, missing, arrived = self._waiting, self._missing, self._arrived
        adapts = self._jitter_buffer.adapts and self._begun
        stored = None
        for place in range(count):
            number, stored = first + place, None
            if number >= oldest and arrived[number & 63] == number:
                continue  # as nearly all that a datagram repeats
            if number >= cursor:
                frame = ArrivedFrame(datagram.frame(place))
                if waiting.setdefault(number, frame) is not frame:
                    continue
                stored = frame
            elif number in missing:
                missing.discard(number)
                self._late += 1
                if number == cursor - 1 and self._concealing and self._unheard <= MOST_UNHEARD:
                    self.overdue = datagram.frame(place)
            else:
                if adapts and number == newest < cursor - HISTORY:  # too old for the ledger, but its lateness counts
                    self._jitter_buffer.arrived(number - cursor, early, phase)
                continue
            self._received += 1
            arrived[number & 63] = number
            if adapts:
                self._jitter_buffer.arrived(number - cursor, early, phase)
        return stored

    def _is_near(self, newest: int) -> bool:
        """Return whether a datagram that ends with this frame can be of this line. This bounds the memory of a line."""
        if self._begun:
            return newest <= self._cursor + HISTORY
        if self._anchor < 0:
            if newest > FURTHEST_JUMP:
                return False
            self._anchor = newest
        return abs(newest - self._anchor) <= HISTORY

    def _begin(self) -> int:
        """Set the cursor by the newest frame; older ones that are not played are late, or lost if they have not come."""
        cursor = self.newest - self._jitter_buffer.begin(self.newest - min(self._waiting), self._early, self._phase)
        self._due_frames = max(0, cursor)
        for number in range(max(0, cursor - HISTORY), cursor):
            self._drop_or_miss(number)
        self._waiting = {number: frame for number, frame in self._waiting.items() if number >= cursor}
        self.ledger.begin(cursor)
        return cursor

    def pop(self, frames: int = 1) -> Frame:
        """Return the wave to apply now for `hold` ticks, shape (axes,) [sqrt(W)].

        frames: 1, and 1 more for each frame that the loop missed.
        """
        self.metadata = self.overdue = None
        self.played = self._concealing = False
        number = self._cursor
        if not self._begun:
            if self.newest < 0:
                return self._zero
            number = self._begin()
            self._begun = True
        else:
            for _ in range(frames - 1):
                number = self._pass_over(number)
        ticks = self._ticks
        arrived = self._waiting.pop(number, None)
        move = self._jitter_buffer.decide(self.newest - number, arrived is not None, self._fresh)
        if arrived is not None and not -ticks < move <= 0:
            self._waiting[number] = arrived  # it is not played now
        late, self._late_wave, self._fresh = self._late_wave, None, False
        self.gap = move > 0
        if self.gap:
            self._cursor, self.hold = number, move
            filling = self._fill(late, self.newest < number, move / ticks)
            self.ledger.disturbed = True  # the filling enters the deficit, so compensation is needed
            self._add_deficit(filling, -move / ticks)  # no frame stands for it
            return self._play(filling, move / ticks)
        if move == -ticks:
            number, move = self._pass_over(number), 0
            arrived = self._waiting.pop(number, None)
        self.hold, part = ticks + move, 1.0 + move / ticks
        if arrived is not None:
            frame = arrived.wave
            if arrived.has_ledger:
                self.metadata = arrived
            self.played = True
            self._applied += 1
            self._gap_length = self._unheard = 0
        elif number >= 0:
            self._miss(number)
            frame = self._fill(late, self.newest < number, part)
            self._concealing = True
            self.ledger.add_filling(frame)
        else:
            frame = self._zero
        self._advance(number, frame)
        if move:
            self.ledger.disturbed = True
            self._add_deficit(frame, 1.0 - part)
        return self._play(frame, part)

    def play_overdue(self, ticks: int) -> Frame:
        """Return the overdue frame, to be played in place of its filling for the `ticks` that are left of its time.

        Deficit and played energy count the filling until then, and the frame itself for the rest.
        """
        frame, part = self.overdue, ticks / self._ticks
        assert frame is not None
        self._add_deficit(self._last, part)
        self._add_deficit(frame, -part)
        self._played_j.add(part * self._half_frame_s * (_square(frame) - _square(self._last)))
        self.overdue, self._concealing, self._last, self._unheard = None, False, frame, 0
        return frame

    @property
    def popped(self) -> Frame:
        """The wave popped last, as it was played."""
        return self._last

    def scale(self, wave: Frame, gain: float, wanted: float, ticks: int) -> Frame:
        """Return `gain` times a wave that plays for `ticks` ticks; the deficit grows by (`wanted` - `gain`) times the wave."""
        part = ticks / self._ticks
        less = part * (1.0 - gain * gain)
        self.ledger.disturbed = True
        self.ledger.add_compensation([part * (gain - wanted) * x for x in wave], [-less * x * x for x in wave])
        self._played_j.add(-less * self._half_frame_s * _square(wave))
        return tuple([gain * x for x in wave])

    def _add_deficit(self, frame: Frame, part: float) -> None:
        """Add a part of a frame, which was not played, to the position deficit. A negative part was played in addition."""
        self.ledger.add_compensation([-part * x for x in frame], [-part * x * x for x in frame])

    def _miss(self, number: int) -> None:
        """Count a frame whose time has come without it; it may still arrive late."""
        self._missing.add(number)
        self.gap = self.ledger.disturbed = True
        self._concealed += 1
        self._gap_length += 1
        self._unheard += 1
        self._longest_gap = max(self._longest_gap, self._gap_length)

    def _pass_over(self, number: int) -> int:
        """Play nothing for frame `number`, which is late if it has come; return the next number."""
        if number >= 0:
            self._drop_or_miss(number)
        self._advance(number, self._zero)
        return number + 1

    def _drop_or_miss(self, number: int) -> None:
        """Count frame `number`, which is not played, as late; as missing if it has not come."""
        if self._waiting.pop(number, None) is not None:
            self._late += 1
        else:
            self._missing.add(number)

    def _advance(self, number: int, frame: Frame) -> None:
        """Move on from frame `number`, for which `frame` is played."""
        self._cursor = number + 1
        if number >= 0:
            self._due_frames += 1
            if self._missing:
                self._missing.discard(number - HISTORY)
            self.ledger.add_played(number, frame)

    def _fill(self, late: Frame | None, silent: bool, part: float) -> Frame:
        """Return the filling for a missing frame: as the concealment proposes, as far as the ledger allows."""
        limits = self.ledger.limits()
        filled = self._concealment.fill(self._last, limits, self.answer, late, silent, part)
        return tuple([max(-most, min(most, x)) for x, most in zip(filled, limits, strict=True)])

    def _play(self, frame: Frame, part: float) -> Frame:
        """Add this frame's compensation and count the energy. part: of a frame, for which it is played."""
        if self.ledger.disturbed:
            frame = self._compensate(frame, part)
        self._played_j.add(part * _square(frame) * self._half_frame_s)
        self._last = frame
        return frame

    def _compensate(self, frame: Frame, part: float) -> Frame:
        ledger, concealment = self.ledger, self._concealment
        ledger.measure()
        concealment.compensate(frame, ledger, self._last, self.gap)
        added, reserves, compensated, spent = concealment.added, ledger.reserves, self._compensated, self._spent
        out: list[float] = []
        for axis in range(self._axes):
            value = frame[axis]
            before = value * value
            reach = square_root(before + reserves[axis])  # (value + p)^2 - value^2 <= reserve
            played = clamped(value + added[axis], -reach, reach)
            after = played * played
            compensated[axis] = part * (played - value)
            spent[axis] = part * (after - before) + BOUND_FRACTION * (after + before)
            out.append(played)
        ledger.compensated_by(compensated, spent)
        return tuple(out)

    def write_off(self, row: Sequence[float]) -> None:
        """Take waves [sqrt(W)] out of the position deficit, for which the end has moved without energy in the frame before."""
        self.ledger.disturbed = True
        self.ledger.add_compensation(row, self._zero)

    @property
    def _sent(self) -> int:
        """Frames that are known to have been sent and whose time has come."""
        return min(self._due_frames, self.newest + 1)

    @property
    def lost(self) -> int:
        """Frames of `sent` that have not arrived."""
        due, known = self._due_frames, self.newest + 1
        return (due if due < known else known) - self._applied - self._late

    def count(self) -> LinkCount:
        """Return how many frames met which fate."""
        pending = max(0, self.newest + 1 - self._due_frames)
        return LinkCount(self._sent, self._received, self._applied, self.lost, self._late, self._duplicate, pending)

    @property
    def playout_frames(self) -> float:
        """Playout delay now [frames]."""
        return self._jitter_buffer.delay()

    @property
    def spare(self) -> int:
        """Ticks by which the sender may delay its frames so that at most the late rate is late; negative: must send earlier."""
        return self._jitter_buffer.spare()

    def phase_to_spare(self) -> int:
        """Return `spare`."""
        return self._jitter_buffer.spare()

    def playout_account(self) -> PlayoutAccount:
        """Return how the frames were played out so far."""
        buffer = self._jitter_buffer
        mean, least, most = buffer.depths()
        return PlayoutAccount(mean, least, most, buffer.repeated, buffer.skipped, self._concealed, self._longest_gap)


def _square(frame: Frame) -> float:
    square = 0.0
    for value in frame:
        square += value * value
    return square
