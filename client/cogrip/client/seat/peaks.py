"""Largest forces and path of one hand's session."""

from math import dist, hypot

from cogrip.client.hand.axes import AxisUnits
from cogrip.client.rows.row_size import change_surely_below, surely_below
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES


class Peaks:
    """Largest force and change of force between two ticks [N], and the path from frame to frame [m]; further: largest torque
    [N m], or force of a gripper [N]."""

    __slots__ = ("force_n", "further", "step_n", "travel_m")

    def __init__(self) -> None:
        self.force_n = self.further = self.step_n = self.travel_m = 0.0

    def enter(self, force_n: Row, before_n: Row, axes: AxisUnits) -> None:
        """Update the largest values by the force of a tick and that of the tick before, shape (axes,)."""
        if axes.further:
            self.further = max(self.further, axes.length_scale * hypot(*force_n[PLACES:]))
            force_n, before_n = force_n[:PLACES], before_n[:PLACES]
        if len(force_n) == 1:
            self._enter(abs(force_n[0]), abs(force_n[0] - before_n[0]))
            return
        if not (surely_below(force_n, self.force_n) and change_surely_below(force_n, before_n, self.step_n)):
            self._enter(hypot(*force_n), dist(force_n, before_n))

    def _enter(self, size_n: float, step_n: float) -> None:
        if step_n > self.step_n:
            self.step_n = step_n
        if size_n > self.force_n:
            self.force_n = size_n
