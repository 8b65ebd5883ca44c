"""`cogrip devices commission`: the first hour with a device, and the sheet that says how it went."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import Annotated

import msgspec
from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.devices.opened_arm import drop_early_lines
from cogrip.cli.devices.tried_response import UNTRIED, opened_device
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import say
from cogrip.cli.terminal.typed_line import typed_line
from cogrip.client.commissioning import RATE_HZ, Stopped, commission
from cogrip.devices.commissioning_sheet import LOST, PUSH, Sheet, Step, unit_of
from cogrip.devices.device import Device, DeviceError
from cogrip.devices.io.sheet_store import SheetStore
from cogrip.devices.registry import axes_of, is_input_only, is_real, make, record_of
from cogrip.devices.response import Clock
from cogrip.protocol.version import VERSION

MOST_NAME = 80
LEAVE = "q"
WARNING = (
    "Nobody holds the device, it is in mid-range, free to move by 5 cm; one that falls hangs on a thread. A hand is on its "
    "power switch."
)


def device_commission(
    address: str,
    /,
    *,
    by: str = "",
    yes: bool = False,
    show: Annotated[bool, Parameter(negative="")] = False,
    json: Json = None,
) -> int:
    """Commission a device: try it from 5 % of its force upward against its record, and leave a signed sheet.

    Nobody holds it. Each step asks first: rest without force; pushes to and fro along each axis at 5, 10, 15, 30, 50, 75 and
    100 % of its peak force; a nudge under the damper of a line. The first thing that is not as its record says (sign, axis,
    gain, lateness, drag, quiet) ends it, with no force left. `cogrip join` reads the sheet: it refuses a device that did not
    pass. Exit code 0 when it passed.

    Parameters
    ----------
    address
        Device address (`cogrip devices`).
    by
        Name of whoever commissions it, for the sheet.
    yes
        Do not ask before each step.
    show
        Print the sheet that is there, and try nothing.
    """
    console = make_console(stderr=json == "-")
    store = SheetStore()
    with BadInput.of(DeviceError):
        if f"{address}:".startswith(UNTRIED) or is_input_only(address):
            raise BadInput(f"{address} has no motors: there is nothing to commission")
        device = make(address, axes=axes_of(address))
    if show:
        with Problem.of(DeviceError):
            sheet = store.find(address)
        if sheet is None:
            raise BadInput(f"{address} was never commissioned: leave --show out")
        for step in sheet.steps:
            _tell(console, step)
    else:
        if not 0 < len(by) <= MOST_NAME or not by.isprintable():
            raise BadInput(f"--by {by!r}: give the name of whoever commissions it, at most {MOST_NAME} characters")
        sheet = _tried(device, address, by, _asking(console, yes), console, store)
    say(console, f"{address}: {sheet.text}")
    if json is not None:
        write_json(
            {**_plain(sheet), "passed": sheet.passed, "tried_n": sheet.tried_n, "faults": list(sheet.faults)}, json
        )
    return 0 if sheet.passed else 1


def _plain(sheet: Sheet) -> dict[str, object]:
    found: dict[str, object] = msgspec.to_builtins(sheet)
    return found


def _asking(console: Console, yes: bool) -> Callable[[str, float], None]:
    """Return what asks before each force."""

    def allow(what: str, force_n: float) -> None:
        if yes:
            return
        drop_early_lines()
        begins = f"pushes with {force_n:.3g} N ({what})" if force_n else f"begins {what}"
        say(console, f"Enter {begins}; {LEAVE} ends.")
        console.print("> ", end="")
        try:
            answer = typed_line().strip()
        except EOFError:
            raise Stopped("nobody is there to press Enter: add --yes where a hand is on the switch") from None
        if answer == LEAVE:
            raise Stopped(f"ended by the operator before {what}")

    return allow


def _tried(
    device: Device, address: str, by: str, allow: Callable[[str, float], None], console: Console, store: SheetStore
) -> Sheet:
    """Try the device, keep the sheet and return it. Raises Problem."""
    say(console, WARNING)
    steps: list[Step] = []
    ended = ""
    with Problem.of(DeviceError):
        record = record_of(device, address)
        unit = unit_of(record, store.calibration_of(address))

        @contextmanager
        def open_device() -> Iterator[tuple[Device, Clock]]:
            held = make(address, axes=axes_of(address))
            with opened_device(held, address, RATE_HZ, real=is_real(address)) as (clock, _):
                yield held, clock

        try:
            for step in commission(record, open_device, allow):
                steps.append(step)
                _tell(console, step)
        except Stopped as why:
            ended = str(why)
        except KeyboardInterrupt:
            ended = "ended by Ctrl-C or a signal"
        except DeviceError as error:
            if not steps:  # it never opened
                raise
            steps.append(lost := Step(LOST, steps[-1].share, steps[-1].force_n, "lost", (str(error),)))
            _tell(console, lost)
        at = datetime.now(UTC).isoformat(timespec="seconds")
        sheet = Sheet(address, unit, by, at, VERSION, tuple(steps), ended)
        if not steps or _is_refused(store, sheet):
            say(console, "the sheet of before stays, if there is one: this one has no more to say")
            return sheet
        path = store.keep(sheet)
    say(console, f"sheet: {path}")
    return sheet


def _is_refused(store: SheetStore, sheet: Sheet) -> bool:
    """Return whether the sheet of before refuses the device, and this one ended without coming so far."""
    with suppress(DeviceError):
        before = store.find(sheet.device)
        return bool(before and before.unit == sheet.unit and before.faults and sheet.ended and not sheet.faults)
    return False


def _tell(console: Console, step: Step) -> None:
    mark = "✗" if step.faults else "✓" if step.what != PUSH or step.gain is not None else "·"
    where = f"{100 * step.share:.0f} % {step.axis}, {step.force_n:.3g} N" if step.what == PUSH else step.what
    say(console, f"{mark} {where}: {step.found}")
    for fault in step.faults:
        say(console, f"  {fault}")
