"""Axes of a seat between its device and its laws: inside, all of a hand is in lengths of one impedance.

`AxisUnits` is for a seat of places alone, where that is so already; `PoseAxes` for a hand that turns, `GripAxes` for one with
a gripper that has force.
"""

from collections.abc import Sequence

from cogrip.client.hand.further_axes import axis_masses, in_lengths
from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.machine.rows import Row


class AxisUnits:
    """Turns samples of one device into lengths, and forces into what it takes: here nothing is to be turned.

    length_scale  factor that makes lengths of the axes behind the places
    further       whether there are such axes
    """

    def __init__(self, length_scale: float = 1.0, further: bool = False) -> None:
        self.length_scale, self.further = length_scale, further

    def record(self, record: Capability) -> Capability:
        """Return the device's record in lengths."""
        return in_lengths(record, self.length_scale) if self.further else record

    def masses_kg(self, record: Capability) -> Row:
        """Return the apparent mass of each axis in lengths, shape (axes,)."""
        return axis_masses(record, self.length_scale)

    def lengths(self, sample: Sample) -> Sample:
        """Return a sample in lengths."""
        return sample

    def pose(self, position_m: Row) -> Row:
        """Return the device's own position of one in lengths."""
        return position_m

    def rates(self, rates: Sequence[float]) -> Sequence[float]:
        """Return the device's own rates, or differences, of those in lengths."""
        return rates

    def wrench(self, force_n: Row) -> Row:
        """Return what the device is to apply for a force in lengths [N]."""
        return force_n

    def force(self, wrench: Row) -> Row:
        """Return the force in lengths [N] of what the device applies."""
        return wrench

    def travelled(self, moved_m: Sequence[float]) -> Row:
        """Return the angle travelled [rad] for a difference in lengths, () where nothing turns."""
        return ()

    def tool_pose(self, place_m: Row, turned_rad: Row) -> Row:
        """Return a tool's own pose of its place in lengths. turned_rad: its rotation vector, where the hand turns it."""
        return place_m
