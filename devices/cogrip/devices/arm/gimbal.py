"""Gimbal of an arm: three encoders between the arm's end and the handle, to the handle's orientation.

Turns follow each other from the turret outwards, each about an axis that the turns before it have carried along:

    Polhem           Rz(tA) Ry(-lam) Rx(tD) Ry(tE) Rx(tF)       lam: of the forearm (`Polhem.forearm`)
    vintage Phantom  Rz(tA) Rz(tD) Ry(tE) Rx(tF)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin

from cogrip.devices.arm.kinematics import Kinematics
from cogrip.devices.arm.polhem import Polhem
from cogrip.machine.rows import Vector
from cogrip.protocol.laws.rotations import Quaternion, product


@dataclass(frozen=True, slots=True)
class Gimbal:
    """axes: 0, 1 or 2 of each joint in turn; rad_per_count: of each; counts: which of d, e, f is each joint's."""

    axes: tuple[int, int, int]
    rad_per_count: Vector
    counts: tuple[int, int, int] = (0, 1, 2)

    def orientation(self, kinematics: Kinematics, angles: Vector, counts: Sequence[float]) -> Quaternion | None:
        """Return the handle's orientation at joint angles [rad] and calibrated counts d, e, f; None where nothing closes."""
        found = turn(2, angles[0])
        if isinstance(kinematics, Polhem):
            forearm = kinematics.forearm(angles)
            if forearm is None:
                return None
            found = product(found, turn(1, -forearm))
        for axis, rad, number in zip(self.axes, self.rad_per_count, self.counts, strict=True):
            found = product(found, turn(axis, rad * counts[number]))
        return found


def turn(axis: int, angle_rad: float) -> Quaternion:
    """Return the turn about the axis x, y or z (0, 1, 2)."""
    s = sin(0.5 * angle_rad)
    return cos(0.5 * angle_rad), s * (axis == 0), s * (axis == 1), s * (axis == 2)


_POLHEM_RAD, _VINTAGE_RAD = 2.0 * pi / 1024, 2.0 * pi / 2000
POLHEM = Gimbal((0, 1, 0), (-_POLHEM_RAD, -_POLHEM_RAD, _POLHEM_RAD))
POLHEM_HID = Gimbal(
    (0, 1, 0), POLHEM.rad_per_count, counts=(2, 1, 0)
)  # gimbal whose reports have the counts in reverse order
VINTAGE = Gimbal((2, 1, 0), (-_VINTAGE_RAD, _VINTAGE_RAD, _VINTAGE_RAD))
