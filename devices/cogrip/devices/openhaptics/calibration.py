"""No force before the library says that it knows the arm's pose.

    needs update --auto or inkwell--> update, ask again        needs manual input --> the user's turn        ok --> go on

An encoder reset is never done here: it declares whatever pose the arm is in to be the home pose.
"""

from typing import Protocol

from cogrip.devices.device import DeviceError

OK, NEEDS_UPDATE, NEEDS_MANUAL_INPUT = 0x5000, 0x5001, 0x5002
ENCODER_RESET, AUTO, INKWELL = 1, 2, 4
TRIES = 200  # each takes a frame, a millisecond

BY_HAND = {
    AUTO: "move the arm slowly through its workspace",
    INKWELL: "put the stylus into the inkwell and leave it there",
    ENCODER_RESET: "bring all links to right angles and reset its encoders with the vendor's program",
}


class Calibrated(Protocol):
    """Calibration functions of a device. Each may raise DeviceError."""

    where: str

    def calibration(self) -> int: ...
    def calibration_styles(self) -> int: ...
    def update_calibration(self, style: int) -> None: ...


def calibrate(device: Calibrated) -> None:
    """Have the library calibrate the arm as far as it can on its own. Raises DeviceError where a hand is needed."""
    styles = device.calibration_styles()
    style = next((each for each in (AUTO, INKWELL) if styles & each), 0)
    state = device.calibration()
    for _ in range(TRIES):
        if state == OK:
            return
        if state != NEEDS_UPDATE or not style:
            break
        device.update_calibration(style)
        state = device.calibration()
    what = {NEEDS_UPDATE: "needs to be calibrated", NEEDS_MANUAL_INPUT: "needs to be calibrated by hand"}.get(
        state, f"is in an unknown state of calibration (0x{state:x})"
    )
    raise DeviceError(f"{device.where}: {what}: {BY_HAND[style or ENCODER_RESET]}, then open it again")
