"""A deformable line: beads on springs between two people, each of whom holds an end..

x, v: how far each bead is from its place in the straight line, and its velocity, shape (beads, a). M, B, K: matrices of mass,
friction between neighbours and stiffness. Implicit midpoint rule with the mean velocity w of the frame, all axes at once:

    2M/T (w - v) = force - (b + B) w - K (x + T/2 w)
"""

from collections.abc import Sequence

import numpy as np

from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import Array

BEADS = 9
LENGTH_M = 0.12
STIFFNESS_NPM = 2000.0  # of each of the springs
FRICTION_NSPM = 1.0
ENDS = [0, BEADS - 1]


class SoftLine(ToolWorld):
    """`object.mass_kg` is that of all beads. The middle one is shown as the object."""

    seats_allowed = (2,)
    kept = ("place", "speed")

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.place = np.zeros((BEADS, self.axes))  # m, from its place in the straight line
        self.speed = np.zeros((BEADS, self.axes))  # m/s
        differences = np.diff(np.eye(BEADS), axis=0)
        self.K = STIFFNESS_NPM * differences.T @ differences
        self.B = FRICTION_NSPM * differences.T @ differences + self.object_damping * np.eye(BEADS)
        self.bead_kg = self.mass_kg / BEADS

    @property
    def tools(self) -> Array:
        return self.place[ENDS]

    @property
    def energy_j(self) -> float:
        springs = STIFFNESS_NPM * (np.diff(self.place, axis=0) ** 2).sum()
        return 0.5 * float(self.bead_kg * (self.speed**2).sum() + springs)

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        frame_s, inertia = self.frame_s, 2.0 * self.bead_kg / self.frame_s
        push = inertia * self.speed - self.K @ self.place
        push[ENDS] += force_n
        held = np.zeros(BEADS)
        held[ENDS] = damping_nspm[:, 0]
        mean = np.linalg.solve(np.diag(inertia + held) + self.B + 0.5 * frame_s * self.K, push)
        self.place = self.place + frame_s * mean
        self.speed = 2.0 * mean - self.speed
        self.position, self.velocity = self.place[BEADS // 2], self.speed[BEADS // 2]

    def geoms(self) -> Sequence[Shape]:
        seats = {0: 0, BEADS - 1: 1}
        return [Shape("sphere", (0.005, 0.0, 0.0), body=bead, seat=seats.get(bead)) for bead in range(BEADS)]

    def poses_of_bodies(self) -> Array:
        poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (BEADS, 1))
        poses[:, 0] = np.linspace(-0.5 * LENGTH_M, 0.5 * LENGTH_M, BEADS)
        poses[:, : self.axes] += self.place
        return poses
