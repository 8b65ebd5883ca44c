"""A viscous field with a virtual fixture: the hand moves through honey, and a spring guides it along the first axis.

The field is thick on the right of the middle, thin on the left. Implicit midpoint rule with the mean velocity w of the frame:

    2m/T (w - v) = force - (b + B) w - K (x + T/2 w)      K = 0 along the guide      an axis each

B is taken where the tool is at the beginning of the frame: a damper takes energy wherever it is.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import Array

GUIDE_NPM = 400.0
THIN_NSPM = 1.0
THICK_NSPM = 15.0


class ViscousField(ToolWorld):
    """Every seat has a tool of `object.mass_kg` of its own; the first one's is shown as the object."""

    axes_allowed = (2, 3)
    kept = ("place", "speed")

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.place = np.zeros((len(seats), self.axes))  # m
        self.speed = np.zeros((len(seats), self.axes))  # m/s
        self.guide = np.array([0.0] + [GUIDE_NPM] * (self.axes - 1))

    @property
    def tools(self) -> Array:
        return self.place

    @property
    def energy_j(self) -> float:
        return 0.5 * float(self.mass_kg * (self.speed**2).sum() + (self.guide * self.place**2).sum())

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        frame_s, inertia = self.frame_s, 2.0 * self.mass_kg / self.frame_s
        field = np.where(self.place[:, :1] > 0.0, THICK_NSPM, THIN_NSPM)
        resistance = inertia + damping_nspm + field + 0.5 * frame_s * self.guide
        mean = (inertia * self.speed + force_n - self.guide * self.place) / resistance
        self.place = self.place + frame_s * mean
        self.speed = 2.0 * mean - self.speed
        self.position, self.velocity = self.place[0], self.speed[0]
