"""`cogrip devices emulate`: an emulated device on a pseudo-terminal, faults on request."""

import os
import stat
import sys
from pathlib import Path
from typing import Literal

from rich.console import Console

from cogrip.cli.problem import BadInput, Problem
from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.machines import MACHINES, make_firmware
from cogrip.devices.io.pseudo_terminal import PseudoTerminal
from cogrip.devices.settings import parse_address
from cogrip.protocol.io.realtime import engage, release
from cogrip.protocol.io.stop import Stop, on_signals

_DEFAULTS = {"serial": "vintage", "haply": "2diy"}


def device_emulate(
    kind: Literal["serial", "haply"],
    /,
    *,
    model: str = "",
    hand: str = "reach",
    powered_at_m: tuple[float, float, float] | None = None,
    seed: int = 1,
    link: Path | None = None,
    fast: bool = True,
) -> int:
    """Behave as a device's firmware does, with the arm's mechanics and a hand behind it, until Ctrl-C.

    Lines on its input are verbs: silence, garbage, split, merge, short, slow, stale, model, jump, stuck, unplug, deaf,
    each with its seconds (`silence 0.3`; for ever without); mend; press (the calibrate button); status; quit.

    Parameters
    ----------
    kind
        Which wire: serial (hfab) or haply.
    model
        Which machine; vintage or 2diy if not given.
    hand
        What holds it, with its keys and those of sim:phantom: 'reach&amplitude_m=0.02&x0_m=0,0,0.01'.
    powered_at_m
        Where the tip was when the arm was powered up: X Y Z; in its home pose if not given.
    seed
        Of garbage.
    link
        Make a symbolic link of this name to the pseudo-terminal, also when it changes.
    fast
        Ask the system for real-time scheduling.
    """
    name = model or _DEFAULTS[kind]
    known = [known for known, machine in MACHINES.items() if machine.scheme == kind]
    if name not in known:
        raise BadInput(f"--model {name!r}: {kind} has {', '.join(known) or 'none'}")
    if link is not None and link.exists() and not link.is_symlink():
        raise BadInput(f"--link {link}: is there already and no link; name another one, it would be replaced")
    console = Console(highlight=False, soft_wrap=True)
    try:
        firmware = make_firmware(name, parse_address(f"sim:phantom?hand={hand}").query, seed, powered_at_m)
    except DeviceError as error:
        raise BadInput(str(error)) from None
    terminal = PseudoTerminal(firmware, link, lambda text: console.print(text, markup=False))
    keys = "?pose=home" if kind == "serial" else f"?model={name}&pose=home"  # a Haply board does not say what it is
    pose = f"its counters are zero in the home pose: join it with {keys}"
    if powered_at_m is not None:
        pose = "it was powered up elsewhere than in its home pose, so its pose is not known"
    stop = Stop()
    with on_signals(stop):
        try:
            terminal.plug()
        except OSError as error:
            where = f"--link {link}: cannot be made: " if link is not None else "no pseudo-terminal: "
            raise Problem(f"{where}{error.strerror}; name another place") from None
        measures = engage(["gc-frozen", "fifo"]) if fast else []
        try:
            console.print(f"{name} behind {kind}:{link or terminal.path}; {pose}", markup=False)
            terminal.run(_verbs(), lambda: bool(stop.reason))
        finally:
            release(measures)
    return 0


def _verbs() -> int | None:
    """The input, where somebody may write to it: a terminal or a pipe."""
    try:
        descriptor = sys.stdin.fileno()
        return descriptor if os.isatty(descriptor) or stat.S_ISFIFO(os.fstat(descriptor).st_mode) else None
    except (AttributeError, OSError, ValueError):
        return None
