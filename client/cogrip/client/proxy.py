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

SWEEPS = 8  # over the planes that are in the way
TOUCHING_M = 1e-9
Ball = tuple[Vector, float]
"""Centre from the tool's own [m], radius [m]."""


class Proxy:
    """place_m: p, None before the first tick; normals: of the shapes that hold it, orthonormal."""

    def __init__(self, balls: Sequence[Ball], shapes: Sequence[FixedShape]) -> None:
        self._pairs = [(shape, *centre, radius) for shape in shapes for centre, radius in balls]
        self._solid = [False] * len(self._pairs)  # those that a ball has been outside of
        self._clear_m = -inf  # from here on nothing is nearer than this
        self.place_m: Vector | None = None
        self.normals: list[Vector] = []

    def follow(self, hand_m: Vector) -> Vector:
        """Move the proxy towards the hand. Return where it is."""
        before = self.place_m or hand_m
        x, y, z = before
        ahead = [hand_m[0] - x, hand_m[1] - y, hand_m[2] - z]
        way = sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2])
        if way < self._clear_m:
            self._clear_m -= way
            self.place_m = hand_m
            return hand_m
        near, least = [], inf
        for number, (shape, cx, cy, cz, radius) in enumerate(self._pairs):
            gap, normal = shape.gap(x + cx, y + cy, z + cz, radius)
            if gap >= 0.0:
                self._solid[number] = True
            if self._solid[number] and gap <= way:
                near.append((normal, gap))
            least = min(least, abs(gap))
        self.normals = []
        if not near:
            self._clear_m = least - way
            self.place_m = hand_m
            return hand_m
        self._clear_m = -inf
        step, pushed = _nearest(ahead, near)
        self.normals = _orthonormal([normal for (normal, _), push in zip(near, pushed, strict=True) if push > 0.0])
        self.place_m = place = (x + step[0], y + step[1], z + step[2]) if self.normals else hand_m
        return place


def _nearest(ahead: Sequence[float], near: Sequence[tuple[Vector, float]]) -> tuple[Vector, list[float]]:
    """Return the step nearest to `ahead` with n step + g >= 0 for all, and how far each plane pushes it back (Hildreth)."""
    pushed = [0.0] * len(near)
    a, b, c = ahead
    for _ in range(SWEEPS if len(near) > 1 else 1):
        for number, ((i, j, k), gap) in enumerate(near):
            before = pushed[number]
            push = max(0.0, before - (i * a + j * b + k * c + gap))
            if push != before:
                more = push - before
                a, b, c = a + more * i, b + more * j, c + more * k
                pushed[number] = push
    return (a, b, c), pushed


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
