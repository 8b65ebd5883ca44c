"""Rotations in plain floats: unit quaternions (w, x, y, z) and rotation vectors [rad], in the world's frame.

A rotation vector r turns about r / |r| by |r|; of a quaternion it is the shorter one, |r| <= pi.
"""

from collections.abc import Sequence
from math import atan2, cos, sin, sqrt

from cogrip.machine.rows import Vector

Quaternion = tuple[float, float, float, float]
UNTURNED: Quaternion = (1.0, 0.0, 0.0, 0.0)
_SMALL = 1e-8  # angle [rad] below which sin(a) is a to the last bit


def exp(rotation_rad: Sequence[float]) -> Quaternion:
    """Return the quaternion of a rotation vector."""
    x, y, z = rotation_rad
    angle = sqrt(x * x + y * y + z * z)
    scale = 0.5 if angle < _SMALL else sin(0.5 * angle) / angle
    return cos(0.5 * angle), scale * x, scale * y, scale * z


def log(q: Sequence[float]) -> Vector:
    """Return the rotation vector of a quaternion, whose length need not be 1."""
    w, x, y, z = q
    size = sqrt(x * x + y * y + z * z)
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    scale = 2.0 / w if size < _SMALL * w else 2.0 * atan2(size, w) / size
    return scale * x, scale * y, scale * z


def of_matrix(rows: Sequence[Sequence[float]]) -> Quaternion | None:
    """Return the quaternion of a rotation matrix; None for one that is none within its rounding.

    Shepperd's method: the largest of the four components is divided by, so that rounding is not magnified.
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    squares = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    largest = max(range(4), key=squares.__getitem__)
    if not 0.5 < squares[largest] < 5.0:  # 4 w^2, or of x, y, z; False for nan
        return None
    s = sqrt(squares[largest])
    whole = (
        (s * s, h - f, c - g, d - b), (h - f, s * s, b + d, c + g), (c - g, b + d, s * s, f + h), (d - b, c + g, f + h, s * s),
    )[largest]  # fmt: skip
    w, x, y, z = (0.5 * part / s for part in whole)
    size = w * w + x * x + y * y + z * z
    return (w, x, y, z) if abs(size - 1.0) <= 1e-3 else None


def product(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Return the rotation by b, then by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def inverse(q: Sequence[float]) -> Quaternion:
    """Return the rotation back."""
    w, x, y, z = q
    return w, -x, -y, -z


def between(before: Sequence[float], after: Sequence[float]) -> Vector:
    """Return the rotation vector from one orientation to another: log(after before^-1)."""
    return log(product(after, inverse(before)))


def turned(q: Sequence[float], vector: Sequence[float]) -> Vector:
    """Return a vector turned by a rotation."""
    _, x, y, z = product(product(q, (0.0, *vector)), inverse(q))
    return x, y, z
