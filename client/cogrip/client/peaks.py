"""Largest forces and path of one hand's session."""

from dataclasses import dataclass
from math import dist, hypot

from cogrip.client.grip_axes import GripAxes
from cogrip.client.pose_axes import PoseAxes, Row
from cogrip.protocol.setting_types import PLACES


@dataclass(slots=True)
class Peaks:
    """Largest force and change of force between two ticks [N], and the path from frame to frame [m]; further: largest torque
    [N m], or force of a gripper [N]."""

    force_n: float = 0.0
    further: float = 0.0
    step_n: float = 0.0
    travel_m: float = 0.0

    def enter(self, force_n: Row, before_n: Row, axes: PoseAxes | GripAxes | None) -> None:
        """Update the largest values by the force of a tick and that of the tick before, shape (axes,)."""
        if axes is not None:
            self.further = max(self.further, axes.length_scale * hypot(*force_n[PLACES:]))
            step, size = dist(force_n[:PLACES], before_n[:PLACES]), hypot(*force_n[:PLACES])
        elif len(force_n) == 1:
            step, size = abs(force_n[0] - before_n[0]), abs(force_n[0])
        else:
            step, size = dist(force_n, before_n), hypot(*force_n)
        if step > self.step_n:
            self.step_n = step
        if size > self.force_n:
            self.force_n = size
