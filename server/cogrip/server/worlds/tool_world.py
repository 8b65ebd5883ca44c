"""Base of a world of one's own: each seat moves a tool, on which a force and a damper to ground act (theory 8.1).

Per axis at a tool: T frame, b impedance, u wave that came, v wave that goes back, x place of the tool:

    force sqrt(2b) u, damper b      w = (x - x_before) / T      v = sqrt(2b) w - u      (u^2 - v^2) T/2 = (sqrt(2b) u - b w) w T

so that what comes in at a port is the work of force and damper on the tool, however `move` goes about it. Of six axes the last
three are the same with torque, b_r and, R being the tool's orientation, w = log(R R_before^-1) / T, in the world's frame (8.5).
"""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import Shape
from cogrip.protocol.laws.rotations import exp, inverse, log, product
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.accounts import ToolAccounts
from cogrip.server.worlds.drawing import Drawing
from cogrip.server.worlds.world import Array, World, displacement


class ToolWorld(World):
    """A world that has `tools`, `energy_j` and `move`, and names in `kept` what changes.

    `position` and `velocity` are shown as those of the object; `move` may set them. A tool stays as it is when a person
    takes it: the hand is then there, wherever it is, and however it is turned, in its own frame. Orientations are rotation
    vectors, of any length; `cogrip.protocol.laws.rotations` has what turns and adds them. Behind the offset of a place is the
    rotation D with R D = R_hand in the hand's own frame, which both turning by the same rotation leaves as it is.
    """

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self._drive = np.sqrt(2.0 * self.port_impedance)
        self.accounts, self.drawing = ToolAccounts(self), OwnDrawing(self)

    @property
    @abstractmethod
    def tools(self) -> Array:
        """Place of each seat's tool [m], of six axes with its rotation vector [rad] behind it, shape (n, a)."""

    @abstractmethod
    def move(self, force_n: Array, damping_nspm: Array) -> None:
        """Move everything by one frame, `frame_s`.

        On a tool act its force_n and -damping_nspm times its velocity on each axis, shapes (n, a), both 0 at a tool that
        nobody holds: of six axes the last three are torque [N m] and damper of rotation [N m s]. Neither can be written to.
        """

    def join(self, user: int, position_m: Array) -> None:
        tool = self.tools[user]
        self.offset[user] = position_m - tool
        if self.axes > PLACES:
            turn, hand = (exp(pose[PLACES:].tolist()) for pose in (tool, position_m))
            self.offset[user, PLACES:] = log(product(inverse(turn), hand))
        self.holding[user] = True

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.force[user] = 0.0

    def proxy(self, user: int) -> Array:
        tool, offset = self.tools[user], self.offset[user]
        place: Array = tool + offset
        if self.axes > PLACES:
            place[PLACES:] = log(product(exp(tool[PLACES:].tolist()), exp(offset[PLACES:].tolist())))
        return place

    def bring_to_rest(self) -> None:
        """Leave it moving: it comes to rest by its own friction."""

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        self._drive[user] = np.sqrt(2.0 * self.port_impedance[user])

    def step(self, inputs: Array) -> Array:
        held = self.holding[:, None]
        u = np.where(held, inputs, 0.0)
        force, damping = self._drive * u, np.where(held, self.port_impedance, 0.0)
        force.setflags(write=False)
        damping.setflags(write=False)
        before = np.array(self.tools)
        self.move(force, damping)
        w = np.where(held, displacement(before, self.tools) / self.frame_s, 0.0)
        back = self._drive * w - u
        self.force = force - damping * w
        self._count_work((0.5 * self.frame_s) * (u * u - back * back).sum(axis=1))
        return back

    # Looks, for the author to say

    def geoms(self) -> Sequence[Shape]:
        """Return the shapes that the world is drawn of; none where the object alone is drawn."""
        return ()

    def poses_of_bodies(self) -> Array:
        """Return place [m] in the object's frame and quaternion of each body that moves and has shapes, shape (bodies, 7)."""
        return np.zeros((0, 7))

    def not_drawn(self) -> Sequence[str]:
        """Return what the world has that its shapes do not say, in words, for those who look at it; none where they say all."""
        return ()


class OwnDrawing(Drawing):
    """The looks of a world, as its author says them."""

    def __init__(self, world: ToolWorld) -> None:
        self._world = world

    def shapes(self) -> Sequence[Shape]:
        return self._world.geoms()

    def poses(self) -> Array:
        return self._world.poses_of_bodies()

    def left_out(self) -> Sequence[str]:
        return self._world.not_drawn()
