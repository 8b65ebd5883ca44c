"""Trials of how a device moves under small forces: for the commands that prepare devices, and before a seat is taken."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from cogrip.cli.devices.conform import TickClock
from cogrip.cli.devices.opened_arm import termination_raised
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.devices import response
from cogrip.devices.device import Device, DeviceError, defects_named
from cogrip.devices.motor_trial import MOST_HZ, Tried, try_motors
from cogrip.devices.registry import axes_of, is_input_only, is_real, make
from cogrip.machine.realtime import engage, release

UNTRIED = ("sim:", "web:", "replay:")  # schemes of devices that have no motors
SKIPPED = "motors not tried: --no-trial"


def try_response(address: str) -> list[str]:
    """Return what the device does under small forces other than its record says (`cogrip.devices.response`).

    It is opened anew; nobody holds it. Raises DeviceError, also where its pose is not known.
    """
    with _opened(address, response.RATE_HZ) as (device, clock, _):
        return response.faults(device, clock)


def try_before_seat(address: str, say: Callable[[str], None], *, wanted: bool) -> str:
    """Try the motors of the device that is to be held, and return the outcome in words, "" for one without motors.

    Raises Problem for a device that does other than its record says, or cannot be opened.
    """
    with BadInput.of(DeviceError):
        if f"{address}:".startswith(UNTRIED) or is_input_only(address):
            return ""
    if not wanted:
        say(SKIPPED)
        return SKIPPED
    with Problem.of(DeviceError), _opened(address, MOST_HZ) as (device, clock, rate_hz):
        tried = try_motors(device, clock, rate_hz)
    _refuse(tried, address)
    say(f"{'warning: ' if tried.unknown else ''}{address}: {tried.text}")
    return tried.text


def _refuse(tried: Tried, address: str) -> None:
    """Raise Problem where something is wrong."""
    if tried.faults:
        raise Problem(
            f"refused: {address}: {tried.text}; mend it and see `cogrip devices conform`; --no-trial holds it as it is"
        )


@contextmanager
def _opened(address: str, most_hz: int) -> Iterator[tuple[Device, response.Clock, int]]:
    """Open the device at an address anew, and give it with its clock and rate. Raises DeviceError."""
    device = make(address, axes=axes_of(address))
    real = is_real(address)
    with defects_named(repr(address), "open"):
        rate_hz = min(most_hz, device.capability.rate_hz)
        device.open(rate_hz)
    clock = TickClock(rate_hz).newest if real else lambda tick: tick
    measures = engage(["gc-frozen", "fifo"]) if real else []
    try:
        with termination_raised(), defects_named(repr(address), "motion under small forces"):
            yield device, clock, rate_hz
    finally:
        device.close()
        release(measures)
