"""Kinematics that every mechanism provides: joint angles to tip position, and back. Metres, radians, the common frame:

x toward the user, y to the user's right, z up. Joint angles t = (tA, tB, tC), from the turret outwards; a mechanism says in
its own module what they are measured from.
"""

from typing import Protocol, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]
"""Three rows. A Jacobian has dp_i / dt_j at [i][j]."""

NO_TORQUE: Vector = (0.0, 0.0, 0.0)


class Kinematics(Protocol):
    """One mechanism. Nothing raises for angles or points out of reach: the answer is None."""

    def forward(self, angles: Vector) -> Vector | None:
        """Tip position [m] at joint angles [rad]; None where the linkage does not close."""

    def inverse(self, position: Vector) -> Vector | None:
        """Joint angles [rad] with the tip at `position` [m]; None out of reach."""

    def jacobian(self, angles: Vector) -> Matrix | None:
        """d position / d angles [m/rad]; None where the linkage does not close, or only just."""

    def gravity(self, angles: Vector) -> Vector:
        """Joint torques [Nm] against the arm's own weight; zeros where that is balanced, not known, or left out."""


def joint_torque(jacobian: Matrix, force: Vector) -> Vector:
    """tau = J^T F [Nm] for a force [N] of the tip on the hand."""
    (xa, xb, xc), (ya, yb, yc), (za, zb, zc) = jacobian
    x, y, z = force
    return (xa * x + ya * y + za * z, xb * x + yb * y + zb * z, xc * x + yc * y + zc * z)
