"""One kind of arm: mechanism, drives, home pose, what it can do; and the keys that make it a particular one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, inf
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.arm.gimbal import Gimbal
from cogrip.devices.arm.kinematics import NO_TORQUE, Kinematics, joint_torque
from cogrip.devices.arm.motors import NO_CURRENT, CableDrive, Currents
from cogrip.devices.device import Capability, DeviceError
from cogrip.devices.settings import bounded
from cogrip.machine.rows import Vector

Pose = Literal["stored", "home", "none"]


class ArmSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys of every arm with cable drives. What is not given is the model's own; three numbers are axes a, b, c.

    pose          how the pose is known: "stored", by `cogrip devices calibrate`; "home", whoever writes this confirms that the
                  counters were zero in the home pose; "none", it is not known, and no force is given
    dir           +1 or -1 per axis
    home          counts in the home pose
    turn          counts a turn of the motor
    capstan_m, body_m, motor_nm_per_a
    limit_ma      what the motor current of each axis stays below [mA]
    full_scale_ma what amplifiers and firmware were built and set for [mA]; bounds limit_ma
    peak_force_n  largest force [N]
    gravity       "maker": the motors hold the arm's own weight where its maker's software does; "off": they never do
    """

    gravity: Literal["maker", "off"] = "maker"
    pose: Pose = "stored"
    dir: tuple[float, ...] = ()
    home: tuple[float, ...] = ()
    turn: tuple[float, ...] = ()
    capstan_m: tuple[float, ...] = ()
    body_m: tuple[float, ...] = ()
    motor_nm_per_a: tuple[float, ...] = ()
    limit_ma: tuple[float, ...] = ()
    full_scale_ma: Annotated[float, Meta(ge=2.0, le=6000.0)] | None = None
    peak_force_n: Annotated[float, Meta(gt=0.0, le=40.0)] | None = None


@dataclass(frozen=True, slots=True)
class ArmModel:
    """Numbers of one kind of arm.

    home_counts those that the home pose has
    record      for three axes, with the drive as it is here
    reach_m     radius about the origin where force is meant to be given [m]
    gimbal      of the handle; None where there is none
    gimbal_home_counts  those that the three counters of the handle have in the home pose
    holds_weight the motors hold the arm's own weight, as with its maker's software
    takes_torques  what its firmware calls currents are steps of torque
    """

    kinematics: Kinematics
    drive: CableDrive
    home_counts: Vector
    record: Capability
    reach_m: float
    gimbal_home_counts: Vector = (0.0, 0.0, 0.0)
    holds_weight: bool = False
    gimbal: Gimbal | None = None
    takes_torques: bool = False

    def with_settings(self, settings: ArmSettings, where: str) -> ArmModel:
        """This model with the keys that were given in place. Raises DeviceError for a value that no arm has.

        The record follows: resolution and continuous force are those of the new drive; a peak is what it is set to.
        """
        full_scale = self.drive.full_scale_ma if settings.full_scale_ma is None else settings.full_scale_ma
        own = {
            "direction": bounded(settings.dir, 3, "dir", where, (-1.0, 1.0), whole=True),
            "counts_per_turn": bounded(settings.turn, 3, "turn", where, (1.0, 1e6)),
            "capstan_m": bounded(settings.capstan_m, 3, "capstan_m", where, (1e-4, 1.0)),
            "body_m": bounded(settings.body_m, 3, "body_m", where, (1e-3, 10.0)),
            "motor_nm_per_a": bounded(settings.motor_nm_per_a, 3, "motor_nm_per_a", where, (1e-4, 10.0)),
            "limit_ma": bounded(settings.limit_ma, 3, "limit_ma", where, (2.0, full_scale))
            or tuple(min(limit, full_scale) for limit in self.drive.limit_ma),
        }
        home: Any = bounded(settings.home, 3, "home", where, (-1e6, 1e6)) or self.home_counts
        given: dict[str, Any] = {key: value for key, value in own.items() if value}
        drive = replace(self.drive, full_scale_ma=full_scale, **given)
        record = self._record(drive, settings.peak_force_n)
        holds_weight = self.holds_weight and settings.gravity == "maker"
        return replace(self, drive=drive, home_counts=home, record=record, holds_weight=holds_weight)

    def _record(self, drive: CableDrive, peak_force_n: float | None) -> Capability:
        """The record with another drive: the joint that changes for the worst decides, so both numbers are on the safe side.

        Motors do not grow stronger for good by a higher limit: their continuous force follows it down, not up.
        """
        old, record = self.drive, self.record
        strength = [
            min(now, before) / before * abs(was / per_nm)
            for now, before, was, per_nm in zip(
                drive.limit_ma, old.limit_ma, old.ma_per_nm, drive.ma_per_nm, strict=True
            )
        ]
        coarser = [abs(now / was) for now, was in zip(drive.rad_per_count, old.rad_per_count, strict=True)]
        peak = record.peak_force_n if peak_force_n is None else peak_force_n
        return replace(
            record,
            peak_force_n=peak,
            continuous_force_n=min(peak, record.continuous_force_n * min(strength)),
            resolution_m=record.resolution_m * max(coarser),
        )

    def inside(self, position: Vector) -> bool:
        """Return True if `position` [m] is finite and within reach_m of the origin."""
        return hypot(*position) <= self.reach_m

    def weight_currents(self, angles: Vector, fraction: float) -> tuple[Vector, bool]:
        """Motor currents [mA] that hold `fraction` of the arm's own weight, not rounded. True if limits let them hold less."""
        a, b, c = self.drive.currents(self.kinematics.gravity(angles))
        a, b, c = fraction * a, fraction * b, fraction * c
        part = min(
            [1.0, *(most / abs(i) for i, most in zip((a, b, c), self.drive.largest_ma, strict=True) if abs(i) > most)]
        )
        return (part * a, part * b, part * c), part < 1.0

    def currents(self, angles: Vector, force: Vector, held_ma: Vector = NO_TORQUE) -> tuple[Currents, bool]:
        """Motor currents [mA] for a force [N] of the tip on the hand, within the limits of force and motors.

        held_ma: those that hold the arm's weight (`weight_currents`); they go first, and the force gets what they leave.
        True if the force had to be scaled down; one that is not finite gives none. Raises DeviceError at angles where the
        linkage does not close, or only just.
        """
        x, y, z = force
        size, most = hypot(x, y, z), self.record.peak_force_n
        scaled = not size <= most
        if scaled:
            if not size < inf:
                return NO_CURRENT, True
            fraction = most / size
            x, y, z = fraction * x, fraction * y, fraction * z
        jacobian = self.kinematics.jacobian(angles)
        if jacobian is None:
            raise DeviceError(
                f"{self.record.model}: joint angles {angles} rad are out of reach of its linkage; "
                "its counters are wrong, calibrate it again"
            )
        currents, limited = self.drive.limited(self.drive.currents(joint_torque(jacobian, (x, y, z))), held_ma)
        return currents, limited or scaled

    def fraction_given(self, angles: Vector, force: Vector, currents: Currents, held_ma: Vector = NO_TORQUE) -> float:
        """The part of `force` that `currents`, scaled down by `currents()`, give beside `held_ma`, of 1."""
        jacobian = self.kinematics.jacobian(angles)
        if jacobian is None:
            return 0.0
        wanted = self.drive.currents(joint_torque(jacobian, force))
        most = max(range(3), key=lambda joint: abs(wanted[joint]))
        return max(0.0, (currents[most] - held_ma[most]) / wanted[most]) if wanted[most] else 0.0
