"""Axes of a seat whose hand turns, as one vector of lengths: the laws of this end then need not tell them apart.

A device gives poses: place [m] and rotation vector [rad], in the world's frame, and takes wrenches: force [N] and torque [N m].
With the characteristic length l = sqrt(b_r / b) of its seat, R_k the orientation of sample k (theory 8.5),

    theta_k = theta_{k-1} + log(R_k R_{k-1}^T)          q = (x, l theta)          f = (F, tau / l)

q is a length on each axis, f a force, f dq/dt the hand's power, and a port of impedance b on q is one of b_r on theta. The
angle travelled, theta, does not say how the hand is turned: rotations do not commute.
"""

from collections.abc import Sequence
from math import isfinite

from cogrip.client.hand.axes import AxisUnits
from cogrip.devices.sample import Sample
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import UNTURNED, between, exp, log, product


class PoseAxes(AxisUnits):
    """Turns samples of one device into lengths, and forces into wrenches. length_m: l of the seat."""

    def __init__(self, length_m: float) -> None:
        super().__init__(length_m, further=True)
        self.length_m = length_m
        self._begun = False
        self._orientation = UNTURNED  # of the newest sample
        self._travelled_m: Row = (0.0,) * PLACES  # l theta then

    def lengths(self, sample: Sample) -> Sample:
        """Return a sample of q and its rate."""
        pose, twist, length = sample.position_m, sample.velocity_mps, self.length_m
        if isfinite(add_floats(pose)):
            orientation = exp(pose[PLACES:])
            if self._begun:
                step = between(self._orientation, orientation)
                self._travelled_m = tuple([at + length * by for at, by in zip(self._travelled_m, step, strict=True)])
            self._orientation, self._begun = orientation, True
            pose = pose[:PLACES] + self._travelled_m
        if twist is not None:
            twist = twist[:PLACES] + tuple([length * rate for rate in twist[PLACES:]])
        return Sample(pose, twist, sample.age_ticks, sample.buttons, sample.orientation, sample.grip_m)

    def pose(self, position_m: Row) -> Row:
        """Return the pose of a q near the newest sample's."""
        step = [(at - here) / self.length_m for at, here in zip(position_m[PLACES:], self._travelled_m, strict=True)]
        return (*position_m[:PLACES], *log(product(exp(step), self._orientation)))

    def rates(self, rates: Sequence[float]) -> Row:
        """Return a rate, or a difference, of q in metres and radians."""
        return (*rates[:PLACES], *[rate / self.length_m for rate in rates[PLACES:]])

    def wrench(self, force_n: Sequence[float]) -> Row:
        """Return force [N] and torque [N m] of an f."""
        return (*force_n[:PLACES], *[self.length_m * part for part in force_n[PLACES:]])

    def force(self, wrench: Sequence[float]) -> Row:
        """Return the f of a force [N] and a torque [N m]."""
        return (*wrench[:PLACES], *[part / self.length_m for part in wrench[PLACES:]])

    def travelled(self, moved_m: Sequence[float]) -> Row:
        return tuple([by / self.length_m for by in moved_m[PLACES:]])

    def tool_pose(self, place_m: Row, turned_rad: Row) -> Row:
        return place_m[:PLACES] + turned_rad
