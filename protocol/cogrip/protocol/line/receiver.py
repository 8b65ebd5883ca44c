"""The passive line: one direction of waves over a network that delays, loses, repeats and reorders (theory section 3.5).

    sender    numbers the frames, repeats the last R of them in every datagram, and adds the running totals
              (sum w, sum w^2) of all frames before the oldest of these (`line_sender`)
    receiver  plays the frames out some frames later (`playout`), each at most once. What was lost beyond repair is known
              from the totals: the debt, and the bank of its energy. What is played in a gap and how the debt is paid says
              a strategy (`concealment`); the books here bound it

Invariant, per axis and at every tick: sum(played^2) <= sum(sent^2 of the frames up to it) + tank.

The fate of every frame has a name: applied (played in time), late (arrived after its time), lost (never arrived);
sent = applied + late + lost counts the frames that are known to have been sent and whose time has come.
"""

from collections.abc import Sequence
from math import sqrt

from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.line.concealment import CONCEALMENTS, Concealed
from cogrip.protocol.line.energy_sums import BOUND_SHARE, RESERVE_FRACTION, CompensatedSum, WaveSums
from cogrip.protocol.line.jitter_buffer import PLAY, REPEAT, Frames, make_jitter_buffer
from cogrip.protocol.line.sender import Frame

FURTHEST_JUMP = 1 << 14  # frames, at which a line that is heard of for the first time may already be
HISTORY = 1024  # frames for which the receiver still knows what it had played, and the most that it keeps ahead of that
MOST_FRAMES = 32  # of one datagram: the largest redundancy

Mark = tuple[float, float, int]  # the sender's books up to a frame: made_j, port_j, heard


