"""The energy ledger of a line's receiver: what was sent, lost, played in gaps and compensated (SPEC.md 5.4, theory 3.5).

Invariant, per axis and at every pop, c the number of the next frame: sum(played^2) <= sum(sent^2 of frames below c) + credit.

All squares are in W per axis: an energy over T_n / 2. A frame's totals are the sums over all frames before it, by the sender.
"""

from array import array
from collections.abc import Sequence

from cogrip.protocol.laws.square_root import square_root
from cogrip.protocol.line.energy_sums import BOUND_FRACTION, NOTHING, RESERVE_FRACTION, WaveSums
from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.line.sender import Frame

HISTORY = 1024  # frames for which the receiver still knows what it had played
FIRST_ROWS = 32  # rows of the history at first; it grows up to HISTORY where totals arrive late
RESERVED_CREDIT = 0.5  # fraction of the credit that compensation leaves for the next gap


class WaveLedger:
    """Ledger of one direction. Rows have shape (axes,).

    settled           number of the frame before which sums sent and sums played were last compared
    disturbed         a frame has been lost, or may have been: before that nothing is compensated
    credit            squares that each axis may play beyond those sent, 2 E_0 / (T_n axes) [W], E_0 the energy credit of the
                      line; the next seat session begins with what is left of it (`left`)
    deficits, reserves  of each axis, as `measure` found them: position deficit [sqrt(W)], and squares that compensation may
                      spend [W]
    """

    def __init__(self, axes: int, credit_w: float) -> None:
        self._axes = axes
        self.credit = credit_w
        self.settled = 0
        self.disturbed = False
        self._played = WaveSums(axes)  # frames that were due, or their fillings, without compensation
        self._filled = WaveSums(axes)  # fillings among them
        self._compensated = WaveSums(axes)  # compensation; its squares are what it added to the squares played
        # before frame n, at n modulo its rows: sums of `_played`, squares, squares of `_filled`; none before `settled` is used
        self._rows, self._row = FIRST_ROWS, 3 * axes
        self._history = array("d", bytes(8 * self._rows * self._row))
        self._nothing = array("d", bytes(8 * self._row))  # before the first frame that is played
        self._entered = 0  # rows so far
        self._cursor = 0  # n of the last one
        self._totals: dict[int, tuple[Frame, Frame]] = {}  # totals of frames above the cursor, not usable yet
        self._usable = -1  # frame up to the cursor with the newest totals that are not compared yet
        self._usable_total, self._usable_squares = list(NOTHING), list(NOTHING)
        self._lost = list(NOTHING)  # sum of the waves lost before frame `settled`, less fillings
        self._lost_squares = list(NOTHING)
        self._settled_fillings = list(NOTHING)  # squares of the fillings before it [W]
        self.deficits, self.reserves = list(NOTHING), list(NOTHING)

    @property
    def deficit(self) -> list[float]:
        """Sum of the waves sent less sum of those played, shape (axes,) [sqrt(W)], as far as that is known."""
        lost, compensated = self._lost, self._compensated.sums
        return [lost[axis] - compensated[axis] for axis in range(self._axes)]

    @property
    def lost_squares(self) -> list[float]:
        """Squares lost before frame `settled`, less fillings and what may be rounding [W], shape (axes,)."""
        lost = self._lost_squares
        return [lost[axis] for axis in range(self._axes)]

    def add_totals(self, datagram: ReceivedWaves, cursor: int) -> None:
        """Keep the newest totals up to the cursor, and those of later frames until their frame is due.

        cursor: below 0 before playing has begun
        """
        first = datagram.first
        if first <= self.settled:
            return
        if first > cursor:
            self._totals[first] = datagram.total_row(), datagram.squares_row()
        elif first >= self._usable:
            self._use(first, datagram.total, datagram.squares)

    def _use(self, first: int, total: Sequence[float], squares: Sequence[float]) -> None:
        """Take these totals as the newest ones."""
        self._usable = first
        for axis in range(self._axes):
            self._usable_total[axis] = total[axis]
            self._usable_squares[axis] = squares[axis]

    def _use_kept(self, first: int, totals: tuple[Frame, Frame]) -> None:
        """Take totals that were kept until their frame was due."""
        self._usable = first
        total, squares = totals
        for axis in range(self._axes):
            self._usable_total[axis] = total[axis]
            self._usable_squares[axis] = squares[axis]

    def begin(self, cursor: int) -> None:
        """Sort the totals that came before playing began."""
        usable = max((number for number in self._totals if number <= cursor), default=None)
        if usable is not None:
            self._use_kept(usable, self._totals[usable])
            self._totals = {number: totals for number, totals in self._totals.items() if number > cursor}

    def add_played(self, number: int, frame: Frame) -> None:
        """Add frame `number`, or its filling, without compensation, and compare with the newest totals."""
        cursor = number + 1
        self._played.add(frame)
        self._cursor = cursor
        self._entered += 1
        if cursor - self.settled >= self._rows and self._rows < HISTORY:
            self._grow()
        history, played, filled = self._history, self._played.sums, self._filled.sums
        at, axes = cursor % self._rows * self._row, self._axes
        for axis in range(axes):
            history[at + axis] = played[axis]
            history[at + axes + axis] = played[6 + axis]
            history[at + 2 * axes + axis] = filled[6 + axis]
        newest = self._totals.pop(cursor, None) if self._totals else None
        if newest is not None:
            self._use_kept(cursor, newest)
        first, self._usable = self._usable, -1
        if first >= 0 and (newest is not None or (self.settled < first and cursor - HISTORY < first)):
            self._settle(first)

    def _grow(self) -> None:
        """Give the history twice the rows."""
        before, rows, row, split = self._history, self._rows, self._row, self._cursor // self._rows * self._rows
        self._history = longer = array("d", bytes(16 * rows * row))
        self._rows = 2 * rows
        for first, end in (
            (self._cursor - rows, split),
            (split, self._cursor),
        ):  # each lies in one piece, before and now
            at, to, size = first % rows * row, first % (2 * rows) * row, (end - first) * row
            longer[to : to + size] = before[at : at + size]

    def _settle(self, number: int) -> None:
        """Compare the totals of frame `number` with what was played before it: nothing, if it was before the first frame."""
        total, squares = self._usable_total, self._usable_squares
        history, at, axes = self._history, number % self._rows * self._row, self._axes
        if self._cursor - number >= self._entered:
            history, at = self._nothing, 0
        self.settled = number
        for axis in range(axes):
            sent, sent_square = total[axis], squares[axis]
            if sent != history[at + axis] or sent_square != history[at + axes + axis]:
                self.disturbed = True  # equal sums, of both ends in the same order, mean no loss
            self._settled_fillings[axis] = history[at + 2 * axes + axis]
        if not self.disturbed:
            return
        lost, lost_squares = self._lost, self._lost_squares
        for axis in range(axes):
            sent, sent_square = total[axis], squares[axis]
            lost[axis] = sent - history[at + axis]
            less = sent_square - history[at + axes + axis]
            lost_squares[axis] = less - RESERVE_FRACTION * sent_square  # what may be rounding is no reserve

    @property
    def settled_fillings(self) -> list[float]:
        """Squares of the fillings before frame `settled` [W], shape (axes,)."""
        fillings = self._settled_fillings
        return [fillings[axis] for axis in range(self._axes)]

    def add_filling(self, frame: Frame) -> None:
        """Enter a filling, before `add_played`."""
        self._filled.add(frame)

    def add_compensation(self, row: Sequence[float], squares: Sequence[float]) -> None:
        """Enter compensation [sqrt(W)] and by how much it raises the squares played [W]."""
        self._compensated.add(row, squares)

    def compensated_by(self, row: Sequence[float], squares: Sequence[float]) -> None:
        """Enter compensation as `add_compensation` does, of numbers that lie side by side."""
        self._compensated.add_numbers(row, squares)

    def _allowance(self, axis: int) -> float:
        """Return the squares that may still be played on an axis beyond the frames themselves, credit included [W]."""
        credit, filled, spent = self.credit, self._filled.sums[6 + axis], self._compensated.sums[6 + axis]
        left = self._lost_squares[axis] - spent + credit - (filled - self._settled_fillings[axis])
        return left - BOUND_FRACTION * (credit + filled + abs(spent))

    def limits(self) -> list[float]:
        """Return the largest filling on each axis [sqrt(W)]."""
        return [square_root(max(0.0, self._allowance(axis))) for axis in range(self._axes)]

    def measure(self) -> None:
        """Compute `deficits` and `reserves`."""
        kept, lost, compensated = RESERVED_CREDIT * self.credit, self._lost, self._compensated.sums
        for axis in range(self._axes):
            left = self._allowance(axis)
            self.deficits[axis] = lost[axis] - compensated[axis]
            self.reserves[axis] = left - kept if left > kept else 0.0

    @property
    def left(self) -> float:
        """Unspent credit [W]: that of the next seat session, so that all of them together have one credit."""
        return max(0.0, min(self._allowance(axis) for axis in range(self._axes)))
