"""The arm at an address, for the commands that make arms ready."""

from cogrip.cli.problem import BadInput
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import axes_of, make


def arm_at(address: str) -> ArmDevice:
    """Made, not opened. Raises BadInput for what is no arm with motors and encoders of its own."""
    try:
        device = make(address, axes=axes_of(address))
    except DeviceError as error:
        raise BadInput(str(error)) from None
    if not isinstance(device, ArmDevice):
        raise BadInput(
            f"{address}: there is nothing to calibrate or check here: this is for arms on serial: and hid:, "
            "all others know their pose, or their maker's tools do"
        )
    return device
