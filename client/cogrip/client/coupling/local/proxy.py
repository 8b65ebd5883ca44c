"""Proxy of a tool on fixed geometry: the point nearest to the hand that no shape lets through (god-object;
Zilles and Salisbury, IROS 1995; of balls: Ruspini et al., SIGGRAPH 1997).

Symbols: x hand, p proxy [m], g_i gap between a ball of the tool and a shape at p, n_i its normal there. Each tick

    p+ = the nearest to x with n_i (p+ - p) + g_i >= 0 for all i

A convex shape lies behind the plane through its nearest point, so p+ is outside of all, however deep the hand is and however
thin the shape. p itself is allowed, so |x - p+| <= |x - p|: no move of the proxy loads the spring between the two (theory 7.7).
"""

from collections.abc import Sequence
from itertools import combinations
from math import dist, hypot, inf, sqrt

from cogrip.client.coupling.local.fixed_shapes import FixedShape
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Vector

ROUNDS = 12  # most rounds in which the planes that hold the proxy are sought
TOUCHING_M = 1e-9  # largest depth behind a plane that counts as none
DEPENDENT = 1e-9  # squared sine of the angle between normals below which they count as the same
Ball = tuple[Vector, float]
"""Centre relative to the tool's [m], and radius [m]."""
Plane = tuple[Vector, float]
"""n and g."""
FREE: Sequence[Vector] = ()
"""Normals where nothing holds the proxy."""


class Proxy:
    """place_m: p, None before the first tick; normals: of the shapes that hold it, orthonormal."""

    def __init__(self, balls: Sequence[Ball], shapes: Sequence[FixedShape]) -> None:
        self._pairs = [(shape.gap, *centre, radius) for shape in shapes for centre, radius in balls]
        self._solid = [False] * len(self._pairs)  # those that a ball has been outside of
        self._due_m = [0.0] * len(self._pairs)  # path of p from which on a pair may be in the way again
        self._path_m = 0.0  # of p, at most
        self._soonest_m = 0.0  # least of `_due_m`
        self.place_m: Vector | None = None
        self.normals = FREE

    def release(self) -> None:
        """Begin anew at the hand: a shape that it is inside of does not hold it until it has been outside."""
        self.place_m = None
        self._solid = [False] * len(self._pairs)
        self._due_m = [0.0] * len(self._pairs)
        self._soonest_m = 0.0

    def follow(self, hand_m: Vector) -> Vector:
        """Move the proxy towards the hand. Return where it is."""
        x, y, z = self.place_m or hand_m
        path, move = self._path_m, dist((x, y, z), hand_m)
        if path + move < self._soonest_m:  # as mostly: nothing is near
            self._path_m, self.place_m, self.normals = path + move, hand_m, FREE
            return hand_m
        ahead = (hand_m[0] - x, hand_m[1] - y, hand_m[2] - z)
        due = self._due_m
        planes: list[Plane] = []
        for number, (gap_of, cx, cy, cz, radius) in enumerate(self._pairs):
            if path + move < due[number]:
                continue
            gap, normal = gap_of(x + cx, y + cy, z + cz, radius)
            if gap >= 0.0:
                self._solid[number] = True
            due[number] = path + abs(gap)
            if self._solid[number] and gap <= move:
                _add(planes, normal, gap)
        self._soonest_m = min(due, default=inf)
        step, self.normals = _nearest(ahead, planes) if planes else (ahead, FREE)
        self.place_m = place = (x + step[0], y + step[1], z + step[2]) if self.normals else hand_m
        self._path_m = path + hypot(*step)
        return place


def _add(planes: list[Plane], normal: Vector, gap: float) -> None:
    """Add a plane, or keep the nearer of two that are parallel: all balls of a pad on one wall are one."""
    for number, (other, nearest) in enumerate(planes):
        if other == normal:
            if gap < nearest:
                planes[number] = normal, gap
            return
    planes.append((normal, gap))


def _nearest(ahead: Vector, planes: Sequence[Plane]) -> tuple[Vector, list[Vector]]:
    """Return the step nearest to `ahead` with n step + g >= 0 for all planes, and the normals that hold it.

    The dual active-set method: the plane that is most in the way is added to those that hold the step, until none is. Each
    round takes the step further from `ahead`, so that it ends; where it has not in time, the proxy stays, which is allowed.
    """
    if len(planes) == 1:  # as mostly
        (normal, gap), (a, b, c) = planes[0], ahead
        i, j, k = normal
        push = -(i * a + j * b + k * c + gap)
        return (ahead, []) if push <= TOUCHING_M else ((a + push * i, b + push * j, c + push * k), [normal])
    step, held = ahead, list[Plane]()
    for _ in range(ROUNDS):
        a, b, c = step
        least, worst = -TOUCHING_M, None
        for plane in planes:
            (i, j, k), gap = plane
            room = i * a + j * b + k * c + gap
            if room < least:
                least, worst = room, plane
        if worst is None:
            return step, _orthonormal([normal for normal, _ in held])
        found = _held_by(ahead, worst, held)
        held.append(worst)
        if found is None:
            break
        step, held = found
    return (0.0, 0.0, 0.0), _orthonormal([normal for normal, _ in held])


def _held_by(ahead: Vector, newest: Plane, held: Sequence[Plane]) -> tuple[Vector, list[Plane]] | None:
    """Return the step nearest to `ahead` that `newest` and some of `held`, at most three in all, hold, and those planes."""
    for more in range(min(len(held), 2) + 1):
        for others in combinations(held, more):
            active = [newest, *others]
            rows = [
                [*[_along(normal, other) for other, _ in active], -(_along(normal, ahead) + gap)]
                for normal, gap in active
            ]
            pushed = _solved(rows)
            if pushed is None or min(pushed) < 0.0:
                continue
            x, y, z = ahead
            for push, ((i, j, k), _) in zip(pushed, active, strict=True):
                x, y, z = x + push * i, y + push * j, z + push * k
            if all(_along(normal, (x, y, z)) + gap >= -TOUCHING_M for normal, gap in held):
                return (x, y, z), active
    return None


def _solved(rows: list[list[float]]) -> list[float] | None:
    """Return the solution of the equations whose rows these are (Gauss, Jordan); None where they are almost dependent."""
    for at, pivot_row in enumerate(rows):
        pivot = pivot_row[at]
        if pivot < DEPENDENT:
            return None
        pivot_row[:] = [each / pivot for each in pivot_row]
        for other in rows:
            if other is not pivot_row:
                factor = other[at]
                other[:] = [each - factor * own for each, own in zip(other, pivot_row, strict=True)]
    return [row[-1] for row in rows]


def _along(one: Vector, other: Vector) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _orthonormal(normals: Sequence[Vector]) -> list[Vector]:
    """Return unit vectors at right angles that span the same directions (Gram and Schmidt)."""
    found: list[Vector] = []
    for vector in normals:
        rest = without(vector, found)
        size = sqrt(add_floats([each * each for each in rest]))
        if size > 1e-6 and len(found) < 3:
            found.append((rest[0] / size, rest[1] / size, rest[2] / size))
    return found


def without(vector: Sequence[float], directions: Sequence[Vector]) -> Vector:
    """Return a vector without its parts along directions that are orthonormal."""
    x, y, z = vector
    for i, j, k in directions:
        along = i * x + j * y + k * z
        x, y, z = x - along * i, y - along * j, z - along * k
    return x, y, z
