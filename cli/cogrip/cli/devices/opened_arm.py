"""The arm at an address, for the commands that make arms ready, and what they have in common: asking, and ending well."""

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
    """Made, not opened. Raises BadInput for what is no arm with motors and encoders of its own."""
    try:
        device = make(address, axes=axes_of(address))
    except DeviceError as error:
        raise BadInput(str(error)) from None
    if not isinstance(device, ArmDevice):
        raise BadInput(
            f"{address}: there is nothing to calibrate or check here: this is for arms on serial:, haply: and hid:, "
            "all others know their pose, or their maker's tools do; `cogrip devices conform` tries any driver"
        )
    return device


def wait_for_enter(console: Console, text: str) -> None:
    """Raises Problem where nobody can press it."""
    console.print(f"{text} Enter when it is so, Ctrl-C to leave.", markup=False)
    try:
        input()
    except EOFError:
        raise Problem("nobody is there to press Enter: add --yes once the arm is as described") from None


@contextmanager
def termination_raised() -> Iterator[None]:
    """While inside, SIGTERM and a closed terminal are what Ctrl-C is: whoever pushes an arm lets go before it ends."""

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    numbers = [signal.SIGTERM, *([signal.SIGHUP] if sys.platform != "win32" else [])]
    before = [(number, signal.signal(number, end)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
