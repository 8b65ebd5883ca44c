"""Fixtures that are springs: magnet, guiding path, forbidden zone (theory 7.8).

Each force is the gradient of a potential U >= 0 whose curvature is K at most, so that a tick of a sampled one makes no more
than K d^2 / 2. Symbols: x hand, d distance or depth [m], n direction in which U grows, K, B spring and damper, R radius [m].
"""

from itertools import pairwise
from math import sqrt

from cogrip.client.effects.laws import NOTHING, Box, PassiveForce, PassiveLaw, unit
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Floats
from cogrip.protocol.settings.effects import Effect

_STEEPEST = 16.0 / (25.0 * sqrt(5.0))  # largest value of r (1 - r^2)^2, at r^2 = 1/5


class Magnet(PassiveLaw):
    """Snap to a point: F = K r (1 - r^2/R^2)^2 within R, U = K R^2 / 6 (1 - (1 - r^2/R^2)^3) there, K R^2 / 6 outside.

    Its largest force is 0.286 K R, at r = R / sqrt(5). The damper fades out towards R as the square does.
    """

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._place, self._square = effect.place_m[:places], effect.radius_m**2
        self.stiffness_npm, self.damping_nspm = effect.stiffness_npm, effect.damping_nspm
        if effect.force_n:
            self.stiffness_npm = min(self.stiffness_npm, effect.force_n / (_STEEPEST * effect.radius_m))
        self.outside = PassiveForce((), self.stiffness_npm * self._square / 6.0)

    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        away = [x - middle for x, middle in zip(position_m, self._place, strict=False)]
        left = 1.0 - add_floats([each * each for each in away]) / self._square
        if left <= 0.0:
            return self.outside
        pull, drag = self.stiffness_npm * left * left, self.damping_nspm * left * left
        damper = [drag * speed for speed in velocity_mps[: len(away)]] if drag else ()
        return PassiveForce([pull * each for each in away], self.outside.stored_j * (1.0 - left**3), damper)


class GuidingPath(PassiveLaw):
    """Pull to the nearest point of a polyline: F = K d n up to F_m, U = K d^2 / 2, beyond F_m (d - F_m / (2 K)).

    The damper is of the motion across: B v less its part along the segment, so along the path the hand moves freely.
    """

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        points = [point[:places] for point in effect.points_m]
        self._segments = []
        for one, other in pairwise(points):
            along = [b - a for a, b in zip(one, other, strict=True)]
            self._segments.append((one, along, add_floats([each * each for each in along])))
        self.stiffness_npm, self.damping_nspm = effect.stiffness_npm, effect.damping_nspm
        self._far = effect.force_n / effect.stiffness_npm if effect.force_n else float("inf")

    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        best, offset, segment = float("inf"), [0.0], self._segments[0]
        for each in self._segments:
            one, along, square = each
            start = [x - a for x, a in zip(position_m, one, strict=False)]
            share = add_floats([s * t for s, t in zip(start, along, strict=True)]) / square
            share = min(1.0, max(0.0, share))
            away = [s - share * t for s, t in zip(start, along, strict=True)]
            if (distance := add_floats([each * each for each in away])) < best:
                best, offset, segment = distance, away, each
        distance, stiffness, far = sqrt(best), self.stiffness_npm, self._far
        pull, stored = stiffness, 0.5 * stiffness * best
        if distance > far:
            pull, stored = stiffness * far / distance, stiffness * far * (distance - 0.5 * far)
        return PassiveForce([pull * each for each in offset], stored, self._drag(segment, velocity_mps))

    def _drag(self, segment: tuple[Floats, Floats, float], velocity_mps: Floats) -> Floats:
        if not self.damping_nspm:
            return ()
        _, along, square = segment
        slide = add_floats([t * v for t, v in zip(along, velocity_mps, strict=False)]) / square
        return [self.damping_nspm * (v - slide * t) for t, v in zip(along, velocity_mps, strict=False)]


class ForbiddenZone(PassiveLaw):
    """Wall around a box, or behind a plane: F = -n max(0, K d - B n v), U = K d^2 / 2, n the outward normal. It only pushes."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self.stiffness_npm, self.damping_nspm = effect.stiffness_npm, effect.damping_nspm
        self._place = effect.place_m[:places]
        self._normal = unit(effect.direction, places) if any(effect.direction) else []
        self._sides = Box(effect, places).sides

    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        depth, out = self._depth(position_m)
        if depth <= 0.0:
            return NOTHING
        pushed = self.stiffness_npm * depth
        total = max(
            0.0, pushed - self.damping_nspm * add_floats([n * v for n, v in zip(out, velocity_mps, strict=False)])
        )
        damper = [(pushed - total) * n for n in out] if total != pushed else ()
        return PassiveForce([-pushed * n for n in out], 0.5 * pushed * depth, damper)

    def _depth(self, position_m: Floats) -> tuple[float, list[float]]:
        """Return the depth, and the outward normal: of a box that of its nearest side."""
        if self._normal:
            away = [x - middle for x, middle in zip(position_m, self._place, strict=False)]
            return -add_floats([n * each for n, each in zip(self._normal, away, strict=True)]), self._normal
        least, at, sign = float("inf"), 0, 1.0
        for axis, middle, half in self._sides:
            away_m = position_m[axis] - middle
            if (depth := half - abs(away_m)) < least:
                least, at, sign = depth, axis, 1.0 if away_m >= 0.0 else -1.0
        return least, [sign if axis == at else 0.0 for axis in range(len(self._place))]
