"""The passive line: one direction of waves over a network that delays, loses, repeats and reorders (theory section 3.5).

    sender    numbers the frames, repeats the last R of them in every datagram, and adds the running totals
              (sum w, sum w^2) of all frames before the oldest of these
    receiver  plays the frames out at a fixed delay of D frames, each at most once; a frame that is not there in time
              plays as 0, a matched termination; what was lost beyond repair is known from the totals and is paid back
              slowly, out of the lost frames' own energy (the bank). What the bank or the tank holds also lets the last
              wave fade out through a gap instead of dropping to 0 (docs/decisions/0003-gaps.md)

Invariant, per axis and at every tick: sum(played^2) <= sum(sent^2 of the frames up to it) + tank.

The fate of every frame has a name: applied (played in time), late (arrived after its time), lost (never arrived);
sent = applied + late + lost counts the frames that are known to have been sent and whose time has come.
"""

from collections import deque
from math import sqrt

from cogrip.protocol.accounts import LinkCount

REPAY_SHARE = 1.0 / 16.0  # of the debt, in one frame
REPAY_LIMIT = 0.02  # sqrt(W) in one frame: faster repayment makes force peaks
FADE = 0.85  # of the last wave, from frame to frame, in a gap, while there is energy to lend
RESERVE = 8.0  # frames like the last one that repayment leaves in the bank for the next gap
REALIGN_WINDOW = 128  # fresh datagrams that must agree before the playout moves by one frame
FURTHEST_JUMP = 1 << 12  # frames; a number further ahead of the playout than this is no frame of this session
HISTORY = 1024  # frames for which the receiver still knows what it had played

Frame = tuple[float, ...]
Mark = tuple[float, float, int]  # the sender's books up to a frame: made_j, port_j, heard


class LineSender:
    """Numbers frames and keeps what a datagram has to carry. Waves are tuples of shape (axes,) [sqrt(W)]."""

    __slots__ = ("_most", "_square", "_total", "_values", "next_number")

    def __init__(self, axes: int, redundancy: int) -> None:
        self._most = redundancy * axes
        self._values: deque[float] = deque()  # of the newest frames, frame by frame, axis by axis
        self._total = (0.0,) * axes
        self._square = (0.0,) * axes
        self.next_number = 0

    def push(self, wave: Frame) -> None:
        values = self._values
        values.extend(wave)
        self.next_number += 1
        if len(values) > self._most:
            oldest = [values.popleft() for _ in wave]
            self._total = tuple([total + value for total, value in zip(self._total, oldest, strict=True)])
            self._square = tuple([square + value * value for square, value in zip(self._square, oldest, strict=True)])

    def contents(self) -> tuple[int, Frame, Frame, Frame]:
        """(number of the oldest frame, waves frame by frame, totals before it, squares before it)."""
        waves = tuple(self._values)
        return self.next_number - len(waves) // len(self._total), waves, self._total, self._square


