"""The Phantom's mechanism, also WoodenHaptics': a turret, two links, both driven from the turret.

symbols: tA turret about z, tB upper arm from vertical, tC forearm from straight down (absolute, because both motors sit on the
turret) [rad]; Ln height of the shoulder, Lb, Lc links, o origin [m]; r reach in the horizontal plane [m]

    r = Lb sin tB + Lc sin tC        x = r cos tA - ox    y = r sin tA - oy    z = Ln + Lb cos tB - Lc cos tC - oz

Source: kinematics of haptikfabrikenapi and hfabapi. The inverse is our own: the elbow points up and back, 0 < tB + tC < pi.
"""

from dataclasses import dataclass
from math import acos, atan2, cos, hypot, sin

from cogrip.devices.arm.kinematics import NO_TORQUE, Matrix
from cogrip.machine.rows import Vector


@dataclass(frozen=True, slots=True)
class Weights:
    """Masses of the links [kg] and the distances of their centres from the joint before [m]; g_mps2 = 0 leaves gravity out."""

    b_kg: float
    c_kg: float
    b_m: float
    c_m: float
    g_mps2: float = 0.0


@dataclass(frozen=True, slots=True)
class ParallelDrive:
    """shoulder_m is Ln, links_m (Lb, Lc), origin_m (ox, oy, oz)."""

    shoulder_m: float
    links_m: tuple[float, float]
    origin_m: Vector
    weights: Weights

    def forward(self, angles: Vector) -> Vector:
        """See `Kinematics`. There is a position at all angles."""
        ta, tb, tc = angles
        lb, lc = self.links_m
        ox, oy, oz = self.origin_m
        r = lb * sin(tb) + lc * sin(tc)
        return r * cos(ta) - ox, r * sin(ta) - oy, self.shoulder_m + lb * cos(tb) - lc * cos(tc) - oz

    def inverse(self, position: Vector) -> Vector | None:
        """Apply the cosine rule in the plane of the links. D: distance from shoulder to tip, phi: its angle from vertical."""
        lb, lc = self.links_m
        ox, oy, oz = self.origin_m
        x, y, z = position[0] + ox, position[1] + oy, position[2] + oz
        r, h = hypot(x, y), z - self.shoulder_m
        distance = hypot(r, h)
        if not abs(lb - lc) < distance < lb + lc:
            return None
        phi = atan2(r, h)
        tb = phi - acos((lb * lb + distance * distance - lc * lc) / (2.0 * lb * distance))
        tc = acos((lb * lb + lc * lc - distance * distance) / (2.0 * lb * lc)) - tb
        return atan2(y, x), tb, tc

    def jacobian(self, angles: Vector) -> Matrix:
        """See `Kinematics`. It is singular where the arm is straight or the tip is above the turret."""
        ta, tb, tc = angles
        lb, lc = self.links_m
        ca, sa = cos(ta), sin(ta)
        bc, bs, cc, cs = lb * cos(tb), lb * sin(tb), lc * cos(tc), lc * sin(tc)
        r = bs + cs
        return (-r * sa, ca * bc, ca * cc), (r * ca, sa * bc, sa * cc), (0.0, -bs, cs)

    def gravity(self, angles: Vector) -> Vector:
        """g (0, -(mB lB + mC Lb) sin tB, mC lC sin tC): the slope of g (mB lB cos tB + mC (Lb cos tB - lC cos tC)).

        hfabapi has g (0, mB lB sin tB + mC (lB + lC) sin tC, mC lC sin tC), which is the slope of no energy and lifts where a
        weight needs holding; it is off there, and here.
        """
        w = self.weights
        if w.g_mps2 == 0.0:
            return NO_TORQUE
        b = (w.b_kg * w.b_m + w.c_kg * self.links_m[0]) * sin(angles[1])
        return 0.0, -w.g_mps2 * b, w.g_mps2 * w.c_kg * w.c_m * sin(angles[2])
