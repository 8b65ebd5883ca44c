"""Bounds of the axes after the first three of a device, as lengths (`pose_axes`, `grip_axes`)."""

from dataclasses import astuple
from math import hypot
from typing import NamedTuple

from cogrip.devices.device import Capability
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES


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
