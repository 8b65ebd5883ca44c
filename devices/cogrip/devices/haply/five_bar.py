"""The five-bar linkage of Haply's planar arms: two motors side by side, two links each, joined at the tip.

symbols: t1, t2 angles of the two motors [rad]; l proximal, L distal links, d distance of the motors [m]; A, B elbows; P tip;
u = P - A, v = P - B; A', B' = dA/dt1, dB/dt2

    A = l (cos t1, sin t1)    B = (d, 0) + l (cos t2, sin t2)    |P - A| = |P - B| = L, on the +90 degree side of A -> B

    u.dP = u.A' dt1,  v.dP = v.B' dt2    so    dP = ((u.A') (vy, -vx) dt1 + (v.B') (-uy, ux) dt2) / (ux vy - uy vx)

In Haply's plane Y points away from the motors. Its makers draw (-X, Y) on a screen whose y goes down: with the device before
the user, motors on the far side, Y comes toward the user and X goes to the left. In the common frame that is

    x = Y - Y0,  y = X0 - X,  z = 0            and half a turn about z where the motors are on the user's side

Source: Haply's Pantograph examples. The third joint angle is there for the shape of `Kinematics` only, and always 0.
"""

from dataclasses import dataclass
from math import acos, atan2, cos, hypot, sin, sqrt

from cogrip.devices.arm.kinematics import NO_TORQUE, Matrix
from cogrip.machine.rows import Vector

FLAT = 0.02  # least sine of the angle at the tip; below it the linkage only just closes


@dataclass(frozen=True, slots=True)
class FiveBar:
    """origin_m: where the common frame's origin is in Haply's plane (X0, Y0). facing: +1 motors far from the user, -1 near."""

    proximal_m: float
    distal_m: float
    base_m: float
    origin_m: tuple[float, float]
    facing: float = 1.0

    def forward(self, angles: Vector) -> Vector | None:
        tip = self._tip(angles)
        if tip is None:
            return None
        px, py, _, _, _, _ = tip
        x0, y0 = self.origin_m
        return self.facing * (py - y0), self.facing * (x0 - px), 0.0

    def inverse(self, position: Vector) -> Vector | None:
        """Each leg by the cosine rule, elbows outward: leg 1 left of its line to the tip, leg 2 right."""
        x0, y0 = self.origin_m
        px, py = x0 - self.facing * position[1], y0 + self.facing * position[0]
        t1, t2 = self._leg(px, py), self._leg(px - self.base_m, py)
        if t1 is None or t2 is None:
            return None
        return t1[0] + t1[1], t2[0] - t2[1], 0.0

    def jacobian(self, angles: Vector) -> Matrix | None:
        tip = self._tip(angles)
        if tip is None:
            return None
        _, _, ux, uy, vx, vy = tip
        area = ux * vy - uy * vx
        if abs(area) < FLAT * self.distal_m * self.distal_m:
            return None
        s, link = self.facing / area, self.proximal_m
        first = s * link * (uy * cos(angles[0]) - ux * sin(angles[0]))
        second = s * link * (vy * cos(angles[1]) - vx * sin(angles[1]))
        return (-vx * first, ux * second, 0.0), (-vy * first, uy * second, 0.0), (0.0, 0.0, 0.0)

    def gravity(self, angles: Vector) -> Vector:
        """It lies flat."""
        return NO_TORQUE

    def _tip(self, angles: Vector) -> tuple[float, float, float, float, float, float] | None:
        """P, u, v in Haply's plane."""
        t1, t2, _ = angles
        link = self.proximal_m
        ax, ay = link * cos(t1), link * sin(t1)
        bx, by = self.base_m + link * cos(t2), link * sin(t2)
        ex, ey = bx - ax, by - ay
        apart = hypot(ex, ey)
        square = self.distal_m * self.distal_m - 0.25 * apart * apart
        if not square > 0.0 or not apart > 0.0:  # angles that are not finite end here too
            return None
        rise = sqrt(square) / apart
        ux, uy = 0.5 * ex - rise * ey, 0.5 * ey + rise * ex
        return ax + ux, ay + uy, ux, uy, ux - ex, uy - ey

    def _leg(self, px: float, py: float) -> tuple[float, float] | None:
        """Direction of the tip from a motor, and the angle between it and the proximal link."""
        link, distal = self.proximal_m, self.distal_m
        reach = hypot(px, py)
        if not abs(link - distal) < reach < link + distal:
            return None
        return atan2(py, px), acos((link * link + reach * reach - distal * distal) / (2.0 * link * reach))

    def in_reach(self, position: Vector, margin_m: float) -> bool:
        """Return True if both legs reach `position`, in front of the motors, with `margin_m` to spare."""
        x0, y0 = self.origin_m
        px, py = x0 - self.facing * position[1], y0 + self.facing * position[0]
        low, high = abs(self.proximal_m - self.distal_m) + margin_m, self.proximal_m + self.distal_m - margin_m
        return py > 0.0 and low < hypot(px, py) < high and low < hypot(px - self.base_m, py) < high
