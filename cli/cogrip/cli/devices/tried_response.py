"""Trial of how a device moves under small forces, for the commands that prepare devices."""

from cogrip.cli.devices.conform import Clock
from cogrip.cli.devices.opened_arm import termination_raised
from cogrip.devices import response
from cogrip.devices.device import defects_named
from cogrip.devices.registry import axes_of, is_real, make
from cogrip.protocol.io.realtime import engage, release


def try_response(address: str) -> list[str]:
    """Return what the device does under small forces other than its record says (`cogrip.devices.response`).

    It is opened anew; nobody holds it. Raises DeviceError, also where its pose is not known.
    """
    device = make(address, axes=axes_of(address))
    real = is_real(address)
    clock = Clock(response.RATE_HZ).newest if real else lambda tick: tick
    with defects_named(repr(address), "open"):
        device.open(response.RATE_HZ)
    measures = engage(["gc-frozen", "fifo"]) if real else []
    try:
        with termination_raised():
            return response.faults(device, clock)
    finally:
        device.close()
        release(measures)
