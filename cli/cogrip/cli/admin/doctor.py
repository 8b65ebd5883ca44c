"""`cogrip doctor`: the punctuality of this machine, its permissions, and advice."""

import dataclasses
from collections.abc import Sequence

from rich.console import Console, Group
from rich.padding import Padding
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from cogrip.cli.session.trigger_line import measured_trigger
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.session_progress import form_line
from cogrip.machine import punctuality
from cogrip.machine.punctuality import MachineState, Punctuality
from cogrip.machine.realtime import PRIORITY

_COLOURS = {"in reach": "green", "marginal": "yellow", "out of reach": "red"}
_INTERRUPTED = 130  # exit code that a shell reports for Ctrl-C


def _machine_table(machine: MachineState) -> Table:
    """Return the machine's settings and this user's permissions."""

    def shown(value: object) -> str:
        return "not readable" if value is None else str(value)

    def allowed(permission: str) -> str:
        return f"[{'green' if permission.startswith('yes') else 'red'}]{permission}[/]"

    loopback = machine.loopback_us
    table = Table(title="This machine", title_justify="left", show_header=False, box=None, padding=(0, 2))
    table.add_row("cogrip code", form_line())
    table.add_row("kernel", machine.kernel)
    table.add_row("preemption", shown(machine.preemption))
    table.add_row("processors", f"{machine.usable_cpus} usable of {machine.cpus}")
    table.add_row("virtual machine", {True: "yes", False: "no", None: "not readable"}[machine.virtual])
    table.add_row("governor", shown(machine.governor))
    table.add_row("load, last minute", shown(machine.load_1min and round(machine.load_1min, 2)))
    table.add_row(
        "clock",
        f"{shown(machine.clock_source)}, resolution {machine.clock_resolution_ns:.0f} ns, "
        f"read in {machine.clock_read_ns:.0f} ns",
    )
    table.add_row(f"SCHED_FIFO {PRIORITY} allowed", allowed(machine.fifo_permission))
    table.add_row("memory lock allowed", allowed(machine.lock_permission))
    table.add_row("large pages of memory", allowed(machine.large_pages))
    table.add_row(
        "UDP loopback, there and back",
        f"p50 {loopback['p50']:.1f}  p99 {loopback['p99']:.1f}  max {loopback['max']:.1f} us"
        if loopback
        else "refused",
    )
    for what, instead in machine.lacks.items():
        table.add_row(f"no {what}", instead)
    return table


def _lateness_table(found: Sequence[Punctuality]) -> Table:
    """Return the lateness by rate and setup, in us."""
    table = Table(
        title="Lateness of ticks in us", title_justify="left", header_style="bold", box=None, padding=(0, 1, 0, 0)
    )
    table.add_column("rate", justify="right", no_wrap=True)
    table.add_column("setup")  # wrapped between words where a terminal is narrow
    for heading in ("p50", "p99", "p99.9", "max", "skipped"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    previous_hz = None
    for each in found:
        first = each.rate_hz != previous_hz
        if first and previous_hz is not None:
            table.add_row()
        previous_hz = each.rate_hz
        word = each.verdict
        note = f" [dim]({len(each.refused)} refused)[/]" if each.refused else ""
        table.add_row(
            f"{each.rate_hz} Hz" if first else "",
            f"{each.setup}{note}",
            *(f"{each.lateness_us[key]:.1f}" for key in ("p50", "p99", "p999", "max")),
            f"{each.skipped_share:.2%}" if each.skipped else "-",
            f"[{_COLOURS[word]}]{word}[/]",
        )
    return table


def _advice_table(advice: Sequence[str]) -> Group:
    lines = Table(show_header=False, box=None, padding=(0, 1))
    for line in advice:
        lines.add_row("-", line)
    return Group("[italic]Advice[/]", lines)


def _render(console: Console, machine: MachineState, found: Sequence[Punctuality], advice: Sequence[str]) -> None:
    if machine.busy is not None:
        console.print(f"\nmeasured under load (load average {machine.busy:.1f}): a quiet machine is more punctual")
    for part in (_machine_table(machine), _lateness_table(found), _advice_table(advice)):
        console.print(Padding(part, (1, 0, 0, 0)))
    console.print(
        "\n[dim]A row with + is plain sleep and that one measure. In reach: p99 within a quarter period and at "
        "most 0.1 % of the ticks skipped; marginal: within one period and 1 %. Each row ran in a process of "
        "its own, and only for seconds: rarer, longer latenesses than it could see exist.[/]"
    )


def doctor(*, seconds: float = 1.0, trigger: str | None = None, json: Json = None) -> int:
    """Measure what this machine can do in real time, and advise how to improve it.

    With --json - the answer is printed in place of the tables. Exit code 0 whatever was found.

    Parameters
    ----------
    seconds
        Time for which each row is measured: three rates, with and without each real-time measure.
    trigger
        Measure this trigger line instead (`cogrip serve --trigger`), or byte:pty, a pseudo-terminal without any device.
    """
    if not 0.05 <= seconds <= 600.0:
        raise BadInput(f"--seconds {seconds:g} is outside 0.05 to 600, the time for each row")
    if trigger is not None:
        if json is not None:
            raise BadInput("--json is for the machine; leave it out beside --trigger")
        for line in measured_trigger(trigger):
            make_console(soft_wrap=True).print(line)
        return 0
    console = make_console(markup=True)
    found: list[Punctuality] = []
    columns = (TextColumn("{task.description:<32}"), BarColumn(), TimeRemainingColumn())
    interrupted = False
    machine = punctuality.examine()
    # The bar redraws twice a second only: its thread would disturb what is measured.
    with Progress(*columns, console=make_console(stderr=True), transient=True, refresh_per_second=2) as progress:
        task = progress.add_task("measuring", total=len(punctuality.RATES_HZ) * len(punctuality.SETUPS))
        try:
            for each in punctuality.survey(seconds):
                found.append(each)
                progress.update(task, advance=1, description=f"{each.rate_hz} Hz, {each.setup}")
        except KeyboardInterrupt:
            interrupted = True
    machine = punctuality.after(machine)
    advice = punctuality.advise(machine, found)
    if json is not None:
        lateness = [dataclasses.asdict(each) for each in found]
        write_json({"machine": dataclasses.asdict(machine), "lateness": lateness, "advice": advice}, json)
    if json != "-":
        _render(console, machine, found, advice)
    if interrupted:
        make_console(stderr=True).print("stopped by Ctrl-C: the tables hold what was measured until then")
        return _INTERRUPTED
    return 0
