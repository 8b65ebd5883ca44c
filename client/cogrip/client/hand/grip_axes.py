"""Axes of a seat with a gripper that has force, as one vector of lengths of one impedance: see `pose_axes`.

With b_g the gripper's own impedance, b that of the places, lambda = sqrt(b_g / b) of its seat, g opening [m], F_g its force
[N]:

    q = (x, lambda g)          f = (F, F_g / lambda)          f dq/dt = F dx/dt + F_g dg/dt

and a port of impedance b on q is one of b_g on g: waves are the same, whichever of the two one counts in.
"""

from collections.abc import Sequence

from cogrip.client.hand.axes import AxisUnits
from cogrip.devices.sample import Sample
from cogrip.machine.rows import Row


class GripAxes(AxisUnits):
    """Turns samples of one device into lengths of one impedance, and forces back. length_scale: lambda of the seat."""

    def __init__(self, length_scale: float) -> None:
        super().__init__(length_scale, further=True)

    def lengths(self, sample: Sample) -> Sample:
        """Return a sample of q and its rate."""
        pose, twist = sample.position_m, sample.velocity_mps
        place = (*pose[:-1], self.length_scale * pose[-1])
        rates = None if twist is None else (*twist[:-1], self.length_scale * twist[-1])
        return Sample(place, rates, sample.age_ticks, sample.buttons, sample.orientation, sample.grip_m)

    def pose(self, position_m: Sequence[float]) -> Row:
        """Return place and opening of a q [m]."""
        return (*position_m[:-1], position_m[-1] / self.length_scale)

    def rates(self, rates: Sequence[float]) -> Row:
        """Return a rate, or a difference, of place and opening."""
        return self.pose(rates)

    def wrench(self, force_n: Sequence[float]) -> Row:
        """Return force, and force of the gripper [N], of an f."""
        return (*force_n[:-1], self.length_scale * force_n[-1])

    def force(self, wrench: Sequence[float]) -> Row:
        """Return the f of a force and a force of the gripper [N]."""
        return (*wrench[:-1], wrench[-1] / self.length_scale)

    def tool_pose(self, place_m: Row, turned_rad: Row) -> Row:
        return self.pose(place_m)