class LineReceiver:
    """Plays one direction's frames out. `receive` any number of datagrams, then `take` once a frame."""

    def __init__(
        self, axes: int, delay_frames: Frames, frame_s: float, tank_j: float = 0.0, concealment: Concealed = "elastic"
    ) -> None:
        self._axes = axes
        self._zero = (0.0,) * axes
        self._playout = make_jitter_buffer(delay_frames, frame_s)
        self._learns = self._playout.learns
        self._half_frame_s = 0.5 * frame_s
        self._tank = tank_j / self._half_frame_s / axes  # per axis, in W like the squares

        self._cursor: int | None = None  # number of the frame that `take` plays next
        self._newest = -1  # newest frame heard of
        self._waiting: dict[int, Frame] = {}
        self._missing: set[int] = set()  # their time came without them; they may still arrive late
        self._seen = [-1] * 256  # newest frame of recent datagrams: a second one alike is a duplicate
        self._marks: dict[int, Mark] = {}
        self._anchor: int | None = (
            None  # newest frame of the first datagram, which others are measured by until playing begins
        )
        self._totals: dict[int, tuple[Frame, Frame]] = {}  # frame after the cursor -> totals before it, not usable yet
        self._usable: tuple[int, Frame, Frame] | None = None  # the newest of frames up to the cursor
        self._settled = 0  # the newest frame whose totals are in use

        self._no_fades = (0.0,) * (2 * axes)  # sums of the squares of fades, and what each is beyond the true one
        blank = (self._zero, self._zero, self._no_fades)
        self._history = [blank] * HISTORY  # before frame n: sums of played frames, their squares, fades
        self._sums = WaveSums(axes)  # of played frames, up to now
        self._lost = list(self._zero)  # integral of what was lost before `_settled` (less fades)
        self._lost_square = list(self._zero)
        self._settled_fades = self._no_fades
        self._compensated = WaveSums(axes)  # its squares: what repayment has added to the squares played
        self._last = self._zero
        self._concealment = CONCEALMENTS[concealment](axes, frame_s)
        self._disturbed = False  # something is or may be owed: a clean line never asks the concealment
        self._late_wave: Frame | None = None  # the newest there is, come too late

        self._fresh = False
        self._sent = self._received = self._applied = self._late = self._duplicate = 0
        self._concealed = self._run = self._longest = 0
        self._played_j = CompensatedSum()
        self.mark: Mark | None = None  # of the frame just taken, where a datagram ended with it
        self.gap = False  # whether the frame just taken was not there
        self.played = False  # whether it was

    @property
    def played_j(self) -> float:
        """Energy of all waves played so far."""
        return self._played_j.value

    @property
    def newest(self) -> int:
        """Number of the newest frame heard of; -1 before the first."""
        return self._newest

    @property
    def heard(self) -> int:
        """Number after the frame that was taken last; 0 before the first."""
        return max(0, self._cursor or 0)

    def receive(self, first: int, waves: Frame, total: Frame, square: Frame, mark: Mark = (0.0, 0.0, 0)) -> bool:
        """Take in one datagram's contents. False, and nothing changed, if it cannot be of this line."""
        axes = self._axes
        count, rest = divmod(len(waves), axes)
        newest = first + count - 1
        if rest or not 0 < count <= MOST_FRAMES or len(total) != axes or len(square) != axes or not self._near(newest):
            return False
        slot = newest & 255
        if self._seen[slot] == newest:
            self._duplicate += 1
            return True
        self._seen[slot] = newest
        cursor = 0 if self._cursor is None else self._cursor
        if newest > self._newest:
            self._newest, self._fresh = newest, True
            self._late_wave = waves[-axes:] if newest < cursor else None
        waiting, missing = self._waiting, self._missing
        learns = self._learns and self._cursor is not None
        number = first
        for start in range(0, count * axes, axes):
            if number >= cursor:
                if number not in waiting:
                    waiting[number] = waves[start : start + axes]
                    self._received += 1
                    if learns:
                        self._playout.arrived(number - cursor)
            elif number in missing:
                missing.discard(number)
                self._late += 1
                self._received += 1
                if learns:
                    self._playout.arrived(number - cursor)
            number += 1
        if newest >= cursor:
            self._marks[newest] = mark
        if first > self._settled:
            self._keep_totals(first, total, square)
        return True

    def _keep_totals(self, first: int, total: Frame, square: Frame) -> None:
        """Keep the newest of those that speak of played frames alone, the others until their frame is due."""
        if self._cursor is None or first > self._cursor:
            self._totals[first] = (total, square)
        elif self._usable is None or first >= self._usable[0]:
            self._usable = first, total, square

    def _near(self, newest: int) -> bool:
        """Return whether a datagram that ends with this frame can be of this line, by which all that is kept is bounded."""
        if self._cursor is not None:
            return newest <= self._cursor + HISTORY
        if self._anchor is None:
            if newest > FURTHEST_JUMP:
                return False
            self._anchor = newest
        return abs(newest - self._anchor) <= HISTORY

    def _begin(self) -> None:
        """Set the playout by the newest frame there is; what came before it is late, or was never heard."""
        self._cursor = cursor = self._newest - self._playout.begin(self._newest - min(self._waiting))
        self._sent = max(0, cursor)
        for number in range(max(0, cursor - HISTORY), cursor):
            if self._waiting.pop(number, None) is not None:
                self._late += 1
            else:
                self._missing.add(number)
        self._waiting = {number: frame for number, frame in self._waiting.items() if number >= cursor}
        self._marks = {number: mark for number, mark in self._marks.items() if number >= cursor}
        usable = max((number for number in self._totals if number <= cursor), default=None)
        if usable is not None:
            self._usable = usable, *self._totals[usable]
            self._totals = {number: totals for number, totals in self._totals.items() if number > cursor}

    def take(self, frames: int = 1) -> Frame:
        """The wave to apply now, shape (axes,). `frames` > 1: the loop missed frames - 1 calls; those frames are not played."""
        self.mark = None
        self.played = False
        if self._cursor is None:
            if self._newest < 0:
                return self._zero
            self._begin()
        else:
            for _ in range(frames - 1):
                self._pass_over()
        number = self._cursor
        assert number is not None
        move = self._playout.decide(self._newest - number, number in self._waiting, self._fresh)
        late, self._late_wave, self._fresh = self._late_wave, None, False
        self.gap = move == REPEAT
        if move != PLAY:
            if self.gap:
                return self._bridge(number, late)
            self._pass_over()
            number += 1
        frame = self._waiting.pop(number, None)
        fades = self._history[number % HISTORY][2] if number >= 0 else self._no_fades
        if frame is not None:
            self.played = True
            self._applied += 1
            self._run = 0
        else:
            frame = self._zero
            if number >= 0:
                self._miss(number)
                frame, fades = self._fill(fades, late, self._newest < number)
        self._advance(number, frame, fades)
        played = self._play(frame)
        self.mark = self._marks.pop(number, None)
        return played

    def _miss(self, number: int) -> None:
        """A frame's time has come without it; it may still arrive late."""
        self._missing.add(number)
        self.gap = self._disturbed = True
        self._concealed += 1
        self._run += 1
        self._longest = max(self._longest, self._run)

    @property
    def _due(self) -> int:
        """Frames that are known to have been sent and whose time has come."""
        return min(self._sent, self._newest + 1)

    @property
    def lost(self) -> int:
        """Frames of `_due` that have not arrived."""
        return self._due - self._applied - self._late

    def count(self) -> LinkCount:
        return LinkCount(
            sent=self._due,
            received=self._received,
            applied=self._applied,
            lost=self.lost,
            late=self._late,
            duplicate=self._duplicate,
            pending=max(0, self._newest + 1 - self._sent),
        )

    @property
    def playout_frames(self) -> int:
        """Frames that are held back now."""
        return self._playout.frames

    def playout_account(self) -> PlayoutAccount:
        playout = self._playout
        mean, least, most = playout.depths()
        return PlayoutAccount(mean, least, most, playout.repeated, playout.skipped, self._concealed, self._longest)

    def _advance(self, number: int, frame: Frame, fades: Frame) -> None:
        """Book what was played for frame `number` and move on to the next one."""
        self._cursor = number + 1
        if number < 0:
            return
        self._sent += 1
        sums = self._sums
        sums.add(frame)
        self._history[(number + 1) % HISTORY] = sums.total, sums.squares, fades
        if number - HISTORY in self._missing:
            self._missing.discard(number - HISTORY)
        self._settle(number + 1)

    def _settle(self, cursor: int) -> None:
        """Use the newest totals that speak only of frames whose time has come."""
        newest = self._totals.pop(cursor, None)
        usable = self._usable if newest is None else (cursor, *newest)
        if usable is None:
            return
        self._usable = None
        best, total, square = usable
        if best <= self._settled or best <= cursor - HISTORY:
            return
        sums, squares, fades = self._history[best % HISTORY]
        self._settled = best
        self._settled_fades = fades
        self._lost = [a - b for a, b in zip(total, sums, strict=True)]
        lost = [a - b for a, b in zip(square, squares, strict=True)]
        self._disturbed = self._disturbed or any(self._lost) or any(lost)
        if self._disturbed:  # what may be rounding alone lends nothing; on a clean line both ends have added up alike
            lost = [less - RESERVE_FRACTION * sent for less, sent in zip(lost, square, strict=True)]
        self._lost_square = lost

    def _allowance(self, axis: int, fades: Frame) -> float:
        """Squares that may still be played beyond the frames themselves; the tank is in it."""
        fade, spent, tank = fades[axis], self._compensated.squares[axis], self._tank
        rounding = BOUND_SHARE * (tank + fade + abs(spent))
        return self._lost_square[axis] - spent + tank - (fade - self._settled_fades[axis]) - rounding

    def _books(self) -> tuple[list[float], list[float]]:
        """What is owed, and the squares that may pay for it; the tank is not for that."""
        assert self._cursor is not None
        fades = self._history[self._cursor % HISTORY][2]
        deficit, reserve = [], []
        compensated = self._compensated
        for axis, spent in enumerate(compensated.squares):
            deficit.append(self._lost[axis] - compensated.total[axis])
            reserve.append(max(0.0, min(self._lost_square[axis] - spent, self._allowance(axis, fades))))
        return deficit, reserve

    @property
    def deficit(self) -> list[float]:
        """Sum of the waves sent less sum of those played, shape (axes,) [sqrt(W)], as far as that is known."""
        return [lost - compensated for lost, compensated in zip(self._lost, self._compensated.total, strict=True)]

    def _fill(self, fades: Frame, late: Frame | None, silent: bool) -> tuple[Frame, Frame]:
        """In place of a frame that is not there: what the concealment says, as far as bank and tank lend it."""
        room = [sqrt(max(0.0, self._allowance(axis, fades))) for axis in range(self._axes)]
        filled = self._concealment.fill(self._last, room, late, silent)
        frame = [max(-most, min(most, x)) for x, most in zip(filled, room, strict=True)]
        books, excess = [], []
        for axis, x in enumerate(frame):  # as `CompensatedSum` adds
            term = x * x - fades[self._axes + axis]
            book = fades[axis] + term
            excess.append((book - fades[axis]) - term)
            books.append(book)
        return tuple(frame), (*books, *excess)

    def _bridge(self, number: int, late: Frame | None) -> Frame:
        """A take that no frame belongs to: filled as well, but what it plays is owed by the sender."""
        fades = self._history[number % HISTORY][2] if number >= 0 else self._no_fades
        frame, _ = self._fill(fades, late, self._newest < number)
        self._compensated.add(frame)
        return self._play(frame)

    def _play(self, frame: Frame) -> Frame:
        """Add this tick's repayment to a frame and count the energy."""
        if self._disturbed:
            frame = self._compensate(frame)
        square = 0.0
        for value in frame:
            square += value * value
        self._played_j.add(square * self._half_frame_s)
        self._last = frame
        return frame

    def _compensate(self, frame: Frame) -> Frame:
        deficit, reserve = self._books()
        out, compensated, spent = [], [], []
        for axis, pay in enumerate(self._concealment.pay(frame, deficit, reserve, self._last, self.gap)):
            value = frame[axis]
            reach = sqrt(value * value + reserve[axis])  # (value + p)^2 - value^2 <= bank
            paid = max(-reach, min(reach, value + pay))
            compensated.append(paid - value)
            before, after = value * value, paid * paid
            spent.append(after - before + BOUND_SHARE * (after + before))
            out.append(paid)
        self._compensated.book(compensated, spent)
        return tuple(out)

    @property
    def share(self) -> float:
        """Of sqrt(b) that the end is to keep now: less where its wave is missing (docs/decisions/0003-gaps.md)."""
        concealment = self._concealment
        return concealment.least_share + (1.0 - concealment.least_share) * concealment.quality

    def write_off(self, row: Sequence[float]) -> None:
        """The end has taken `row` [sqrt(W)] for played in the frame before, at no energy: so much less is owed."""
        self._disturbed = True
        self._compensated.book(row, self._zero)

    def _pass_over(self) -> None:
        """The loop was not there when this frame was due: it is late, if it had come at all."""
        number = self._cursor
        assert number is not None
        if number >= 0:
            if self._waiting.pop(number, None) is not None:
                self._late += 1
            else:
                self._missing.add(number)
        self._marks.pop(number, None)
        self._advance(number, self._zero, self._history[number % HISTORY][2] if number >= 0 else self._no_fades)
