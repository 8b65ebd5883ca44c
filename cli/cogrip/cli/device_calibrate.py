"""`cogrip devices calibrate`: where the arm stands when its counters begin."""

import time
from math import degrees

from rich.console import Console

from cogrip.cli.arm_at import arm_at, wait_for_enter
from cogrip.cli.problem import Problem
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import DeviceError
from cogrip.devices.io.calibration_store import CalibrationStore


def device_calibrate(address: str, /, *, yes: bool = False) -> int:
    """Walk through the calibration of an arm, and keep it until the arm is plugged in again. No motor gets current.

    Parameters
    ----------
    address
        Device address (`cogrip devices`), as you will join with it.
    yes
        The arm stands in its home pose already: do not ask.
    """
    console = Console(highlight=False, soft_wrap=True)
    arm = arm_at(address)
    console.print(f"Home pose: {_home(arm, address)} (see docs/devices.md).", markup=False)
    if not yes:
        wait_for_enter(console, "Put the arm there and hold it still.")
    try:
        calibration = arm.calibrate(time.strftime("%Y-%m-%d %H:%M:%S"))
        path = CalibrationStore().keep(calibration)
    except DeviceError as error:
        raise Problem(str(error)) from None
    home = arm.model.kinematics.forward(arm.model.drive.angles(arm.model.home_counts))
    where = "" if home is None else f"; the tip of the home pose is at ({', '.join(f'{at:.3f}' for at in home)}) m"
    console.print(f"{calibration.model} is calibrated{where}", markup=False)
    if not calibration.stamp:
        console.print(
            "this system cannot tell when it is plugged in again, so join with the key pose=home instead, each time anew"
        )
    console.print(f"kept in {path}, until the arm is plugged in again or loses power", markup=False)
    return 0


def _home(arm: ArmDevice, address: str) -> str:
    """In words. Planar arms have no usual one: theirs is a setting."""
    if address.startswith("haply:"):
        a, b, _ = (degrees(angle) for angle in arm.model.drive.angles(arm.model.home_counts))
        return f"first link at {a:.0f}, second at {b:.0f} degrees, as the key home_deg says"
    return "turret straight ahead, upper arm vertical, forearm horizontal"
