"""`cogrip devices check`: a verdict on an arm before anyone holds it."""

from rich.console import Console
from rich.table import Table

from cogrip.cli.arm_at import arm_at
from cogrip.cli.problem import BadInput, Problem
from cogrip.devices.arm.check import verdict
from cogrip.devices.device import DeviceError
from cogrip.devices.io.arm_check import MOST_TEST_MA, ArmCheck

MOVING_S = 5.0


def device_check(
    address: str, /, *, current_ma: float = MOST_TEST_MA, moving_s: float = MOVING_S, yes: bool = False
) -> int:
    """Push every axis with a small current, and measure signs, rate, latency, noise and encoder range.

    The arm must be free in mid-range, and nobody may hold it. Needs no calibration. Exit code 0 when all is well.

    Parameters
    ----------
    address
        Device address (`cogrip devices`): an arm with motors (serial:, hid:).
    current_ma
        Test current, at most 200 mA.
    moving_s
        How long you will move the arm through its range at the end; 0 leaves that out.
    yes
        Do not ask whether the arm is free.
    """
    console = Console(highlight=False, soft_wrap=True)
    if not 0.0 < current_ma <= MOST_TEST_MA:
        raise BadInput(f"--current-ma {current_ma:g}: give more than 0 and at most {MOST_TEST_MA:g}")
    arm = arm_at(address)
    if not yes:
        console.print(
            "Put the arm in mid-range, take your hands off it, keep one at the power switch. Enter to begin, Ctrl-C to leave."
        )
        input()
    check = ArmCheck(arm.exchange, current_ma)
    try:
        reading = check.begin()
        try:
            model = arm.recognised(reading)
            measured = check.measured(lambda text: console.print(f"  {text}", markup=False), moving_s)
        finally:
            check.end()
    except DeviceError as error:
        raise Problem(str(error)) from None
    rows = verdict(measured, current_ma)
    if moving_s <= 0.0:
        rows = [row for row in rows if not row.what.startswith("range")]
    table = Table(title=f"{address}: {model.record.model}")
    for column in ("", "", "found", "wanted", "what to do"):
        table.add_column(column)
    for row in rows:
        table.add_row("✓" if row.good else "✗", row.what, row.found, row.wanted, "" if row.good else row.cure)
    console.print(table)
    bad = [row.what for row in rows if not row.good]
    console.print("fit to be held" if not bad else f"NOT fit to be held: {', '.join(bad)}", markup=False)
    return 1 if bad else 0
