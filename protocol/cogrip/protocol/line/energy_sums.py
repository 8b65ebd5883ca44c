"""Compensated sums of waves, of their squares and of energies, and the bound on their rounding.

Plain sums of doubles lose with the number of terms, and a constant force is rounded the same way every time: 3e-5 J after 12
hours at 10 N. Kahan's sum keeps what an addition rounded away and puts it into the next one. With u = 2^-53 it is within (2 u
+ O(n u^2)) sum |x| of the true one for any number n of terms (Kahan 1965; Higham, Accuracy and Stability of Numerical
Algorithms, eq. 4.8). So the error of a ledger is a fraction of the energy that went through it:
docs/decisions/0013-energy-ledger.md.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

from cogrip.protocol.setting_types import PLACES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Row = tuple[float, ...]
Number = TypeVar("Number", float, "NDArray[np.float64]")

UNIT = 2.0**-53  # u, unit roundoff: an operation is off by at most this fraction of its result
RESERVE_FRACTION = 2.0**-48  # 32 u of the squares sent; 22 u are needed: no energy reserve consists of rounding
BOUND_FRACTION = 2.0**-50  # 8 u of what a bound on a wave is computed from: a root, its square, four sums of that size


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

    total    [sqrt(W)]
    squares  [W]
    """

    __slots__ = ("_errors", "squares", "total")

    def __init__(self, axes: int) -> None:
        self.total: Row = (0.0,) * axes
        self.squares: Row = (0.0,) * axes
        self._errors = [0.0] * (2 * axes)  # of `total` and `squares`, axis by axis

    def add(self, row: Sequence[float], added: Sequence[float] | None = None) -> None:
        """Add a row and its squares, or `added` in place of them. Inline like `CompensatedSum.add`."""
        if len(row) == PLACES:  # as below, without a loop
            (x, y, z), (tx, ty, tz), (sx, sy, sz) = row, self.total, self.squares
            ex, qx, ey, qy, ez, qz = self._errors
            ux, uy, uz = x - ex, y - ey, z - ez
            i, j, k = (x * x, y * y, z * z) if added is None else added
            px, py, pz = i - qx, j - qy, k - qz
            self.total = ax, ay, az = tx + ux, ty + uy, tz + uz
            self.squares = bx, by, bz = sx + px, sy + py, sz + pz
            self._errors = [
                (ax - tx) - ux, (bx - sx) - px, (ay - ty) - uy, (by - sy) - py, (az - tz) - uz, (bz - sz) - pz,
            ]  # fmt: skip
            return
        total, squares, errors = [], [], self._errors
        place = 0
        for wave, before, square_before in zip(row, self.total, self.squares, strict=True):
            term = wave - errors[place]
            after = before + term
            errors[place] = (after - before) - term
            total.append(after)
            place += 1
            term = (wave * wave if added is None else added[place >> 1]) - errors[place]
            after = square_before + term
            errors[place] = (after - square_before) - term
            squares.append(after)
            place += 1
        self.total, self.squares = tuple(total), tuple(squares)
