"""Fixtures that are springs: magnet, spring to a point, guiding path, channel, forbidden zone (theory 7.8).

Each force is the gradient of a potential U >= 0 whose curvature is K at most, so that a tick of a sampled one makes no more
than K d^2 / 2. Symbols: x hand, d distance or depth [m], n direction in which U grows, K, B spring and damper, F_m largest
force [N], R radius [m].
"""

from abc import abstractmethod
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


class Bound:
    """Force and potential of a spring over its length d: K d up to F_m, K d^2 / 2; beyond it F_m, F_m (d - F_m / (2 K))."""

    def __init__(self, effect: Effect) -> None:
        self._stiffness = effect.stiffness_npm
        self._far = effect.force_n / effect.stiffness_npm if effect.force_n else float("inf")

    def at(self, distance_m: float) -> tuple[float, float]:
        """Return force [N] and potential [J]."""
        stiffness, far = self._stiffness, self._far
        if distance_m > far:
            return stiffness * far, stiffness * far * (distance_m - 0.5 * far)
        return stiffness * distance_m, 0.5 * stiffness * distance_m * distance_m


class Tether(PassiveLaw):
    """Pull to the nearest point of a set: F = K d n up to F_m (`Bound`), d the distance from it.

    The damper is of the motion across: B v less its part along the set, so along it the hand moves freely.
    """

    def __init__(self, effect: Effect) -> None:
        self.stiffness_npm, self.damping_nspm = effect.stiffness_npm, effect.damping_nspm
        self._bound = Bound(effect)

    @abstractmethod
    def nearest(self, position_m: Floats) -> tuple[list[float], Floats]:
        """Return the way here from the nearest point of the set, and a vector along the set there; () where it has none."""

    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        offset, along = self.nearest(position_m)
        distance = sqrt(add_floats([each * each for each in offset]))
        force, stored = self._bound.at(distance)
        pull = force / distance if distance else self.stiffness_npm
        return PassiveForce([pull * each for each in offset], stored, self._drag(along, velocity_mps[: len(offset)]))

    def _drag(self, along: Floats, velocity_mps: Floats) -> Floats:
        if not self.damping_nspm:
            return ()
        if not along:
            return [self.damping_nspm * v for v in velocity_mps]
        square = add_floats([t * t for t in along])
        slide = add_floats([t * v for t, v in zip(along, velocity_mps, strict=True)]) / square
        return [self.damping_nspm * (v - slide * t) for t, v in zip(along, velocity_mps, strict=True)]


class Spring(Tether):
    """Pull to a point, from anywhere."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        super().__init__(effect)
        self._place = effect.place_m[:places]

    def nearest(self, position_m: Floats) -> tuple[list[float], Floats]:
        return [x - middle for x, middle in zip(position_m, self._place, strict=False)], ()


class GuidingPath(Tether):
    """Pull to a polyline; a channel, to the whole line through its two points."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        super().__init__(effect)
        self._ends = effect.kind == "path"
        points = [point[:places] for point in effect.points_m]
        self._segments = []
        for one, other in pairwise(points):
            along = [b - a for a, b in zip(one, other, strict=True)]
            self._segments.append((one, along, add_floats([each * each for each in along])))

    def nearest(self, position_m: Floats) -> tuple[list[float], Floats]:
        best, offset, direction = float("inf"), [0.0], self._segments[0][1]
        for one, along, square in self._segments:
            start = [x - a for x, a in zip(position_m, one, strict=False)]
            share = add_floats([s * t for s, t in zip(start, along, strict=True)]) / square
            if self._ends:
                share = min(1.0, max(0.0, share))
            away = [s - share * t for s, t in zip(start, along, strict=True)]
            if (distance := add_floats([each * each for each in away])) < best:
                best, offset, direction = distance, away, along
        return offset, direction


class ForbiddenZone(PassiveLaw):
    """Wall around a box, or behind a plane: F = -n max(0, K d - B n v), n the outward normal, K d up to F_m (`Bound`).

    It only pushes.
    """

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self.stiffness_npm, self.damping_nspm = effect.stiffness_npm, effect.damping_nspm
        self._bound, self._place = Bound(effect), effect.place_m[:places]
        self._normal = unit(effect.direction, places) if any(effect.direction) else []
        self._sides = Box(effect, places).sides

    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        depth, out = self._depth(position_m)
        if depth <= 0.0:
            return NOTHING
        pushed, stored = self._bound.at(depth)
        total = max(
            0.0, pushed - self.damping_nspm * add_floats([n * v for n, v in zip(out, velocity_mps, strict=False)])
        )
        damper = [(pushed - total) * n for n in out] if total != pushed else ()
        return PassiveForce([-pushed * n for n in out], stored, damper)

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
