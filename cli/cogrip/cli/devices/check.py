"""`cogrip devices check`: the verdict on an arm before anyone holds it."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from cogrip.cli.devices.opened_arm import arm_at, termination_raised, try_line, wait_for_enter
from cogrip.cli.devices.tried_response import try_response
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import say
from cogrip.devices.arm.check import ArmFindings, VerdictRow, verdict
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.model import ArmModel
from cogrip.devices.device import DeviceError
from cogrip.devices.io.arm_check import MOST_TEST_MA, ArmCheck

MOVING_S = 5.0
MOST_MOVING_S = 600.0


def device_check(
    address: str, /, *, current_ma: float = MOST_TEST_MA, moving_s: float = MOVING_S, yes: bool = False
) -> int:
    """Check whether a device is fit to be held: signs, rate, noise, latency, and how it moves under small forces.

    Every axis of an arm is pushed with a small current, and its encoder range measured as well. The arm must be free in
    mid-range, and nobody may hold it; one that is not balanced (Polhem) hangs on a thread. Without a calibration forces are
    left out, which is said. Exit code 0 when all that was tried is well.

    Parameters
    ----------
    address
        Device address (`cogrip devices`): an arm with motors (serial:, hid:).
    current_ma
        Test current, at most 200 mA, and never more than the limit of a motor.
    moving_s
        Time for which you will move the arm through its range at the end; 0 leaves that out.
    yes
        Do not ask whether the arm is free.
    """
    console = make_console(soft_wrap=True)
    if not 0.0 < current_ma <= MOST_TEST_MA:
        raise BadInput(f"--current-ma {current_ma:g}: give more than 0 and at most {MOST_TEST_MA:g}")
    if not 0.0 <= moving_s <= MOST_MOVING_S:
        raise BadInput(f"--moving-s {moving_s:g}: give 0 to {MOST_MOVING_S:g}")
    arm = arm_at(address)
    if not arm.has_watchdog:
        raise BadInput(f"{address}: its board has no watchdog, so it is not pushed here; see docs/devices.md")
    if not yes:
        try_line(arm)
        wait_for_enter(console, "Put the arm in mid-range, take your hands off it, keep one at the power switch.")
    with Problem.of(DeviceError):
        model, measured, current_ma = _measure(arm, current_ma, moving_s, console)
    rows = verdict(measured, current_ma)
    untried = _add_response(address, rows)
    if moving_s <= 0.0:
        rows = [row for row in rows if not row.what.startswith("range")]
    say(console, f"{address}: {model.record.model}")
    console.print(rows_table(rows))
    for row in rows:
        if not row.good:
            say(console, f"{row.what}: {row.cure}")
    bad = [row.what for row in rows if not row.good]
    if untried:
        say(console, f"motion under force was not tried: {untried}")
    fit = "fit to be held" if not untried else "fit to be held as far as it was tried: calibrate it, then check again"
    say(console, fit if not bad else f"NOT fit to be held: {', '.join(bad)}")
    return 1 if bad else 0


def _add_response(address: str, rows: list[VerdictRow]) -> str:
    """Add a row for each thing that the arm does under force other than its record says. Return why it was not tried, or ""."""
    try:
        found = try_response(address)
    except DeviceError as error:
        return str(error)
    wanted = "as its record says"
    rows += [
        VerdictRow("motion under force", what, wanted, good=False, cure=cure) for what, _, cure in map(_split, found)
    ]
    if not found:
        rows.append(VerdictRow("motion under force", "along its own axes, the right way, on time", wanted, good=True))
    return ""


def _split(found: str) -> tuple[str, str, str]:
    """Return what was found, and what to do."""
    return found.rpartition(": ")


def rows_table(rows: Sequence[VerdictRow]) -> Table:
    """Return a row a measured quantity."""
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column("", no_wrap=True)
    for heading in ("measured", "found", "wanted"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        mark = Text("✓", "green") if row.good else Text("✗", "red")
        table.add_row(mark, Text(row.what), Text(row.found), Text(row.wanted))
    return table


def _measure(
    arm: ArmDevice, current_ma: float, moving_s: float, console: Console
) -> tuple[ArmModel, ArmFindings, float]:
    """Return the arm's model, the measurements, and the current that pushed it. Raises DeviceError."""
    most_ma = min(arm.model.drive.largest_ma)
    if most_ma <= 0.0:
        raise DeviceError(f"{arm.exchange.line.name}: gives no force, so there is nothing to check: it is read only")
    current_ma = min(current_ma, most_ma)
    check = ArmCheck(arm.exchange, current_ma)
    with termination_raised():
        try:
            reading = check.begin()
            model = arm.recognised(reading)
            return model, check.measured(lambda text: console.print(f"  {text}"), moving_s), current_ma
        finally:
            check.end()
