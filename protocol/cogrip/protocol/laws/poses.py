"""Ways between places, and between poses: what takes the part of a difference where a hand turns (theory 5b.4).

A pose is a row of six: a place [m], and behind it a rotation vector r times a length l, in the world's frame. With R of r,

    way from p to q      (q - p, l log(R_q R_p^-1))
    p moved by (d, e)    (p + d, l log(exp(e / l) R_p))

K s^2 / 2 of a way s from p to q is a potential: what moves q by dq changes it by K s dq, however far q is turned.
"""

from collections.abc import Sequence

from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import between, exp, log, product


class Places:
    """Places, in each of which a way is a difference."""

    def way(self, begin: Sequence[float], end: Sequence[float]) -> list[float]:
        """Return the way from one to the other."""
        return [b - a for a, b in zip(begin, end, strict=True)]

    def moved(self, begin: Sequence[float], way: Sequence[float]) -> list[float]:
        """Return where one is that has gone this way."""
        return [a + each for a, each in zip(begin, way, strict=True)]


class Poses(Places):
    """Poses. length_m: l; 1 for rotation vectors in radians."""

    def __init__(self, length_m: float) -> None:
        self.length_m = length_m

    def way(self, begin: Sequence[float], end: Sequence[float]) -> list[float]:
        turned = between(exp(self.radians(begin)), exp(self.radians(end)))
        return Places.way(self, begin[:PLACES], end[:PLACES]) + [self.length_m * each for each in turned]

    def moved(self, begin: Sequence[float], way: Sequence[float]) -> list[float]:
        turned = log(product(exp(self.radians(way)), exp(self.radians(begin))))
        return Places.moved(self, begin[:PLACES], way[:PLACES]) + [self.length_m * each for each in turned]

    def radians(self, row: Sequence[float]) -> list[float]:
        """Return the rotation of a pose, or of a way [rad]."""
        return [each / self.length_m for each in row[PLACES:]]


IN_PLACES = Places()
IN_RADIANS = Poses(1.0)
"""Space of rows whose rotation vectors are in radians, as messages have them."""
