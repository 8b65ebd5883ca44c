"""A free object that people grip from all sides: implicit midpoint with the wave ports solved in the same step.

Symbols: K, B stiffness and damping of each of n springs, e its stretch, b wave impedance of its port, m_o mass of the object.
Passive for any of them (theory section 3.3); the balance there holds to machine precision at every step. Where few hold the
object `small_grip` makes the same step in plain floats.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from cogrip.machine.addition import add_floats
from cogrip.protocol.laws.waves import proxy_velocity, server_wave
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.small_step import RAMP_S as RAMP_S
from cogrip.server.worlds.world import MOST_SAVED_J, Array, World, dot


class GripWorld(World):
    """A free object that people grip from all sides.

    `stretch` is e, shape (n, a).

    A spring with stiffness adaptation saves what its damper takes, and what it releases itself where it grows softer, to grow
    stiffer with.
    """

    kept: ClassVar[tuple[str, ...]] = ("stretch", "_ledger", "_growing")
    can_adapt_stiffness = True

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.stretch = np.zeros_like(self.force)
        self._ledger = np.zeros(len(seats))  # energy that each user's spring may spend on growing stiffer [J]
        self._growing = False
        self._saving = bool(self.adapts_stiffness.any())

    def set_target_stiffness(self, user: int, stiffness_npm: float) -> None:
        self.target_stiffness[user] = stiffness_npm
        self._growing = True

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self.position
        self.stretch[user] = 0.0
        self.stiffness[user] = 0.0
        self.damping[user] = self.target_damping[user]
        self._ledger[user] = 0.0
        self.holding[user] = True
        self._growing = True

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.stretch[user] = self.stiffness[user] = self.damping[user] = self.force[user] = 0.0

    @property
    def energy_j(self) -> float:
        stretch, velocity = self.stretch, self.velocity
        stored = 0.5 * (dot(self.stiffness * stretch, stretch) + self.mass_kg * dot(velocity, velocity))
        return stored + float(self._ledger.sum())

    def proxy(self, user: int) -> Array:
        place: Array = self.position + self.stretch[user] + self.offset[user]
        return place

    def step(self, inputs: Array) -> Array:
        period, b, c = self.frame_s, self.impedance, self.wave_gain
        K, B, e, u = self.stiffness, self.damping, self.stretch, inputs
        inertia = 2.0 * self.mass_kg / period
        G = K * (0.5 * period) + B
        gain = 1.0 / (1.0 + G / b)
        alpha = (K * e + G * c * u) * gain
        beta = G * gain
        pull = inertia * self.velocity + alpha.sum(axis=0) + self.external_force
        mid = pull / (inertia + self.object_damping + beta.sum())
        force = alpha - beta * mid
        back: Array = server_wave(c, u, force)
        relative = proxy_velocity(b, c, u, force) - mid
        grown = e + period * relative
        velocity = 2.0 * mid - self.velocity

        stored_before = 0.5 * (dot(K * e, e) + self.mass_kg * dot(self.velocity, self.velocity))
        stored = 0.5 * (dot(K * grown, grown) + self.mass_kg * dot(velocity, velocity))
        port = (0.5 * period) * (u * u - back * back).sum(axis=1)
        lost = period * (dot(B * relative, relative) + self.object_damping * dot(mid, mid))
        supplied = add_floats(port.tolist()) + period * dot(self.external_force, mid)
        self.balance_error_j = max(self.balance_error_j, abs(supplied - (stored - stored_before) - lost))

        self._count_work(port)
        self.force = force
        self.stretch = grown
        self.position = self.position + period * mid
        self.velocity = velocity
        if self._growing or self._saving:
            self._ledger += period * (B * relative * relative).sum(axis=1)
        if self._growing:
            self._grow()
        if self._saving:
            np.minimum(self._ledger, MOST_SAVED_J, out=self._ledger, where=self.adapts_stiffness)
        return back

    def _grow(self) -> None:
        """Move K towards its target. To raise it costs dK e^2 / 2, which is paid from what the user's own damper has taken
        (theory section 3.7); to lower it takes as much from the spring, which the ledger keeps."""
        square = (self.stretch * self.stretch).sum(axis=1)
        wanted = np.minimum(
            self.target_stiffness[:, 0] * (self.frame_s / RAMP_S), self.target_stiffness[:, 0] - self.stiffness[:, 0]
        )
        affordable = np.divide(2.0 * self._ledger, square, out=np.full_like(square, np.inf), where=square > 0.0)
        step = np.where(self.holding, np.minimum(wanted, affordable), 0.0)
        self._ledger -= 0.5 * step * square
        self.stiffness[:, 0] += step
        self._growing = bool(np.any(self.holding & (self.stiffness[:, 0] != self.target_stiffness[:, 0])))
