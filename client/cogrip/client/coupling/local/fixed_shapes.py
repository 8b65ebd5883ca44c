"""Distances from a ball to fixed convex shapes, in plain floats.

Symbols, in a shape's own frame: q the ball's centre [m], r its radius, g gap between the two surfaces [m], negative inside,
n unit normal, outwards, of the surface nearest to q. A convex shape lies on one side of the plane through its nearest point.
"""

from collections.abc import Callable, Sequence
from math import copysign, hypot, sqrt

from cogrip.machine.rows import Vector
from cogrip.protocol.drawing import Shape, ShapeKind
from cogrip.protocol.laws.rotations import turned

Nearest = tuple[float, Vector]
"""Distance from the surface [m], and n."""
ALONG_Z: Vector = (0.0, 0.0, 1.0)


def _plane(size: Sequence[float], x: float, y: float, z: float) -> Nearest:
    return z, ALONG_Z


def _sphere(size: Sequence[float], x: float, y: float, z: float) -> Nearest:
    away = sqrt(x * x + y * y + z * z)
    return away - size[0], (x / away, y / away, z / away) if away else ALONG_Z


def _capsule(size: Sequence[float], x: float, y: float, z: float) -> Nearest:
    half = size[1]
    distance, normal = _sphere(size, x, y, z - min(max(z, -half), half))
    if normal is ALONG_Z:
        normal = (1.0, 0.0, 0.0)  # on its axis
    return distance, normal


def _cylinder(size: Sequence[float], x: float, y: float, z: float) -> Nearest:
    radius, half = size[0], size[1]
    away = hypot(x, y)
    beside, above = away - radius, abs(z) - half
    outward = (x / away, y / away) if away else (1.0, 0.0)
    if beside <= 0.0 or above <= 0.0:
        if beside > above:
            return beside, (*outward, 0.0)
        return above, (0.0, 0.0, copysign(1.0, z))
    distance = hypot(beside, above)
    return distance, (outward[0] * beside / distance, outward[1] * beside / distance, copysign(above / distance, z))


def _box(size: Sequence[float], x: float, y: float, z: float) -> Nearest:
    i, j, k = abs(x) - size[0], abs(y) - size[1], abs(z) - size[2]
    if i >= j and i >= k:
        if j <= 0.0 and k <= 0.0:  # above a face, or inside
            return i, (1.0 if x > 0.0 else -1.0, 0.0, 0.0)
    elif j >= k:
        if i <= 0.0 and k <= 0.0:
            return j, (0.0, 1.0 if y > 0.0 else -1.0, 0.0)
    elif i <= 0.0 and j <= 0.0:
        return k, (0.0, 0.0, 1.0 if z > 0.0 else -1.0)
    i, j, k = max(i, 0.0), max(j, 0.0), max(k, 0.0)
    distance = sqrt(i * i + j * j + k * k)
    return distance, (copysign(i / distance, x), copysign(j / distance, y), copysign(k / distance, z))


_NEAREST: dict[ShapeKind, Callable[[Sequence[float], float, float, float], Nearest]] = {
    "plane": _plane, "sphere": _sphere, "capsule": _capsule, "cylinder": _cylinder, "box": _box,
}  # fmt: skip
KINDS = frozenset(_NEAREST)
"""Kinds of shapes that a client renders contact with."""


class FixedShape:
    """One shape. `shape` has its place and orientation in the hand's own frame."""

    def __init__(self, shape: Shape) -> None:
        self._nearest = _NEAREST[shape.kind]
        self._size = shape.size_m
        self._place = shape.place_m
        quaternion = shape.orientation
        self._axes = [turned(quaternion, unit) for unit in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        self._upright = tuple(quaternion[1:]) == (0.0, 0.0, 0.0)

    def gap(self, x: float, y: float, z: float, radius: float) -> Nearest:
        """Return g [m] and n of a ball of this radius with its centre here."""
        p, q, r = self._place
        x, y, z = x - p, y - q, z - r
        if self._upright:
            distance, normal = self._nearest(self._size, x, y, z)
            return distance - radius, normal
        a, b, c = self._axes
        distance, (i, j, k) = self._nearest(
            self._size, a[0] * x + a[1] * y + a[2] * z, b[0] * x + b[1] * y + b[2] * z, c[0] * x + c[1] * y + c[2] * z
        )
        normal = (i * a[0] + j * b[0] + k * c[0], i * a[1] + j * b[1] + k * c[1], i * a[2] + j * b[2] + k * c[2])
        return distance - radius, normal
