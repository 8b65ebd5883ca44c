"""Object whose faces the clients render themselves: each line ends at the object itself, along the first axis (theory 7.7).

A wall needs no line: waves are absorbed. A free object of mass m_o gives each person who is there a copy of mass m, and keeps
the rest. Symbols: M = m_o - sum of m, v velocity of the object and b_o its damping, u and v_back forward and returning wave,
b impedance of each line, F_ext external force, T frame. Implicit midpoint, exact in energy for any of them:

    M (v' - v) / T = sum (sqrt(2b) u - b w) + F_ext - b_o w      w = (v + v') / 2      v_back = sqrt(2b) w - u

Who comes takes m at rest from the object's own, who leaves returns it at rest; each loses energy and makes none.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import REMOTE_FORCE_N
from cogrip.server.worlds.world import Array, HandWorld, dot


class LocalFacesWorld(HandWorld):
    """`hand` is each proxy as its client reports it, in the object's frame."""

    kept = ("touching",)

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.whole_kg, self.copy_kg = self.mass_kg, seats[0].copy_kg
        self.touching = np.zeros_like(self.force)  # force of each person on a wall, by their own report [N]

    def set_reported_positions(self, user: int, hand_m: Row, proxy_m: Row) -> None:
        self.hand[user] = proxy_m
        self.touching[user] = pressed_n(float(self.stiffness[user, 0]), hand_m, proxy_m)

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self.hand[user], self.offset[user] = position_m, 0.0
        self.touching[user] = 0.0

    def leave(self, user: int) -> None:
        before = self.moving_kg
        super().leave(user)
        self.velocity = self.velocity * (before / self.moving_kg)

    @property
    def moving_kg(self) -> float:
        """M, without the copies of those who are there."""
        return self.whole_kg - self.copy_kg * int(self.holding.sum())

    @property
    def energy_j(self) -> float:
        return 0.5 * self.moving_kg * dot(self.velocity, self.velocity)

    def step(self, inputs: Array) -> Array:
        period, u = self.frame_s, np.where(self.holding[:, None], inputs, 0.0)
        back = np.zeros_like(u)
        self.force = np.zeros_like(self.force)
        if self.fixed:
            self.force[:, 0] = self.touching[:, 0]
        else:
            held = np.where(self.holding, self.impedance[:, 0], 0.0)
            gain = self.impedance[:, 0] * self.wave_gain[:, 0]  # sqrt(2b)
            drive = gain * u[:, 0]
            inertia = 2.0 * self.moving_kg / period
            pull, weight = (
                inertia * self.velocity + self.external_force,
                np.full(self.axes, inertia + self.object_damping),
            )
            pull[0] += np.add.reduce(drive)
            weight[0] += np.add.reduce(held)
            mid = pull / weight
            self.force[:, 0] = drive - held * mid[0]
            back[:, 0] = np.where(self.holding, gain * mid[0] - u[:, 0], 0.0)
            before = self.energy_j
            self.position, self.velocity = self.position + period * mid, 2.0 * mid - self.velocity
            came = period * dot(self.force[:, 0], np.full_like(drive, mid[0])) + period * dot(self.external_force, mid)
            gained = self.energy_j - before + period * self.object_damping * dot(mid, mid)
            self.balance_error_j = max(self.balance_error_j, abs(came - gained))
        self._count_work((0.5 * period) * (u * u - back * back).sum(axis=1))
        return back


def pressed_n(stiffness_npm: float, hand_m: Row, proxy_m: Row) -> Array:
    """Return the force of contact that a client renders [N], shape (a,), by what it reports: an estimate, and bounded."""
    deep = np.subtract(hand_m, proxy_m)
    size_n = stiffness_npm * float(np.sqrt(dot(deep, deep)))
    force: Array = stiffness_npm * min(1.0, REMOTE_FORCE_N / size_n if size_n else 1.0) * deep
    return force
