"""The arms the Force Dimension SDK drives: their records, and the numbers by which the SDK tells them apart.

Sources: type numbers as in forcedimension-core 1.0; forces, stiffness, damping and workspace radius as CHAI3D states them
(CDeltaDevices.cpp), those of sigma.3 and lambda being the sigma.7's. Resolutions are data sheet figures; apparent masses and
the Falcon's continuous force are guesses.
"""

from cogrip.devices.device import SLEW_NPS, SPEED_MPS, Capability, DeviceError

CAUTIOUS = "falcon"  # the record of a device whose model is not stated: the weakest


def _record(
    model: str, radius_m: float, force_n: tuple[float, float], limits: tuple[float, float], *, res_m: float, kg: float
) -> Capability:
    """force_n: (peak, continuous); limits: (stiffness [N/m], damping [N s/m])."""
    return Capability(
        family="forcedimension",
        model=model,
        axes=3,
        workspace_m=((-radius_m, radius_m),) * 3,
        peak_force_n=force_n[0],
        continuous_force_n=force_n[1],
        stiffness_npm=limits[0],
        damping_nspm=limits[1],
        slew_nps=SLEW_NPS,
        speed_mps=SPEED_MPS,
        resolution_m=res_m,
        apparent_mass_kg=kg,
        rate_hz=2048 if model == "falcon" else 4096,
        gives_velocity=False,  # the SDK's is an average over 20 ms; the client's estimator is chosen for the encoders
    )


RECORDS = {
    record.model: record
    for record in (
        _record("falcon", 0.04, (8.0, 4.0), (3000.0, 20.0), res_m=6e-5, kg=0.15),
        _record("omega3", 0.075, (12.0, 12.0), (5000.0, 30.0), res_m=1e-5, kg=0.2),
        _record("omega6", 0.075, (12.0, 12.0), (5000.0, 30.0), res_m=1e-5, kg=0.25),
        _record("omega7", 0.075, (12.0, 12.0), (5000.0, 30.0), res_m=1e-5, kg=0.25),
        _record("delta3", 0.15, (20.0, 20.0), (5000.0, 30.0), res_m=2e-5, kg=0.25),
        _record("sigma3", 0.075, (12.0, 12.0), (4000.0, 30.0), res_m=1e-5, kg=0.25),
        _record("sigma7", 0.075, (12.0, 12.0), (4000.0, 30.0), res_m=1e-5, kg=0.3),
        _record("lambda3", 0.075, (12.0, 12.0), (4000.0, 30.0), res_m=1e-5, kg=0.25),
        _record("lambda7", 0.075, (12.0, 12.0), (4000.0, 30.0), res_m=1e-5, kg=0.3),
    )
}

TYPES = {
    33: "omega3",
    34: "omega6",
    36: "omega6",
    35: "omega7",
    37: "omega7",
    60: "falcon",
    63: "delta3",
    104: "sigma7",
    105: "sigma7",
    108: "lambda7",
    109: "lambda7",
    203: "lambda3",
    206: "sigma3",
}
"""dhdGetSystemType -> model; left and right hands are two numbers."""


def confirm(number: int, stated: str, where: str) -> None:
    """Raises DeviceError for a device of an unknown model, or of another one than `stated`."""
    model = TYPES.get(number)
    if model is None:
        raise DeviceError(f"{where}: it is of type {number}, which is not known; known are {', '.join(RECORDS)}")
    if stated and model != stated:
        raise DeviceError(
            f"{where}: it is model={model}, not {stated}; correct the key model, or the number of the device"
        )
