"""Sums that go on for hours: of waves, of their squares, of energies; and what rounding can do to them.

Plain sums of doubles go wrong with the number of terms, and a held force is rounded the same way every time: after 12 hours at
10 N by 3e-5 J. Kahan's sum keeps what an addition rounded away, and puts it into the next one: with u = 2^-53 it is within
(2 u + O(n u^2)) sum |x| of the true one however many terms n there are (Kahan 1965; Higham, Accuracy and Stability of
Numerical Algorithms, eq. 4.8). So the error of energy books is a share of the energy that went through, which
docs/decisions/0013-energy-books.md adds up.
"""

from collections.abc import Sequence

Row = tuple[float, ...]

UNIT = 2.0**-53  # u: an operation is off by at most so much of its result
RESERVE_FRACTION = (
    2.0**-48
)  # of the squares sent: rounding cannot make a bank look fuller by as much (32 u, of which 22 are needed)
BOUND_SHARE = 2.0**-50  # of what a bound on a wave is computed from: a root, its square, four sums of that size (8 u)


def rounding_share(ticks_per_frame: int) -> float:
    """Of the energy that went through a line: what rounding alone can put its margins out by, at most.

    ticks_per_frame: M, waves of which one frame is the mean. The mean is off by at most M u of what it is of, its square twice.
    """
    return (2.0 * ticks_per_frame + 32.0) * UNIT


class CompensatedSum:
    """Sum of any number of terms."""

    __slots__ = ("_excess", "value")

    def __init__(self, value: float = 0.0) -> None:
        self.value = value
        self._excess = 0.0  # of `value` over the true sum

    def add(self, term: float) -> None:
        before = self.value
        term -= self._excess
        self.value = value = before + term
        self._excess = (value - before) - term


class WaveSums:
    """Sums of rows and of their squares, axis by axis, shape (axes,). Both ends of a line add up alike, to the last bit."""

    __slots__ = ("_excess", "squares", "total")

    def __init__(self, axes: int) -> None:
        self.total: Row = (0.0,) * axes
        self.squares: Row = (0.0,) * axes
        self._excess = [0.0] * (2 * axes)  # of `total` and `squares`, axis by axis

    def add(self, row: Sequence[float]) -> None:
        total, squares, excess = [], [], self._excess
        place = 0
        for wave, before, square_before in zip(row, self.total, self.squares, strict=True):
            term = wave - excess[place]
            after = before + term
            excess[place] = (after - before) - term
            total.append(after)
            term = wave * wave - excess[place + 1]
            after = square_before + term
            excess[place + 1] = (after - square_before) - term
            squares.append(after)
            place += 2
        self.total, self.squares = tuple(total), tuple(squares)

    def book(self, row: Sequence[float], more: Sequence[float]) -> None:
        """As `add`, where the squares grow by `more`."""
        total, squares, excess = [], [], self._excess
        place = 0
        for wave, square, before, square_before in zip(row, more, self.total, self.squares, strict=True):
            term = wave - excess[place]
            after = before + term
            excess[place] = (after - before) - term
            total.append(after)
            term = square - excess[place + 1]
            after = square_before + term
            excess[place + 1] = (after - square_before) - term
            squares.append(after)
            place += 2
        self.total, self.squares = tuple(total), tuple(squares)
