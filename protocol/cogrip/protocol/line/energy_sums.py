"""Compensated sums of waves, of their squares and of energies, and the bound on their rounding.

Plain sums of doubles lose with the number of terms, and a constant force is rounded the same way every time: 3e-5 J after 12
hours at 10 N. Kahan's sum keeps what an addition rounded away and puts it into the next one. With u = 2^-53 it is within (2 u
+ O(n u^2)) sum |x| of the true one for any number n of terms (Kahan 1965; Higham, Accuracy and Stability of Numerical
Algorithms, eq. 4.8). So the error of a ledger is a fraction of the energy that went through it:
docs/decisions/0013-energy-ledger.md.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Number = TypeVar("Number", float, "NDArray[np.float64]")

UNIT = 2.0**-53  # unit roundoff u: an operation is off by at most this fraction of its result
RESERVE_FRACTION = 2.0**-48
"""Fraction of the squares sent that is taken off a reserve, 32 u: 22 u are needed so that no reserve consists of rounding."""
BOUND_FRACTION = 2.0**-50
"""8 u, as a fraction of what a bound on a wave is computed from: a root, its square, four sums of that size."""

NOTHING = (0.0,) * POSE_AXES


def rounding_fraction(ticks_per_frame: int) -> float:
    """Return the largest fraction of the energy through a line that rounding alone can take from a margin.

    ticks_per_frame: M, waves in the mean of a frame. The mean is off by at most M u of its size, its square by twice that.
    """
    return (2.0 * ticks_per_frame + 32.0) * UNIT


def add_compensated(total: Number, error: Number, term: Number) -> tuple[Number, Number]:
    """Add a term by Kahan's method: return the new total, and by how much it is larger than the true sum."""
    term = term - error
    after = total + term
    return after, (after - total) - term


class CompensatedSum:
    """Sum of any number of terms. `add` repeats `add_compensated` inline: a call costs 60 % more."""

    __slots__ = ("_error", "value")

    def __init__(self, value: float = 0.0) -> None:
        self.value = value
        self._error = 0.0  # of `value` over the true sum

    def add(self, term: float) -> None:
        before = self.value
        term -= self._error
        self.value = value = before + term
        self._error = (value - before) - term


class WaveSums:
    """Sums of rows and of their squares, axis by axis, shape (axes,). Both ends of a line add in the same order, bit for bit.

    sums  of each axis [sqrt(W)], then from POSE_AXES on of the squares [W]: numbers side by side, as they are used every frame
    """

    __slots__ = ("_axes", "_errors", "sums")

    def __init__(self, axes: int) -> None:
        self._axes = axes
        self.sums = list(NOTHING + NOTHING)
        self._errors = list(NOTHING + NOTHING)  # of `sums` over the true ones

    @property
    def total(self) -> Row:
        """Sum of the rows [sqrt(W)]."""
        return self.totals()

    def totals(self) -> Row:
        """Return `total`."""
        sums = self.sums
        return tuple([sums[axis] for axis in range(self._axes)])

    @property
    def squares(self) -> Row:
        """Sum of the squares [W]."""
        return self.square_sums()

    def square_sums(self) -> Row:
        """Return `squares`."""
        sums = self.sums
        return tuple([sums[6 + axis] for axis in range(self._axes)])

    def add(self, row: Sequence[float], added: Sequence[float] | None = None) -> None:
        """Add a row and its squares, or `added` in place of them. Inline like `CompensatedSum.add`."""
        sums, errors = self.sums, self._errors
        if len(row) == PLACES:  # as below, without a loop
            x, y, z = row
            if added is None:
                i, j, k = x * x, y * y, z * z
            else:
                i, j, k = added
            tx, ty, tz, sx, sy, sz = sums[0], sums[1], sums[2], sums[6], sums[7], sums[8]
            ux, uy, uz = x - errors[0], y - errors[1], z - errors[2]
            px, py, pz = i - errors[6], j - errors[7], k - errors[8]
            ax, ay, az = tx + ux, ty + uy, tz + uz
            bx, by, bz = sx + px, sy + py, sz + pz
            sums[0], sums[1], sums[2], sums[6], sums[7], sums[8] = ax, ay, az, bx, by, bz
            errors[0], errors[1], errors[2] = (ax - tx) - ux, (ay - ty) - uy, (az - tz) - uz
            errors[6], errors[7], errors[8] = (bx - sx) - px, (by - sy) - py, (bz - sz) - pz
            return
        for axis in range(self._axes):
            wave, before = row[axis], sums[axis]
            term = wave - errors[axis]
            sums[axis] = after = before + term
            errors[axis] = (after - before) - term
            square, before = wave * wave if added is None else added[axis], sums[6 + axis]
            term = square - errors[6 + axis]
            sums[6 + axis] = after = before + term
            errors[6 + axis] = (after - before) - term

    def add_numbers(self, row: Sequence[float], squares: Sequence[float]) -> None:
        """Add the row, and these in place of its squares: `add` for numbers that lie side by side."""
        sums, errors = self.sums, self._errors
        for axis in range(self._axes):
            before, term = sums[axis], row[axis] - errors[axis]
            sums[axis] = after = before + term
            errors[axis] = (after - before) - term
            before, term = sums[6 + axis], squares[axis] - errors[6 + axis]
            sums[6 + axis] = after = before + term
            errors[6 + axis] = (after - before) - term

    def add_at(self, values: Sequence[float], first: int) -> None:
        """Add the row that begins at this place of `values`, and its squares."""
        sums, errors = self.sums, self._errors
        for axis in range(self._axes):
            wave, before = values[first + axis], sums[axis]
            term = wave - errors[axis]
            sums[axis] = after = before + term
            errors[axis] = (after - before) - term
            before, term = sums[6 + axis], wave * wave - errors[6 + axis]
            sums[6 + axis] = after = before + term
            errors[6 + axis] = (after - before) - term
