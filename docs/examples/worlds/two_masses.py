"""Two masses and a spring: each of two people holds a mass, and feels the other through the spring.

Implicit midpoint rule: with the mean velocity w of the frame, v' = 2w - v and x' = x + T w,

    2m/T (w - v) = force - (b + B) w - K (e + T/2 (w - w_other)) - C (w - w_other)      e = x - x_other

two linear equations an axis. Energy changes by exactly what the forces do and the dampers take: nothing is made.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import Array

SIGNS = np.array([[1.0, -1.0], [-1.0, 1.0]])


class TwoMasses(ToolWorld):
    """Masses of `object.mass_kg` with `object.damping_nspm` to ground, B."""

    stiffness_npm = 300.0  # K
    friction_nspm = 3.0  # C, within the spring
    seats_allowed = (2,)
    kept = ("place", "speed")

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.place = np.zeros((2, self.axes))  # m
        self.speed = np.zeros((2, self.axes))  # m/s

    @property
    def tools(self) -> Array:
        return self.place

    @property
    def energy_j(self) -> float:
        stretch = self.place[0] - self.place[1]
        return 0.5 * float(self.mass_kg * (self.speed**2).sum() + self.stiffness_npm * (stretch**2).sum())

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        frame_s, inertia = self.frame_s, 2.0 * self.mass_kg / self.frame_s
        own = np.diag(inertia + self.object_damping + damping_nspm[:, 0])
        push = inertia * self.speed + force_n - self.stiffness_npm * SIGNS @ self.place
        between = 0.5 * frame_s * self.stiffness_npm + self.friction_nspm
        mean = np.linalg.solve(own + between * SIGNS, push)
        self.place = self.place + frame_s * mean
        self.speed = 2.0 * mean - self.speed
        self.position, self.velocity = self.place.mean(axis=0), self.speed.mean(axis=0)
