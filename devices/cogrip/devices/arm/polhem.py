"""The Polhem's mechanism: a turret with a closed linkage of five bars in its vertical plane.

tA, tB, tC are the angles of turret, upper arm and crank, L0 to L5 the `lengths_m` of the links, (ox, oy, oz) the `origin_m`.
Points of the plane, (distance from the turret's axis, height) [m], and unit vectors u(t) = (cos t, sin t):

    O1 = (L0/2, 0)     B = O1 + L1 u(tB)        elbow, on the upper arm
    O2 = (-L0/2, 0)    A = O2 + L2 u(tC)        end of the crank
    C = B - L4 u(lam)      |C - A| = L3         rod from the crank to the forearm's tail
    T = B + L5 u(lam) = (T_1, T_2)              tip; x = T_1 cos tA - ox,  y = T_1 sin tA - oy,  z = T_2 - oz

The rod's equation gives lam, the forearm's angle from horizontal; C lies clockwise of the line from B to A. With w = C - A,
n(t) = u'(t), the rates follow from d |w|^2 = 0:

    L4 (w n(lam)) lam' = L1 (w n(tB)) tB' - L2 (w n(tC)) tC'

Source: hfabapi, which writes lam as tB minus three angles, each an arc cosine. That is the same wherever tB is in (0, pi) and A
is clockwise of the line from B to O2; beyond, its linkage would not close, and this one does.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin, sqrt

from cogrip.devices.arm.kinematics import NO_TORQUE, Matrix
from cogrip.machine.rows import Vector

_SMALLEST_LEVER = 1e-3
"""Least lever of the rod on the forearm, as the sine of the angle between them; below it, torques have no bound."""


@dataclass(frozen=True, slots=True)
class LinkMass:
    """A link's mass [kg] and its centre [m]: along the link from its first joint, and across, to the left."""

    mass_kg: float
    along_m: float
    across_m: float


@dataclass(frozen=True, slots=True)
class PlanarMasses:
    """Masses that move in the plane, with covers; g_mps2 = 0 leaves gravity out. Numbers of hfabapi, which has 9.81."""

    upper: LinkMass = LinkMass(0.15764, 0.030123, 0.000484)
    crank: LinkMass = LinkMass(0.07733, -0.004086, 0.001911)
    rod: LinkMass = LinkMass(0.09767, 0.087765, 0.001978)
    forearm: LinkMass = LinkMass(0.11265, 0.061701, 0.000576)
    g_mps2: float = 0.0


