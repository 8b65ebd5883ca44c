"""Reference schemes: an object moved by forces computed from the frame before, held over the frame.

`PaperWorld` is P eq. 17 and 18 (corrected, theory section 1): the wave is decoded with the force of the step
before. `CoupledWorld` is virtual coupling: forces from the device states last received (theory section 5). Neither is
passive; both are references to compare with.
"""

from collections.abc import Sequence
from math import exp

import numpy as np

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.world import Array, HandWorld, dot


class LaggedWorld(HandWorld):
    """Object under held forces, with penalty contact."""

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        period, mass, damping = self.frame_s, self.mass_kg, self.object_damping
        if damping > 0.0:  # exact zero-order hold of m v' + b v = F over T
            self._decay = exp(-damping * period / mass)
            self._gain = (1.0 - self._decay) / damping
            self._glide = mass / damping * (1.0 - self._decay)
            self._reach = (period - self._glide) / damping
        else:
            self._decay, self._gain = 1.0, period / mass
            self._glide, self._reach = period, 0.5 * period * period / mass

    def contact(self, hand_velocity: Array) -> Array:
        """Return F = K (x_s - x_o) + B (v_s - v_o), P eq. 18, shape (n, a); one-sided with a depth test.

        x_s, v_s: of the proxy (`hand_velocity`); x_o, v_o: of the object.
        """
        stretch = self.hand - self.position
        force = self.stiffness * stretch + self.damping * (hand_velocity - self.velocity)
        if self.one_sided:
            push = np.where(self.side * stretch[:, 0] > 0.0, np.maximum(0.0, self.side * force[:, 0]), 0.0)
            force[:, 0] = self.side * push
            force[:, 1:] = 0.0
        return force

    def move_object(self) -> Array:
        """Move the object under the held forces for one frame, exactly. Returns its displacement, shape (a,)."""
        if self.fixed:
            return np.zeros_like(self.position)
        total = self.force.sum(axis=0) + self.external_force
        moved: Array = self._glide * self.velocity + self._reach * total
        self.velocity = self._decay * self.velocity + self._gain * total
        self.position = self.position + moved
        return moved


class PaperWorld(LaggedWorld):
    """P's server step on wave ports."""

    def step(self, inputs: Array) -> Array:
        period, b, c, u = self.frame_s, self.impedance, self.wave_gain, inputs
        stored_before = self.energy_j
        proxy_velocity = c * u - self.force / b  # the force is one step old: T_VE of P eq. 17
        self.hand = self.hand + period * proxy_velocity
        self.force = self.contact(proxy_velocity)
        back = u - c * self.force
        relative = proxy_velocity - self.velocity
        lost = period * (self.damping * relative * relative).sum()
        moved = self.move_object()
        lost += self.object_damping * dot(moved, moved) / period
        port = (0.5 * period) * (u * u - back * back).sum(axis=1)
        error = port.sum() + dot(self.external_force, moved) - (self.energy_j - stored_before) - lost
        self.balance_error_j = max(self.balance_error_j, abs(float(error)))
        self._count_work(port)
        return back


class CoupledWorld(LaggedWorld):
    """Inputs are device position and velocity, shape (n, 2a). The object's after the step go back, in each user's own frame."""

    inputs_per_axis = 2

    def step(self, inputs: Array) -> Array:
        axes = self.axes
        hands = inputs[:, :axes] - self.offset
        self.hand = np.where(self.holding[:, None], hands, self.hand)
        self.force = self.contact(inputs[:, axes:])
        self._count_work((self.force * self.move_object()).sum(axis=1))
        seen = self.position + self.offset  # after the step, as a wave that goes back is: theory section 6
        answers: Array = np.concatenate((seen, np.broadcast_to(self.velocity, seen.shape)), axis=1)
        return answers
