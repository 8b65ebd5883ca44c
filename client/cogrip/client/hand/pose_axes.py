"""Axes of a seat whose hand turns, as one vector of lengths: the laws of this end then need not tell them apart.

A device gives poses: place [m] and rotation vector [rad], in the world's frame, and takes wrenches: force [N] and torque [N m].
With the characteristic length l = sqrt(b_r / b) of its seat, R_k the orientation of sample k (theory 8.5),

    theta_k = theta_{k-1} + log(R_k R_{k-1}^T)          q = (x, l theta)          f = (F, tau / l)

q is a length on each axis, f a force, f dq/dt the hand's power, and a port of impedance b on q is one of b_r on theta. The
angle travelled, theta, does not say how the hand is turned: rotations do not commute.
"""

from collections.abc import Sequence
from dataclasses import astuple
from math import hypot, isfinite
from typing import NamedTuple

from cogrip.devices.device import Capability, Sample
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import UNTURNED, between, exp, log, product

Row = tuple[float, ...]


class PoseAxes:
    """Turns samples of one device into lengths, and forces into wrenches. length_m: l of the seat."""

    def __init__(self, length_m: float) -> None:
        self.length_m = self.length_scale = length_m
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

    def pose(self, position_m: Sequence[float]) -> Row:
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


class FurtherAxes(NamedTuple):
    """Bounds of the axes after the first three as lengths: the fields of `Rotation` and `Gripper`, in their order."""

    peak_n: float
    continuous_n: float
    damping_nspm: float
    slew_nps: float
    speed_mps: float
    resolution_m: float
    mass_kg: float
    own_damping_nspm: float
    own_friction_n: float


def further_axes(record: Capability, length_scale: float) -> FurtherAxes | None:
    """Return the bounds of the axes after the first three, by `Coupling.length_scale`; None where there are none."""
    own = record.rotation or record.gripper
    if own is None:
        return None
    peak, continuous, damping, slew, speed, resolution, mass, own_damping, own_friction = astuple(own)
    square = length_scale * length_scale
    return FurtherAxes(
        peak / length_scale, continuous / length_scale, damping / square, slew / length_scale, length_scale * speed,
        length_scale * resolution, mass / square, own_damping / square, own_friction / length_scale,
    )  # fmt: skip


def axis_masses(record: Capability, length_scale: float) -> Row:
    """Return the apparent mass of each axis of a device, as lengths [kg], shape (axes,)."""
    other = further_axes(record, length_scale)
    places = min(record.axes, PLACES)
    further = () if other is None else (other.mass_kg,) * (record.axes - places)
    return (record.apparent_mass_kg,) * places + further


def in_lengths(record: Capability, length_scale: float) -> Capability:
    """Return the record of a device with more than three axes as one of lengths: its bounds hold for q on every axis.

    What the device can do at most is that of both together, what it carries that of the weaker.
    """
    other = further_axes(record, length_scale)
    assert other is not None
    return Capability(
        family=record.family, model=record.model, axes=record.axes, workspace_m=record.workspace_m,
        peak_force_n=hypot(record.peak_force_n, other.peak_n),
        continuous_force_n=hypot(record.continuous_force_n, other.continuous_n),
        stiffness_npm=record.stiffness_npm,
        damping_nspm=min(record.damping_nspm, other.damping_nspm),
        slew_nps=min(record.slew_nps, other.slew_nps),
        speed_mps=hypot(record.speed_mps, other.speed_mps),
        resolution_m=max(record.resolution_m, other.resolution_m),
        apparent_mass_kg=min(record.apparent_mass_kg, other.mass_kg),
        rate_hz=record.rate_hz, gives_velocity=record.gives_velocity, latency_ticks=record.latency_ticks,
        own_damping_nspm=min(record.own_damping_nspm, other.own_damping_nspm),
        own_friction_n=min(record.own_friction_n, other.own_friction_n), buttons=record.buttons,
        gives_orientation=record.gives_orientation, grip_m=record.grip_m, gripper=record.gripper,
    )  # fmt: skip
