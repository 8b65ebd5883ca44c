"""Base of a world of one's own: each seat moves a tool, a point on which a force and a damper to ground act (theory 8.1).

Per axis at a tool: T frame, b impedance, u wave that came, v wave that goes back, x place of the tool:

    force sqrt(2b) u, damper b      w = (x - x_before) / T      v = sqrt(2b) w - u      (u^2 - v^2) T/2 = (sqrt(2b) u - b w) w T

so that what comes in at a port is the work of force and damper on the tool, however `move` goes about it.
"""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from cogrip.protocol.settings import SeatSettings
from cogrip.server.worlds.world import Array, World


class ToolWorld(World):
    """A world that has `tools`, `energy_j` and `move`, and names in `kept` what changes.

    `position` and `velocity` are shown as those of the object; `move` may set them. A tool stays where it is when a person
    takes it: the hand is then there, wherever it is in its own frame.
    """

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self._drive = np.sqrt(2.0 * self.impedance)

    @property
    @abstractmethod
    def tools(self) -> Array:
        """Place of each seat's tool [m], shape (n, a)."""

    @abstractmethod
    def move(self, force_n: Array, damping_nspm: Array) -> None:
        """Move everything by one frame, `frame_s`.

        On a tool act its force_n, shape (n, a), and -damping_nspm times its velocity, shape (n, 1), both 0 at a tool that
        nobody holds. Neither array can be written to.
        """

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self.tools[user]
        self.holding[user] = True

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.force[user] = 0.0

    def proxy(self, user: int) -> Array:
        place: Array = self.tools[user] + self.offset[user]
        return place

    def stiffness_of(self, user: int) -> float | None:
        return None

    def rest(self) -> None:
        """Leave it moving: it comes to rest by its own friction."""

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        self._drive[user] = np.sqrt(2.0 * self.impedance[user])

    def step(self, inputs: Array) -> Array:
        held = self.holding[:, None]
        u = np.where(held, inputs, 0.0)
        force, damping = self._drive * u, np.where(held, self.impedance, 0.0)
        force.setflags(write=False)
        damping.setflags(write=False)
        before = np.array(self.tools)
        self.move(force, damping)
        w = np.where(held, (self.tools - before) / self.frame_s, 0.0)
        back = self._drive * w - u
        self.force = force - damping * w
        self._book((0.5 * self.frame_s) * (u * u - back * back).sum(axis=1))
        return back