class LineReceiver:
    """Plays one direction's frames out. `receive` any number of datagrams, then `take` once a frame."""

    def __init__(self, axes: int, delay_frames: int, frame_s: float, tank_j: float = 0.0) -> None:
        self._axes = axes
        self._zero = (0.0,) * axes
        self._delay = delay_frames
        self._half_frame_s = 0.5 * frame_s
        self._tank = tank_j / self._half_frame_s / axes  # per axis, in W like the squares

        self._cursor: int | None = None  # number of the frame that `take` plays next
        self._newest = -1  # newest frame heard of
        self._waiting: dict[int, Frame] = {}
        self._missing: set[int] = set()  # their time came without them; they may still arrive late
        self._seen = [-1] * 256  # newest frame of recent datagrams: a second one alike is a duplicate
        self._marks: dict[int, Mark] = {}
        self._totals: dict[int, tuple[Frame, Frame]] = {}  # frame -> totals before it, not usable yet
        self._settled = 0  # the newest frame whose totals are in use

        blank = (self._zero, self._zero, self._zero)
        self._history = [blank] * HISTORY  # before frame n: sums of played frames, their squares, squares of fades
        self._lost = list(self._zero)  # integral of what was lost before `_settled` (less fades)
        self._lost_square = list(self._zero)
        self._settled_fades = self._zero
        self._repaid = list(self._zero)
        self._spent = list(self._zero)  # what repayment has added to the squares played
        self._last = self._zero
        self._indebted = False

        self._fresh = False
        self._spare_seen = 0
        self._spare_low = self._spare_high = 0
        self._sent = self._received = self._applied = self._late = self._duplicate = 0
        self.realigned = 0
        self.played_j = 0.0  # energy of all waves played so far
        self.mark: Mark | None = None  # of the frame just taken, where a datagram ended with it
        self.gap = False  # whether the frame just taken was not there

    @property
    def heard(self) -> int:
        """Number after the frame that was taken last; 0 before the first."""
        return max(0, self._cursor or 0)

    def receive(self, first: int, waves: Frame, total: Frame, square: Frame, mark: Mark = (0.0, 0.0, 0)) -> bool:
        """Take in one datagram's contents. False, and nothing changed, if it cannot be of this line."""
        axes = self._axes
        count, rest = divmod(len(waves), axes)
        newest = first + count - 1
        if (
            rest
            or not count
            or len(total) != axes
            or len(square) != axes
            or newest > (self._cursor or 0) + FURTHEST_JUMP
        ):
            return False
        slot = newest & 255
        if self._seen[slot] == newest:
            self._duplicate += 1
            return True
        self._seen[slot] = newest
        cursor = 0 if self._cursor is None else self._cursor
        if newest > self._newest:
            self._newest = newest
            self._fresh = True
        waiting, missing = self._waiting, self._missing
        number = first
        for start in range(0, count * axes, axes):
            if number >= cursor:
                if number not in waiting:
                    waiting[number] = waves[start : start + axes]
                    self._received += 1
            elif number in missing:
                missing.discard(number)
                self._late += 1
                self._received += 1
            number += 1
        if newest >= cursor:
            self._marks[newest] = mark
        if first > self._settled:
            self._totals[first] = (total, square)
        return True

    def _begin(self) -> None:
        """Set the playout by the newest frame there is; what came before it is late, or was never heard."""
        self._cursor = cursor = self._newest - self._delay
        self._sent = max(0, cursor)
        for number in range(max(0, cursor - HISTORY), cursor):
            if self._waiting.pop(number, None) is not None:
                self._late += 1
            else:
                self._missing.add(number)
        self._waiting = {number: frame for number, frame in self._waiting.items() if number >= cursor}
        self._marks = {number: mark for number, mark in self._marks.items() if number >= cursor}

    def take(self, frames: int = 1) -> Frame:
        """The wave to apply now, shape (axes,). `frames` > 1: the loop missed frames - 1 calls; those frames are not played."""
        self.mark = None
        if self._cursor is None:
            if self._newest < 0:
                return self._zero
            self._begin()
        else:
            for _ in range(frames - 1):
                self._pass_over()
        self.gap = stall = self._realign() if self._fresh else False
        if stall:
            return self._play(self._zero)
        number = self._cursor
        assert number is not None
        frame = self._waiting.pop(number, None)
        fades = self._history[number % HISTORY][2] if number >= 0 else self._zero
        if frame is not None:
            self._applied += 1
        else:
            if number >= 0:
                self._missing.add(number)
                self.gap = True
            frame, fades = self._fade(fades)
        self._advance(number, frame, fades)
        played = self._play(frame)
        self.mark = self._marks.pop(number, None)
        return played

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

    def _advance(self, number: int, frame: Frame, fades: Frame) -> None:
        """Book what was played for frame `number` and move on to the next one."""
        self._cursor = number + 1
        if number < 0:
            return
        self._sent += 1
        history = self._history
        sums, squares, _ = history[number % HISTORY]
        history[(number + 1) % HISTORY] = (
            tuple([a + b for a, b in zip(sums, frame, strict=True)]),
            tuple([a + b * b for a, b in zip(squares, frame, strict=True)]),
            fades,
        )
        if number - HISTORY in self._missing:
            self._missing.discard(number - HISTORY)
        self._settle(number + 1)

    def _settle(self, cursor: int) -> None:
        """Use the newest totals that speak only of frames whose time has come."""
        best = -1
        for number in list(self._totals):
            if number <= cursor:
                if number > best:
                    if best >= 0:
                        del self._totals[best]
                    best = number
                else:
                    del self._totals[number]
        if best <= self._settled or best <= cursor - HISTORY:
            self._totals.pop(best, None)
            return
        total, square = self._totals.pop(best)
        sums, squares, fades = self._history[best % HISTORY]
        self._settled = best
        self._settled_fades = fades
        self._lost = [a - b for a, b in zip(total, sums, strict=True)]
        self._lost_square = [a - b for a, b in zip(square, squares, strict=True)]
        self._indebted = self._indebted or any(self._lost) or any(self._lost_square)

    def _allowance(self, axis: int, fades: Frame) -> float:
        """Squares that may still be played beyond the frames themselves; the tank is in it."""
        unsettled = fades[axis] - self._settled_fades[axis]
        return self._lost_square[axis] - self._spent[axis] + self._tank - unsettled

    def _fade(self, fades: Frame) -> tuple[Frame, Frame]:
        """In place of a frame that is not there: 0, or, lent by bank and tank, the last wave fading out."""
        if not self._tank and not self._indebted:
            return self._zero, fades
        frame, books = [], []
        for axis, last in enumerate(self._last):
            room = sqrt(max(0.0, self._allowance(axis, fades)))
            value = max(-room, min(room, FADE * last))
            frame.append(value)
            books.append(fades[axis] + value * value)
        return tuple(frame), tuple(books)

    def _play(self, frame: Frame) -> Frame:
        """Add this tick's repayment to a frame and count the energy."""
        if self._indebted:
            frame = self._repay(frame)
        square = 0.0
        for value in frame:
            square += value * value
        self.played_j += square * self._half_frame_s
        self._last = frame
        return frame

    def _repay(self, frame: Frame) -> Frame:
        assert self._cursor is not None
        fades = self._history[self._cursor % HISTORY][2]
        out = []
        for axis, value in enumerate(frame):
            debt = self._lost[axis] - self._repaid[axis]
            bank = self._lost_square[axis] - self._spent[axis]
            bank = max(0.0, min(bank, self._allowance(axis, fades)) - RESERVE * self._last[axis] * self._last[axis])
            reach = sqrt(value * value + bank)  # (value + r)^2 - value^2 <= bank
            pay = max(-REPAY_LIMIT, min(REPAY_LIMIT, REPAY_SHARE * debt))
            pay = max(-value - reach, min(reach - value, pay))
            paid = value + pay
            self._repaid[axis] += pay
            self._spent[axis] += paid * paid - value * value
            out.append(paid)
        return tuple(out)

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
        self._advance(number, self._zero, self._history[number % HISTORY][2] if number >= 0 else self._zero)

    def _realign(self) -> bool:
        """Follow a drifting clock: when all of a window came earlier, or later, than the playout assumes, move one frame.

        True: let this tick pass without playing a frame. Either way nothing is played twice, and what is passed over is
        repaid like any lost frame.
        """
        assert self._cursor is not None
        self._fresh = False
        spare = self._newest - self._cursor
        if not self._spare_seen:
            self._spare_low = self._spare_high = spare
        self._spare_low = min(self._spare_low, spare)
        self._spare_high = max(self._spare_high, spare)
        self._spare_seen += 1
        if self._spare_seen < REALIGN_WINDOW:
            return False
        self._spare_seen = 0
        if self._spare_low > self._delay:
            self._pass_over()
            self.realigned += 1
        elif self._spare_high < self._delay:
            self.realigned += 1
            return True
        return False
