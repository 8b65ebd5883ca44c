"""The arms the Force Dimension SDK drives: their records, and the numbers by which the SDK tells them apart.

Sources: type numbers as in forcedimension-core 1.0, those of delta.6 and sigma.6+, which it does not know, as in the SDK's
dhdc.h; forces, stiffness, damping and workspace radius as CHAI3D states them (CDeltaDevices.cpp), those of sigma.3 and lambda
being the sigma.7's; so are torques and grippers, and that the wrists of omega.6 and omega.7 have no motors. Resolutions are
data sheet figures; apparent masses, the Falcon's continuous force, and what else is said of wrists and grippers are guesses.
"""

from dataclasses import replace

from cogrip.devices.device import SLEW_NPS, Capability, DeviceError, Gripper, Rotation, encoder_record
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES

GRIP_M = (0.0, 0.03)  # range of a gripper's opening; data sheets say 25 to 27 mm
CAUTIOUS = "falcon"  # model whose record serves where none is stated: the weakest


RECORDS = {
    model: replace(
        encoder_record(
            "forcedimension",
            model,
            ((-r, r),) * 3,
            force_n,
            limits,
            numbers,
            rate_hz=2048 if model == CAUTIOUS else 4096,
        ),
        buttons=4 if model == CAUTIOUS else 1,
        gives_orientation=model[-1] in "67",
        grip_m=GRIP_M if model[-1] == "7" else None,
    )
    for model, r, force_n, limits, numbers in (
        ("falcon", 0.04, (8.0, 4.0), (3000.0, 20.0), (6e-5, 0.15)),
        ("omega3", 0.075, (12.0, 12.0), (5000.0, 30.0), (1e-5, 0.2)),
        ("omega6", 0.075, (12.0, 12.0), (5000.0, 30.0), (1e-5, 0.25)),
        ("omega7", 0.075, (12.0, 12.0), (5000.0, 30.0), (1e-5, 0.25)),
        ("delta3", 0.15, (20.0, 20.0), (5000.0, 30.0), (2e-5, 0.25)),
        ("delta6", 0.15, (20.0, 20.0), (5000.0, 30.0), (2e-5, 0.25)),
        ("sigma3", 0.075, (12.0, 12.0), (4000.0, 30.0), (1e-5, 0.25)),
        ("sigma6", 0.09, (12.0, 12.0), (4000.0, 30.0), (1e-5, 0.3)),
        ("sigma7", 0.075, (12.0, 12.0), (4000.0, 30.0), (1e-5, 0.3)),
        ("lambda3", 0.075, (12.0, 12.0), (4000.0, 30.0), (1e-5, 0.25)),
        ("lambda7", 0.075, (12.0, 12.0), (4000.0, 30.0), (1e-5, 0.3)),
    )
}
"""See `encoder_record`. The SDK's velocity is an average over 20 ms; the client's estimator is chosen for the encoders."""


WRISTS = ("delta6", "sigma6", "sigma7", "lambda7")  # models with motors at the wrist
GRIPPERS = ("omega7", "sigma7", "lambda7")
WRIST = Rotation(
    peak_torque_nm=0.2, continuous_torque_nm=0.1, damping_nms=0.02, slew_nmps=20.0, speed_radps=15.0, resolution_rad=2e-4,
    apparent_inertia_kgm2=2e-4,
)  # fmt: skip
GRIPPER = Gripper(
    peak_force_n=8.0, continuous_force_n=4.0, damping_nspm=10.0, slew_nps=SLEW_NPS, speed_mps=1.0, resolution_m=1e-5,
    apparent_mass_kg=0.05,
)  # fmt: skip


_NEEDED = {POSE_AXES: (WRISTS, "wrist with motors"), GRIP_AXES: (GRIPPERS, "gripper with force")}
"""Number of axes -> the models that have so many, and the part that gives them."""


def axes_of(model: str) -> int:
    """Return the number of axes of a model, of which a wrist and a gripper are not had at once."""
    return POSE_AXES if model in WRISTS else GRIP_AXES if model in GRIPPERS else PLACES


def record_of(model: str, axes: int, where: str) -> Capability:
    """Return the record of a model with so many axes. Raises DeviceError for motors that it has not."""
    record = RECORDS[model or CAUTIOUS]
    if axes in _NEEDED:
        known, what = _NEEDED[axes]
        if model not in known:
            named = f"model={model} has no" if model else "no model is stated, and not each has a"
            such = ", ".join(known)
            raise DeviceError(f"{where}: axes={axes} is out of 1 to {PLACES}: {named} {what}; such are {such}")
    if axes == POSE_AXES:
        return replace(record, axes=axes, rotation=WRIST)
    return replace(record, axes=axes, gripper=GRIPPER) if axes == GRIP_AXES else record.first(axes)


TYPES = {
    33: "omega3",
    34: "omega6",
    36: "omega6",
    35: "omega7",
    37: "omega7",
    60: "falcon",
    63: "delta3",
    64: "delta6",
    104: "sigma7",
    105: "sigma7",
    106: "sigma6",
    107: "sigma6",
    108: "lambda7",
    109: "lambda7",
    203: "lambda3",
    206: "sigma3",
}
"""dhdGetSystemType -> model; left and right hands are two numbers."""


def confirm(number: int, stated: str, where: str) -> str:
    """Return the model of a type. Raises DeviceError for a device of an unknown model, or of another one than `stated`."""
    model = TYPES.get(number)
    if model is None:
        raise DeviceError(f"{where}: it is of type {number}, which is not known; known are {', '.join(RECORDS)}")
    if stated and model != stated:
        raise DeviceError(
            f"{where}: it is model={model}, not {stated}; correct the key model, or the number of the device"
        )
    return model


def with_handle(record: Capability, model: str) -> Capability:
    """Return the record with buttons, orientation and gripper of this model."""
    own = RECORDS[model]
    return replace(record, buttons=own.buttons, gives_orientation=own.gives_orientation, grip_m=own.grip_m)
