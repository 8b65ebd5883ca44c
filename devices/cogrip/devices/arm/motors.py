"""Cable drives: encoder counts to joint angles, joint torques to motor currents.

symbols per joint: n calibrated count, c counts a turn (quadrature x4), dir +1 or -1 (-1 where motor and body turn alike),
s capstan diameter, d body diameter [m], k motor constant [Nm/A], tau joint torque [Nm]

    theta = dir 2 pi n / c  s / d             I = tau dir s / d / k
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil, isfinite, pi

from cogrip.devices.arm.kinematics import NO_TORQUE
from cogrip.machine.rows import Vector

Currents = tuple[int, int, int]
"""Motor currents [mA], whole, as they go over a wire."""

NO_CURRENT: Currents = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class CableDrive:
    """Both bounds are exclusive, as in haptikfabrikenapi, which gives a motor at most max_milliamps - 1.

    limit_ma      what the current of each motor stays below [mA]
    full_scale_ma what amplifier and firmware are built for; bounds limit_ma
    largest_ma    the largest whole current below each limit
    """

    counts_per_turn: Vector
    capstan_m: Vector
    body_m: Vector
    direction: Vector
    motor_nm_per_a: Vector
    limit_ma: Vector
    full_scale_ma: float
    rad_per_count: Vector = field(init=False, repr=False, compare=False)
    ma_per_nm: Vector = field(init=False, repr=False, compare=False)
    largest_ma: Vector = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        ratio = [sense * s / d for sense, s, d in zip(self.direction, self.capstan_m, self.body_m, strict=True)]
        per_count = tuple(2.0 * pi * r / turn for r, turn in zip(ratio, self.counts_per_turn, strict=True))
        per_nm = tuple(1000.0 * r / k for r, k in zip(ratio, self.motor_nm_per_a, strict=True))
        object.__setattr__(self, "rad_per_count", per_count)
        object.__setattr__(self, "ma_per_nm", per_nm)
        object.__setattr__(self, "largest_ma", tuple(max(0, ceil(limit) - 1) for limit in self.limit_ma))

    def angles(self, counts: Sequence[float]) -> Vector:
        """Joint angles [rad] of calibrated counts."""
        na, nb, nc = counts
        a, b, c = self.rad_per_count
        return a * na, b * nb, c * nc

    def counts(self, angles: Vector) -> Vector:
        """Calibrated counts at joint angles, not rounded."""
        ta, tb, tc = angles
        a, b, c = self.rad_per_count
        return ta / a, tb / b, tc / c

    def currents(self, torque: Vector) -> Vector:
        """Motor currents [mA] for joint torques, neither limited nor rounded."""
        ta, tb, tc = torque
        a, b, c = self.ma_per_nm
        return a * ta, b * tb, c * tc

    def torque(self, currents_ma: Sequence[float]) -> Vector:
        """Joint torques [Nm] of motor currents: the way back."""
        ia, ib, ic = currents_ma
        a, b, c = self.ma_per_nm
        return ia / a, ib / b, ic / c

    def limited(self, currents_ma: Vector, held_ma: Vector = NO_TORQUE) -> tuple[Currents, bool]:
        """Whole milliamperes, truncated towards zero; all scaled by one factor where any reaches its limit, so that the
        force keeps its direction. True if they were. Where one is not finite, all are zero.

        held_ma: what flows beside them whatever they are, itself below the limits; it is in the sum, and is not scaled.
        """
        a, b, c = (current + held for current, held in zip(currents_ma, held_ma, strict=True))
        la, lb, lc = self.limit_ma
        if -la < a < la and -lb < b < lb and -lc < c < lc:
            return (int(a), int(b), int(c)), False
        if not isfinite(a + b + c):
            return NO_CURRENT, True
        fraction = 1.0
        for i, held, most in zip(currents_ma, held_ma, self.largest_ma, strict=True):
            if abs(i + held) > most:
                fraction = min(fraction, max(0.0, (most - held if i > 0.0 else most + held) / abs(i)))
        a, b, c = (fraction * current + held for current, held in zip(currents_ma, held_ma, strict=True))
        return (int(a), int(b), int(c)), True
