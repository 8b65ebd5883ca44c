"""Contact that only pushes: the faces of a free object, or a fixed wall. Implicit Euler in closed form (theory 3.4).

Contact is along the first axis, with no friction on the others. Whether there is contact is decided by the sign of the
force alone: the usual extra test `depth > 0` creates energy. Passive for any K, B, b, m_o, n.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.settable import LENT_J
from cogrip.server.worlds.grip_step import MOST_SAVED_J, RAMP_S
from cogrip.server.worlds.world import Array, HandWorld, dot


class PushWorld(HandWorld):
    """Contact that only pushes, at a free object or a wall.

    Depth is d = s (x_s - x_o) on the first axis.

    A spring with stiffness adaptation grows stiffer at no cost while nothing is pressed in. Else it pays from what its contact
    took: T F (w - v) - change of K max(d, 0)^2 / 2, which is never below 0, as the step is implicit.
    """

    kept = ("_ledger",)
    can_adapt_stiffness = True

    @property
    def can_change_object(self) -> bool:  # type: ignore[override]  # of a wall nothing moves
        return not self.fixed

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self._ledger, self._loan = np.zeros(len(seats)), np.zeros(len(seats))  # [J]
        self._saving = bool(self.adapts_stiffness.any())

    @property
    def energy_j(self) -> float:
        return super().energy_j + float(self._ledger.sum())

    def set_target_stiffness(self, user: int, stiffness_npm: float) -> None:
        self.target_stiffness[user] = stiffness_npm

    def lend(self, user: int) -> None:
        self.adapts_stiffness[user] = self._saving = True
        self._loan[user] = LENT_J

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self._ledger[user] = 0.0

    def step(self, inputs: Array) -> Array:
        period, b, c = self.frame_s, self.impedance, self.wave_gain
        u, side = inputs, self.side
        K, b1 = self.stiffness[:, 0], b[:, 0]
        free_velocity = c * u
        depth = side * (self.hand[:, 0] - self.position[0])
        G = self.damping[:, 0] + K * period
        gain = 1.0 / (1.0 + G / b1)
        rest = (K * depth + G * side * free_velocity[:, 0]) * gain  # F at v = 0
        slope = G * gain  # dF / d(s v)
        v = 0.0 if self.fixed else self._object_velocity(rest, slope)
        push = np.maximum(0.0, rest - slope * side * v)
        force = np.zeros_like(self.force)
        force[:, 0] = side * push
        proxy_velocity = free_velocity - force / b
        back = u - c * force

        velocity = np.zeros_like(self.velocity) if self.fixed else self._free_velocity(v)
        hand = self.hand + period * proxy_velocity
        position = self.position + period * velocity
        grown = side * (hand[:, 0] - position[0])
        stored_before = 0.5 * (
            (K * np.maximum(depth, 0.0) ** 2).sum() + self.mass_kg * dot(self.velocity, self.velocity)
        )
        stored = 0.5 * ((K * np.maximum(grown, 0.0) ** 2).sum() + self.mass_kg * dot(velocity, velocity))
        port = (0.5 * period) * (u * u - back * back).sum(axis=1)
        lost = period * self.object_damping * dot(velocity, velocity)
        supplied = port.sum() + period * dot(self.external_force, velocity)
        self.balance_error_j = max(self.balance_error_j, (stored - stored_before) + lost - supplied)

        self._count_work(port)
        self.force, self.hand, self.position, self.velocity = force, hand, position, velocity
        if self._saving:
            squares, before = np.maximum(grown, 0.0) ** 2, np.maximum(depth, 0.0) ** 2
            came = period * push * side * (proxy_velocity[:, 0] - v)
            self._follow(came - 0.5 * K * (squares - before), squares)
        return back

    def _follow(self, taken_j: Array, squares: Array) -> None:
        """Move K towards its target; dK d^2 / 2 is paid, or saved where it is lowered. Shapes (n,)."""
        self._ledger += np.maximum(taken_j, 0.0)
        change = np.where(self.holding & self.adapts_stiffness, self.target_stiffness[:, 0] - self.stiffness[:, 0], 0.0)
        if change.any():
            most = np.full_like(squares, np.inf)
            pressed = squares > 0.0
            np.divide(2.0 * (self._ledger + self._loan), squares, out=most, where=pressed)
            np.minimum(most, self.target_stiffness[:, 0] * (self.frame_s / RAMP_S), out=most, where=pressed)
            change = np.minimum(change, most)
            self._ledger -= 0.5 * change * squares
            self.stiffness[:, 0] += change
        np.minimum(self._ledger, MOST_SAVED_J, out=self._ledger)

    def _free_velocity(self, first: float) -> Array:
        period = self.frame_s
        inertia = self.mass_kg / period
        velocity = (inertia * self.velocity + self.external_force) / (inertia + self.object_damping)
        velocity[0] = first
        return velocity

    def _object_velocity(self, rest: Array, slope: Array) -> float:
        """Return v with m_o (v - v_o)/T + b_o v = sum s_i max(0, rest_i - slope_i s_i v) + F_ext.

        s_i is the side of user i, 1 or -1, and rest_i - slope_i s_i v its contact force where it pushes [N].
        The right side falls with v and is piecewise linear: walk its break points in order until the sign changes.
        """
        inertia = self.mass_kg / self.frame_s
        impulse = inertia * self.velocity[0] + self.external_force[0]
        users = np.flatnonzero(slope > 0.0)
        side, rest, slope = self.side[users], rest[users], slope[users]
        breaks = side * rest / slope
        order = np.argsort(breaks)
        breaks, side, rest, slope = breaks[order], side[order], rest[order], slope[order]
        # below all break points those who push to the right are in contact, above all those who push to the left
        right = side > 0.0
        pushes = np.concatenate(([0.0], -np.cumsum(rest))) + rest[right].sum()
        slopes = np.concatenate(([0.0], -np.cumsum(side * slope))) + slope[right].sum()
        velocities = (impulse + pushes) / (inertia + self.object_damping + slopes)
        below = velocities[:-1] <= breaks
        return float(velocities[int(below.argmax()) if below.any() else -1])
