"""`cogrip devices find`: the devices that are plugged in here."""

from cogrip.cli.terminal.output import make_console
from cogrip.devices.device import DeviceError
from cogrip.devices.io.plugged_in import FINDERS

UNKNOWN = "(no address)"


def device_find() -> int:
    """Find the devices that are plugged in here.

    The address of each force-feedback device is printed; nothing is opened.
    """
    console = make_console(soft_wrap=True)
    found = 0
    for what, finder in FINDERS.items():
        try:
            devices = finder()
        except DeviceError as error:
            console.print(f"{what}: {error}")
            continue
        for device in devices:
            found += bool(device.address)
            console.print(f"{device.address or UNKNOWN}  {device.text}")
    if not found:
        console.print(
            "none found: plug one in; on Linux it needs a udev rule (docs/devices.md). "
            "To try without one: `cogrip devices emulate`"
        )
    return 0
