"""Haply's arms by name, and the query keys that make one of them a particular one.

Lengths, wiring, home poses and the clamp of 0.123 Nm are those of Haply's examples and firmware. What those do not say:

- torque: what goes over the wire is that of the joint, tau = J^T F with J in m/rad, at the angle that the encoder counts. So it
  is in Haply's Python (HaplyHAPI), for all its arms, with a gain of 1, and only so is F dx = tau dtheta. Java and C++ of the
  old Pantograph leave the length l = 0.05 m out of J and multiply by a gain of 0.1 in its place: twice as much torque.
- peak force: what 0.123 Nm gives in the worst direction at the worst place of the workspace, rounded down.
- continuous force, stiffness, damping, mass, slope, speed: nominal and ours, stated by nobody.
- workspace: a box in front of the motors that both legs reach well; resolution: one count of a joint at its centre, rounded up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.arm.model import ArmModel, ArmSettings, Pose
from cogrip.devices.arm.motors import CableDrive
from cogrip.devices.device import encoder_record
from cogrip.devices.haply.five_bar import FiveBar
from cogrip.devices.haply.frames import STEP_NM, Wiring
from cogrip.devices.settings import bounded
from cogrip.machine.rows import Vector

MOST_NM = 0.123  # largest torque of a motor: the firmware clamps there
MARGIN_M = 0.001  # margin of the reach, so that a leg is never stretched or folded to the last
_STEP_NM_PER_A = 1000.0 * STEP_NM  # torque constant that makes the drive's whole "milliamperes" steps of torque


@dataclass(frozen=True, slots=True, kw_only=True)
class HaplyModel(ArmModel):
    """See `ArmModel`; joints a and b, and a third that is always 0. Currents are steps of STEP_NM at the joint."""

    five_bar: FiveBar
    wiring: Wiring
    takes_torques: bool = True

    def inside(self, position: Vector) -> bool:
        """Return True if both legs reach `position` [m]."""
        return self.five_bar.in_reach(position, MARGIN_M)


Pair = tuple[float, float]


class HaplySettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys; two numbers are the joints a, b: first and second actuator of Haply's examples.

    model        which arm it is: the board does not know
    pose         how the pose is known: "stored", by `cogrip devices calibrate`; "home", whoever writes this confirms that the
                 arm stands in its home pose when it is opened first; "none", it is not known, and no force is given
    motors       where the motors are as the user looks at it: "far", as its makers show it, or "near"
    dir          +1 or -1: -1 where both encoder and motor of a joint run the other way
    motor_dir    -1 where the motor alone does
    home_deg     joint angles in the home pose [degrees]
    limit_nm     largest torque of each motor [Nm]
    peak_force_n largest force [N]
    """

    model: Literal["2diy", "2diy-metal", "pantograph"]
    pose: Pose = "stored"
    motors: Literal["far", "near"] = "far"
    dir: tuple[float, ...] = ()
    motor_dir: tuple[float, ...] = ()
    home_deg: tuple[float, ...] = ()
    limit_nm: tuple[float, ...] = ()
    peak_force_n: Annotated[float, Meta(gt=0.0, le=20.0)] | None = None


def model_of(settings: HaplySettings, where: str) -> HaplyModel:
    """The model with these keys in place. Raises DeviceError for a value that no arm has."""
    model = MODELS[settings.model]
    sense = bounded(settings.dir, 2, "dir", where, (-1.0, 1.0), whole=True)
    motor_sense = bounded(settings.motor_dir, 2, "motor_dir", where, (-1.0, 1.0), whole=True) or (1.0, 1.0)
    limit = bounded(settings.limit_nm, 2, "limit_nm", where, (0.001, MOST_NM))
    home = bounded(settings.home_deg, 2, "home_deg", where, (-360.0, 360.0)) or model.wiring.home_deg
    general = ArmSettings(
        dir=(*sense, 1.0) if sense else (),
        limit_ma=(limit[0] / STEP_NM, limit[1] / STEP_NM, min(limit) / STEP_NM) if limit else (),
        peak_force_n=settings.peak_force_n,
    )
    own = ArmModel.with_settings(model, general, where)
    assert isinstance(own, HaplyModel)
    torque_way = (motor_sense[0] * _STEP_NM_PER_A, motor_sense[1] * _STEP_NM_PER_A, _STEP_NM_PER_A)
    five_bar = replace(model.five_bar, facing=1.0 if settings.motors == "far" else -1.0)
    drive = replace(own.drive, motor_nm_per_a=torque_way)
    return replace(
        own, kinematics=five_bar, five_bar=five_bar, drive=drive, home_counts=_home_counts(own.wiring, home, own.drive)
    )


def _home_counts(wiring: Wiring, home_deg: Sequence[float], drive: CableDrive) -> Vector:
    """Counts at the home angles, not rounded: the board counts whole ones from there."""
    per_deg = wiring.counts_per_turn / 360.0
    a, b, _ = drive.direction
    return a * home_deg[0] * per_deg, b * home_deg[1] * per_deg, 0.0


def _model(
    name: str, five_bar: FiveBar, wiring: Wiring, box_m: Pair, forces_n: Pair, resolution_m: float, mass_kg: float
) -> HaplyModel:  # fmt: skip
    """Counts and torques are those of the joints, whatever is between them and the motors."""
    x, y = box_m
    box = ((-x, x), (-y, y))
    numbers = (resolution_m, mass_kg)
    record = encoder_record(
        "haply", name, box, forces_n, (500.0, 2.0), numbers, rate_hz=2000, speed_mps=1.5, latency_ticks=1
    )
    turn = wiring.counts_per_turn
    drive = CableDrive(
        counts_per_turn=(turn, turn, turn), capstan_m=(1.0, 1.0, 1.0), body_m=(1.0, 1.0, 1.0), direction=(1.0, 1.0, 1.0),
        motor_nm_per_a=(_STEP_NM_PER_A,) * 3, limit_ma=(MOST_NM / STEP_NM,) * 3, full_scale_ma=MOST_NM / STEP_NM,
    )  # fmt: skip
    return HaplyModel(
        kinematics=five_bar, drive=drive, home_counts=_home_counts(wiring, wiring.home_deg, drive), record=record,
        reach_m=five_bar.proximal_m + five_bar.distal_m, five_bar=five_bar, wiring=wiring,
    )  # fmt: skip


MODELS: dict[str, HaplyModel] = {
    "2diy": _model(
        "2diy", FiveBar(0.07, 0.09, 0.038, (0.019, 0.08)), Wiring((2, 1), (True, True), 4880.0, (168.0, 12.0)),
        (0.04, 0.06), (1.65, 0.5), 9.3e-5, 0.05,
    ),
    "2diy-metal": _model(
        "2diy-metal", FiveBar(0.07, 0.09, 0.0, (0.0, 0.08)), Wiring((2, 1), (True, False), 10752.0, (241.0, -61.0)),
        (0.04, 0.06), (1.6, 0.5), 3.6e-5, 0.08,
    ),
    "pantograph": _model(
        "pantograph", FiveBar(0.05, 0.07, 0.02, (0.01, 0.065)), Wiring((1, 2), (False, False), 13824.0, (180.0, 0.0)),
        (0.03, 0.04), (2.28, 0.7), 2.2e-5, 0.08,
    ),
}  # fmt: skip
"""Name -> model with its makers' numbers: 2DIY version 3 (plastic), version 2 (metal), and the old Pantograph."""
