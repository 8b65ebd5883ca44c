"""Arm at an address for the commands that prepare arms, with their prompt and their safe end."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console

from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.typed_line import typed_line
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import axes_of, is_input_only, make
from cogrip.machine.platform import system


def arm_at(address: str) -> ArmDevice:
    """Return the arm, not opened. Raises BadInput for a device that is no arm with motors and encoders of its own."""
    with BadInput.of(DeviceError):
        device = make(address, axes=axes_of(address))
        input_only = is_input_only(address)
    if input_only:
        raise BadInput(
            f"{address} is input only: it has no motors, so there is nothing to calibrate or check; join with it"
        )
    if not isinstance(device, ArmDevice):
        raise BadInput(
            f"there is nothing to calibrate or check here: {address} is none of the arms on serial:, haply: and hid:; "
            "all others know their pose, or their maker's tools do; `cogrip devices conform` tests any driver"
        )
    return device


def try_line(arm: ArmDevice) -> None:
    """Open the port of an arm and close it again, so that nobody prepares one that is not there. Raises Problem."""
    with Problem.of(DeviceError):
        arm.exchange.line.open()
    arm.exchange.line.close()


def drop_early_lines() -> None:
    """Drop the lines that wait at the terminal: an Enter from before a question allows no force. Those of a pipe stay."""
    while system.typed():
        pass


def wait_for_enter(console: Console, text: str) -> None:
    """Ask for Enter, a new one at a terminal. Raises Problem where nobody can press it."""
    drop_early_lines()
    console.print(f"{text} Enter when it is so, Ctrl-C to leave.")
    try:
        typed_line()
    except EOFError:
        raise Problem("nobody is there to press Enter: add --yes once the arm is as described") from None


@contextmanager
def termination_raised() -> Iterator[None]:
    """Handle SIGTERM and a closed terminal as Ctrl-C, so that no arm is pushed any more when the process ends."""

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = [(number, signal.signal(number, end)) for number in system.TERMINATION_SIGNALS]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
