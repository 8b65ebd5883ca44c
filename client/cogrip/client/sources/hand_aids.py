"""Forces of the device's own at a hand: the limit of its workspace, and the weight of the handle (theory 1.2).

Symbols: x hand [m], d depth beyond the limit [m], n outward direction, K, B spring and damper of the limit, F_c the device's
continuous force [N], m mass of the handle [kg], g gravity [m/s^2], z the third axis, up.

    F_limit = n min(F_c, max(0, K d + B n v))        F_weight = (0, 0, -m g)        both load the hand (P eq. 9)

The line does not see them. The spring holds `stored_j`. What the weight's force gives, the weight takes: `potential_j`, m g
times the height, goes to the device's ledger, so a closed path does no work, whatever limits and ramps do to the force.
"""

from collections.abc import Sequence
from math import hypot, sqrt

from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.rows.springs import spring_j
from cogrip.client.sources.force_source import AtHand, ForceSource
from cogrip.devices.device import GRAVITY_MPS2, Capability
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.hand import HandChange, WorkspaceLimit

SOFT_M = 0.01
"""Depth at which the spring reaches the continuous force; at most SOFT_PART of the shortest side of the workspace."""
SOFT_PART = 0.1
STIFFEST = 0.5  # largest stiffness of the limit's spring, as a fraction of the device's advised stiffness
DAMPED = 0.7  # damping ratio of the limit; its damper is at most DAMPER_PART of the impedance that the device carries
DAMPER_PART = 0.25


class HandAids(ForceSource):
    """Limit and weight of one hand."""

    def __init__(self, limit: WorkspaceLimit, carries: bool, record: Capability, tick_s: float) -> None:
        super().__init__(present=False)
        self.limit, self._asked = limit, carries
        self._tick_s = tick_s
        self._height_m: float | None  # at which the weight of this device was carried last
        self.fit(record, record, 0.0)

    def fit(self, record: Capability, own: Capability, free_j: float) -> None:
        super().fit(record, own, free_j)
        record, self._record, self._axes = own, own, own.axes  # limit and weight are in the units of each axis
        self._height_m = None
        self._most_n = record.continuous_force_n
        least_m = min(high - low for low, high in record.workspace_m)
        self._soft_m = min(SOFT_M, SOFT_PART * least_m)
        self._stiffness_npm = min(self._most_n / self._soft_m, STIFFEST * record.stiffness_npm)
        carried = DAMPER_PART * largest_impedance(record, self._tick_s).impedance_nspm
        self._damping_nspm = min(carried, 2.0 * DAMPED * sqrt(self._stiffness_npm * record.apparent_mass_kg))
        self._go_by()

    def change(self, change: HandChange) -> None:
        """Set the workspace limit and the weight of a change."""
        if change.workspace_limit_m is not None:
            self.limit = change.workspace_limit_m
        if change.gravity_compensation is not None:
            self._asked = change.gravity_compensation
        self._go_by()

    def _go_by(self) -> None:
        limit, record, numbers = self.limit, self._record, self.limit.numbers_m
        self._ball: Row = numbers if limit.kind == "sphere" else ()  # middle and radius
        self._box: Sequence[tuple[float, float]] = ()
        if limit.kind == "box":
            self._box = list(zip(numbers[::2], numbers[1::2], strict=True))
        elif limit.kind == "auto":
            inset = min(self._most_n / self._stiffness_npm, 0.5 * self._soft_m / SOFT_PART)
            self._box = [(low + inset, high - inset) for low, high in record.workspace_m]
        self._weight_n = record.handle_mass_kg * GRAVITY_MPS2 if self._asked and self._axes >= PLACES else 0.0
        self._weight_n = min(self._weight_n, self._most_n)
        self.present = limit.kind != "none" or self._weight_n > 0.0

    @property
    def carries(self) -> bool:
        """Return whether the weight of the handle is carried."""
        return self._weight_n > 0.0

    def _depths(self, position_m: Sequence[float]) -> list[tuple[float, Row]]:
        """Return depth and outward direction wherever the hand is beyond the limit."""
        found: list[tuple[float, Row]] = []
        for axis, (low, high) in enumerate(self._box):
            depth = max(position_m[axis] - high, low - position_m[axis])
            if depth > 0.0:
                outward = 1.0 if position_m[axis] > high else -1.0
                found.append((depth, tuple([outward * (each == axis) for each in range(self._axes)])))
        if self._ball:
            places = min(self._axes, PLACES)
            away = [at - middle for at, middle in zip(position_m[:places], self._ball, strict=False)]
            far = hypot(*away)
            if far > self._ball[-1]:
                rest = (0.0,) * (self._axes - places)
                found.append((far - self._ball[-1], tuple([each / far for each in away]) + rest))
        return found

    def force(self, at: AtHand) -> Row:
        position_m = at.position_m
        total = [0.0] * self._axes
        for depth, outward in self._depths(position_m):
            speed = add_floats([part * rate for part, rate in zip(outward, at.velocity_mps, strict=True)])
            size = min(self._most_n, max(0.0, self._stiffness_npm * depth + self._damping_nspm * speed))
            total = [sum_n + size * part for sum_n, part in zip(total, outward, strict=True)]
        if self._weight_n:
            total[PLACES - 1] -= self._weight_n
            if self._height_m is not None:
                self.potential_j += self._weight_n * (position_m[PLACES - 1] - self._height_m)
            self._height_m = position_m[PLACES - 1]
        self.asked_n = asked_n = tuple(total)
        return asked_n

    def stored_j(self, position_m: Sequence[float]) -> float:
        return add_floats([spring_j(self._stiffness_npm, depth, self._most_n) for depth, _ in self._depths(position_m)])
