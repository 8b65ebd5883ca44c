"""A steering wheel on a torsional spring: people hold it by its hub, turn it, and feel each other through it.

phi, omega: angle about z and its rate. I, B, K: inertia, friction and stiffness of the wheel. Torques tau of all people, each
beside a damper b_r, act on the one axle; implicit midpoint rule with the mean rate w of the frame:

    2I/T (w - omega) = sum tau - (B + sum b_r) w - K (phi + T/2 w)

On every other axis the wheel gives no way: there the hand feels its line alone.
"""

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import Array

RADIUS_M = 0.06
STIFFNESS_NMPRAD = 0.1
TURN = 5  # the axis that turns: rotation about z
RIM = 8  # pieces that it is drawn of


class SteeringWheel(ToolWorld):
    """`object.mass_kg` and `damping_nspm` are those of the rim. The wheel's pose is shown as the object's."""

    axes_allowed = (6,)
    kept = ("phi_rad", "omega_radps")

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.phi_rad = self.omega_radps = 0.0
        self.inertia_kgm2 = self.mass_kg * RADIUS_M**2
        self.friction_nms = self.object_damping * RADIUS_M**2

    @property
    def tools(self) -> Array:
        poses = np.zeros((len(self.holding), 6))
        poses[:, TURN] = self.phi_rad
        return poses

    @property
    def energy_j(self) -> float:
        return 0.5 * (self.inertia_kgm2 * self.omega_radps**2 + STIFFNESS_NMPRAD * self.phi_rad**2)

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        frame_s, inertia = self.frame_s, 2.0 * self.inertia_kgm2 / self.frame_s
        torque, damping = (float(column.sum()) for column in (force_n[:, TURN], damping_nspm[:, TURN]))
        pull = inertia * self.omega_radps + torque - STIFFNESS_NMPRAD * self.phi_rad
        mean = pull / (inertia + damping + self.friction_nms + 0.5 * frame_s * STIFFNESS_NMPRAD)
        self.phi_rad += frame_s * mean
        self.omega_radps = 2.0 * mean - self.omega_radps
        self.position = np.array([0.0, 0.0, 0.0, 0.0, 0.0, self.phi_rad])
        self.velocity = np.array([0.0, 0.0, 0.0, 0.0, 0.0, self.omega_radps])

    def geoms(self) -> Sequence[Shape]:
        hub = Shape("cylinder", (0.012, 0.012, 0.0), body=0)
        spoke = Shape("box", (RADIUS_M, 0.004, 0.004), body=0)
        angles = [2.0 * np.pi * number / RIM for number in range(RIM)]
        return [hub, spoke] + [
            Shape(
                "capsule", (0.006, RADIUS_M * np.pi / RIM, 0.0), body=0,
                place_m=(RADIUS_M * cos(angle), RADIUS_M * sin(angle), 0.0),
                orientation=_along_the_rim(angle),
            )
            for angle in angles
        ]  # fmt: skip

    def poses_of_bodies(self) -> Array:
        half = 0.5 * self.phi_rad
        return np.array([[0.0, 0.0, 0.0, cos(half), 0.0, 0.0, sin(half)]])


def _along_the_rim(angle: float) -> tuple[float, float, float, float]:
    """Return the rotation that lays a capsule, which stands along z, along the rim at an angle."""
    return (cos(np.pi / 4), -sin(np.pi / 4) * cos(angle), -sin(np.pi / 4) * sin(angle), 0.0)
