"""Proxy of a tool on fixed geometry: the point nearest to the hand that no shape lets through (god-object;
Zilles and Salisbury, IROS 1995; of balls: Ruspini et al., SIGGRAPH 1997).

Symbols: x hand, p proxy [m], g_i gap between a ball of the tool and a shape at p, n_i its normal there. Each tick

    p+ = the nearest to x with n_i (p+ - p) + g_i >= 0 for all i

A convex shape lies behind the plane through its nearest point, so p+ is outside of all, however deep the hand is and however
thin the shape. p itself is allowed, so |x - p+| <= |x - p|: no move of the proxy loads the spring between the two (theory 7.7).
"""

from collections.abc import Sequence
from math import inf, sqrt

from cogrip.client.fixed_shapes import FixedShape, Vector

SWEEPS = 16  # over the planes that are in the way, at most
TOUCHING_M = 1e-9  # a sweep that moves the proxy by less ends the search
Ball = tuple[Vector, float]
"""Centre from the tool's own [m], radius [m]."""
Plane = tuple[Vector, float]
"""n and g."""


class Proxy:
    """place_m: p, None before the first tick; normals: of the shapes that hold it, orthonormal."""

    def __init__(self, balls: Sequence[Ball], shapes: Sequence[FixedShape]) -> None:
        self._pairs = [(shape, *centre, radius) for shape in shapes for centre, radius in balls]
        self._solid = [False] * len(self._pairs)  # those that a ball has been outside of
        self._due_m = [0.0] * len(self._pairs)  # path of p from which on a pair may be in the way again
        self._path_m = 0.0  # of p, at most
        self._soonest_m = 0.0  # least of `_due_m`
        self.place_m: Vector | None = None
        self.normals: list[Vector] = []

    def follow(self, hand_m: Vector) -> Vector:
        """Move the proxy towards the hand. Return where it is."""
        x, y, z = self.place_m or hand_m
        ahead = (hand_m[0] - x, hand_m[1] - y, hand_m[2] - z)
        way = sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2])
        path = self._path_m
        planes: list[Plane] = []
        if path + way >= self._soonest_m:
            due = self._due_m
            for number, (shape, cx, cy, cz, radius) in enumerate(self._pairs):
                if path + way < due[number]:
                    continue
                gap, normal = shape.gap(x + cx, y + cy, z + cz, radius)
                if gap >= 0.0:
                    self._solid[number] = True
                due[number] = path + abs(gap)
                if self._solid[number] and gap <= way:
                    _add(planes, normal, gap)
            self._soonest_m = min(due, default=inf)
        step, self.normals = _nearest(ahead, planes) if planes else (ahead, [])
        self.place_m = place = (x + step[0], y + step[1], z + step[2]) if self.normals else hand_m
        self._path_m = path + sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
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
    """Return the step nearest to `ahead` with n step + g >= 0 for all planes, and the normals that hold it (Hildreth)."""
    pushed = [0.0] * len(planes)
    a, b, c = ahead
    for _ in range(SWEEPS):
        most = 0.0
        for number, ((i, j, k), gap) in enumerate(planes):
            before = pushed[number]
            push = max(0.0, before - (i * a + j * b + k * c + gap))
            if push != before:
                more = push - before
                a, b, c = a + more * i, b + more * j, c + more * k
                pushed[number] = push
                most = max(most, abs(more))
        if most < TOUCHING_M or len(planes) == 1:
            break
    held = [normal for (normal, _), push in zip(planes, pushed, strict=True) if push > 0.0]
    return (a, b, c), held if len(held) < 2 else _orthonormal(held)


def _orthonormal(normals: Sequence[Vector]) -> list[Vector]:
    """Return unit vectors at right angles that span the same directions (Gram and Schmidt)."""
    found: list[Vector] = []
    for vector in normals:
        rest = without(vector, found)
        size = sqrt(sum([each * each for each in rest]))
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
