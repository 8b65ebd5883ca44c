"""Gimbals: three free joints with encoders between the arm and the handle, and the rotation of the handle.

symbols: n calibrated count, c counts a turn, dir +1 or -1; R_arm rotation of the body that carries the gimbal

    t = dir 2 pi n / c        R = R_arm R_d(tD) R_e(tE) R_f(tF)

Model 1 (Polhem) turns about x, y, x, and its R_arm is Rz(tA) Ry(-lambda); model 2 (vintage Phantom) about z, y, x with R_arm
= Rz(tA); model 3 (WoodenHaptics) has no gimbal. Source: hfabapi and its viewer; haptikfabrikenapi for the Polhem over HID: its
encoders come in the order f, e, d, and all count backwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin

from cogrip.devices.arm.kinematics import Matrix, Vector

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def about(axis: str, angle: float) -> Matrix:
    """Rotation by `angle` [rad] about "x", "y" or "z", right-handed."""
    c, s = cos(angle), sin(angle)
    if axis == "x":
        return (1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)
    if axis == "y":
        return (c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)
    return (c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)


def product(first: Matrix, second: Matrix) -> Matrix:
    """first second: the rotation `second`, seen from within `first`."""
    (a, b, c), (d, e, f), (g, h, i) = second
    p, q, r = ((x * a + y * d + z * g, x * b + y * e + z * h, x * c + y * f + z * i) for x, y, z in first)
    return p, q, r


@dataclass(frozen=True, slots=True)
class Gimbal:
    """axes: one letter per joint d, e, f; order: which of the counters on the wire is that of each joint.

    home_counts  of the counters on the wire: added to them (serial), or loaded into them (HID)
    """

    axes: str
    direction: Vector
    counts_per_turn: Vector
    home_counts: Vector
    order: tuple[int, int, int] = (0, 1, 2)

    def angles(self, counts: Sequence[float]) -> Vector:
        """Joint angles (tD, tE, tF) [rad] of calibrated counts."""
        d, e, f = (
            sense * 2.0 * pi * counts[there] / turn
            for sense, there, turn in zip(self.direction, self.order, self.counts_per_turn, strict=True)
        )
        return d, e, f

    def rotation(self, carrier: Matrix, counts: Sequence[float]) -> Matrix:
        """Handle to common frame, where the body that carries the gimbal is turned by `carrier`."""
        turned = carrier
        for axis, angle in zip(self.axes, self.angles(counts), strict=True):
            turned = product(turned, about(axis, angle))
        return turned


POLHEM = Gimbal("xyx", (-1.0, -1.0, 1.0), (1024.0, 1024.0, 1024.0), home_counts=(0.0, 30.0, 0.0))
POLHEM_HID = Gimbal("xyx", (-1.0, -1.0, -1.0), (1024.0, 1024.0, 4096.0), home_counts=(0.0, 30.0, 0.0), order=(2, 1, 0))
VINTAGE = Gimbal("zyx", (-1.0, 1.0, 1.0), (2000.0, 2000.0, 2000.0), home_counts=(0.0, 0.0, 0.0))
