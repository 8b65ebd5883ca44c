"""Trials of how a device moves under small forces: for the commands that prepare devices, and before a seat is taken."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from cogrip.cli.devices.conform import TickClock
from cogrip.cli.devices.opened_arm import termination_raised
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.devices import response
from cogrip.devices.commissioning_sheet import unit_of
from cogrip.devices.device import Device, DeviceError, defects_named
from cogrip.devices.io.sheet_store import SheetStore
from cogrip.devices.motor_trial import MOST_HZ, try_motors
from cogrip.devices.registry import axes_of, is_input_only, is_real, make, record_of
from cogrip.machine.realtime import engage, release

UNTRIED = ("sim:", "web:", "replay:")  # schemes of devices that have no motors
SKIPPED = "motors not tried"


def try_response(address: str) -> list[str]:
    """Return what the device does under small forces other than its record says (`cogrip.devices.response`).

    It is opened anew; nobody holds it. Raises DeviceError, also where its pose is not known.
    """
    device = make(address, axes=axes_of(address))
    with opened_device(device, address, response.RATE_HZ, real=is_real(address)) as (clock, _):
        return response.faults(device, clock)


def try_before_seat(address: str, say: Callable[[str], None], *, wanted: bool) -> str:
    """Try the motors of the device that is to be held, and return the outcome in words, "" for one without motors.

    Raises Problem for a device that does other than its record says, or cannot be opened.
    """
    with BadInput.of(DeviceError):
        if f"{address}:".startswith(UNTRIED) or is_input_only(address):
            return ""
    with Problem.of(DeviceError):
        device = make(address, axes=axes_of(address)) if wanted else None
    sheet = read_sheet(address, say) if wanted else ""
    tried = try_device(device, address, say, "--no-trial", real=is_real(address))
    return "; ".join(filter(None, (sheet, tried)))


def read_sheet(address: str, say: Callable[[str], None]) -> str:
    """Return what the sheet of a device's commissioning says, "" where there is none. Raises Problem where it did not pass."""
    store, again = SheetStore(), f"cogrip devices commission '{address}'"
    with Problem.of(DeviceError):
        sheet = store.find(address)
        unit = unit_of(record_of(make(address, axes=axes_of(address)), address), store.calibration_of(address))
    if sheet is None:
        if is_real(address):
            say(f"warning: {address} was never commissioned: {again}")
        return ""
    if sheet.unit != unit:
        say(f"warning: record or calibration of {address} has changed since it was commissioned: {again}")
        return ""
    if sheet.faults:
        raise Problem(f"refused: {address}: {sheet.text}; mend it and {again}; --no-trial holds it as it is")
    say(f"{'' if sheet.passed else 'warning: '}{address}: {sheet.text}")
    return sheet.text


def try_device(device: Device | None, address: str, say: Callable[[str], None], option: str, *, real: bool) -> str:
    """Try the motors of a device that is not open, None: leave that out. Return the outcome in words.

    option: that leaves the trial out; real: whether the device goes on by itself, and not tick by tick. Raises Problem.
    """
    if device is None:
        say(skipped := f"{SKIPPED}: {option}")
        return skipped
    with Problem.of(DeviceError), opened_device(device, address, MOST_HZ, real=real) as (clock, rate_hz):
        tried = try_motors(device, clock, rate_hz)
    if tried.faults:
        raise Problem(
            f"refused: {address}: {tried.text}; mend it and see `cogrip devices conform`; {option} holds it as it is"
        )
    say(f"{'warning: ' if tried.unknown else ''}{address}: {tried.text}")
    return tried.text


@contextmanager
def opened_device(device: Device, address: str, most_hz: int, *, real: bool) -> Iterator[tuple[response.Clock, int]]:
    """Open a device, and give its clock and rate. Raises DeviceError."""
    with defects_named(repr(address), "open"):
        rate_hz = min(most_hz, device.capability.rate_hz)
        device.open(rate_hz)
    clock = TickClock(rate_hz).newest if real else lambda tick: tick
    measures = engage(["gc-frozen", "fifo"]) if real else []
    try:
        here = threading.current_thread() is threading.main_thread()  # signals are handled there alone
        with termination_raised() if here else nullcontext(), defects_named(repr(address), "motion under small forces"):
            yield clock, rate_hz
    finally:
        device.close()
        release(measures)