@dataclass(frozen=True, slots=True)
class Polhem:
    """lengths_m (L0, L1, L2, L3, L4, L5), origin_m (ox, oy, oz)."""

    lengths_m: tuple[float, float, float, float, float, float]
    origin_m: Vector
    bodies: PlanarMasses = PlanarMasses()

    def _close(self, tb: float, tc: float) -> tuple[float, float, float, float, float, float] | None:
        """B - O1, A - O2 and u(lam), six numbers; None where the rod is too long or too short."""
        l0, l1, l2, l3, l4, _ = self.lengths_m
        bx, bz, ax, az = l1 * cos(tb), l1 * sin(tb), l2 * cos(tc), l2 * sin(tc)
        dx, dz = ax - l0 - bx, az - bz  # from B to A
        square = dx * dx + dz * dz
        if square == 0.0:
            return None
        # from B to C: along the line to A, and across it to the right, as shares of the line's length
        along = (l4 * l4 + square - l3 * l3) / (2.0 * square)
        remainder = l4 * l4 / square - along * along
        if not remainder >= 0.0:
            return None
        across = sqrt(remainder)
        return bx, bz, ax, az, -(along * dx + across * dz) / l4, -(along * dz - across * dx) / l4

    def forearm(self, angles: Vector) -> float | None:
        """lam [rad], in (-pi, pi]; None where the linkage does not close."""
        closed = self._close(angles[1], angles[2])
        return None if closed is None else atan2(closed[5], closed[4])

    def forward(self, angles: Vector) -> Vector | None:
        ta, tb, tc = angles
        closed = self._close(tb, tc)
        if closed is None:
            return None
        bx, bz, _, _, ux, uz = closed
        l5 = self.lengths_m[5]
        ox, oy, oz = self.origin_m
        r = 0.5 * self.lengths_m[0] + bx + l5 * ux
        return r * cos(ta) - ox, r * sin(ta) - oy, bz + l5 * uz - oz

    def inverse(self, position: Vector) -> Vector | None:
        """Two meetings of circles: the elbow from O1 and the tip, above; the crank's end from O2 and C, on the far side.

        tB is in (-pi, pi], tC in [0, 2 pi). Where forward answers with another crank angle for the same tip, the rod has gone
        through O2, and the Jacobian was singular on the way.
        """
        l0, l1, l2, l3, l4, l5 = self.lengths_m
        ox, oy, oz = self.origin_m
        x, y, z = position[0] + ox, position[1] + oy, position[2] + oz
        r = hypot(x, y)
        elbow = _meeting(0.5 * l0, 0.0, l1, r, z, l5)
        if elbow is None:
            return None
        bx, bz = elbow
        crank = _meeting(-0.5 * l0, 0.0, l2, bx - l4 * (r - bx) / l5, bz - l4 * (z - bz) / l5, l3)
        if crank is None:
            return None
        return atan2(y, x), atan2(bz, bx - 0.5 * l0), atan2(crank[1], crank[0] + 0.5 * l0) % (2.0 * pi)

    def jacobian(self, angles: Vector) -> Matrix | None:
        """See `Kinematics`. Exact; the source takes central differences."""
        ta, tb, tc = angles
        closed = self._close(tb, tc)
        if closed is None:
            return None
        bx, bz, ax, az, ux, uz = closed
        rates = self._forearm_rates(bx, bz, ax, az, ux, uz)
        if rates is None:
            return None
        l5 = self.lengths_m[5]
        b, c = l5 * rates[0], l5 * rates[1]
        ca, sa = cos(ta), sin(ta)
        r = 0.5 * self.lengths_m[0] + bx + l5 * ux
        rb, rc = -bz - b * uz, -c * uz
        return (-r * sa, rb * ca, rc * ca), (r * ca, rb * sa, rc * sa), (0.0, bx + b * ux, c * ux)

    def _forearm_rates(
        self, bx: float, bz: float, ax: float, az: float, ux: float, uz: float
    ) -> tuple[float, float] | None:
        """d lam / d tB and d lam / d tC; None where the rod points along the forearm."""
        l0, _, _, l3, l4, _ = self.lengths_m
        wx, wz = l0 + bx - l4 * ux - ax, bz - l4 * uz - az
        lever = wz * ux - wx * uz
        if abs(lever) < _SMALLEST_LEVER * l3:
            return None
        return (wz * bx - wx * bz) / (l4 * lever), (wx * az - wz * ax) / (l4 * lever)

    def gravity(self, angles: Vector) -> Vector:
        """g sum m dz/dt over the four bodies: the torques that hold them. Zeros where the linkage does not close."""
        bodies = self.bodies
        if bodies.g_mps2 == 0.0:
            return NO_TORQUE
        closed = self._close(angles[1], angles[2])
        rates = None if closed is None else self._forearm_rates(*closed)
        if closed is None or rates is None:
            return NO_TORQUE
        bx, bz, ax, az, ux, uz = closed
        l0, l1, l2, l3, l4, _ = self.lengths_m
        rx, rz = (l0 + bx - l4 * ux - ax) / l3, (bz - l4 * uz - az) / l3  # unit vector of the rod, from A to C
        # how fast the rod turns: the speed of C past A, across the rod, where C = B - L4 u(lam)
        cb = (bx - l4 * ux * rates[0]) * rx + (bz - l4 * uz * rates[0]) * rz
        cc = -(l4 * ux * rates[1] + ax) * rx - (l4 * uz * rates[1] + az) * rz
        upper, crank, rod, forearm = bodies.upper, bodies.crank, bodies.rod, bodies.forearm
        rod_rise, forearm_rise = _rise(rod, rx, rz), _rise(forearm, ux, uz)
        b = _rise(upper, bx / l1, bz / l1) + rod_rise * cb / l3 + forearm.mass_kg * bx + forearm_rise * rates[0]
        c = _rise(crank, ax / l2, az / l2) + rod.mass_kg * ax + rod_rise * cc / l3 + forearm_rise * rates[1]
        return 0.0, bodies.g_mps2 * b, bodies.g_mps2 * c


def _rise(body: LinkMass, ux: float, uz: float) -> float:
    """Mass times how fast its centre rises about the link's first joint, per rad/s of the link at direction u [kg m]."""
    return body.mass_kg * (body.along_m * ux - body.across_m * uz)


def _meeting(px: float, pz: float, near: float, qx: float, qz: float, far: float) -> tuple[float, float] | None:
    """The point at distance `near` from p and `far` from q, to the left of the way from p to q; None if there is none."""
    dx, dz = qx - px, qz - pz
    square = dx * dx + dz * dz
    if square == 0.0:
        return None
    along = (near * near - far * far + square) / (2.0 * square)
    remainder = near * near / square - along * along
    if not remainder >= 0.0:
        return None
    across = sqrt(remainder)
    return px + along * dx - across * dz, pz + along * dz + across * dx
