"""Arm at an address for the commands that prepare arms, with their prompt and their safe end."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console

from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import axes_of, make


def arm_at(address: str) -> ArmDevice:
    """Return the arm, not opened. Raises BadInput for a device that is no arm with motors and encoders of its own."""
    with BadInput.of(DeviceError):
        device = make(address, axes=axes_of(address))
    if not isinstance(device, ArmDevice):
        raise BadInput(
            f"{address}: there is nothing to calibrate or check here: this is for arms on serial:, haply: and hid:, "
            "all others know their pose, or their maker's tools do; `cogrip devices conform` tests any driver"
        )
    return device


def wait_for_enter(console: Console, text: str) -> None:
    """Ask for Enter. Raises Problem where nobody can press it."""
    console.print(f"{text} Enter when it is so, Ctrl-C to leave.")
    try:
        input()
    except EOFError:
        raise Problem("nobody is there to press Enter: add --yes once the arm is as described") from None


@contextmanager
def termination_raised() -> Iterator[None]:
    """Handle SIGTERM and a closed terminal as Ctrl-C, so that no arm is pushed any more when the process ends."""

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    numbers = [signal.SIGTERM, *([signal.SIGHUP] if sys.platform != "win32" else [])]
    before = [(number, signal.signal(number, end)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
