"""`cogrip lab`: a whole session in virtual time."""

from pathlib import Path
from time import perf_counter

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cogrip.cli.runs.run_folder import new_run_folder
from cogrip.cli.session.network_rate import RateChoices, stated, write_choice
from cogrip.cli.session.python_worlds import PythonWorlds, allow_python_worlds
from cogrip.cli.settings.before_run import AllowUnstable, check_settings, tell_scene
from cogrip.cli.settings.settings_file import load, refuse_real, try_hands, with_people
from cogrip.cli.terminal.output import Json, make_console, write_text
from cogrip.cli.terminal.parameters import Config, Devices, Hands, Overrides, Runs
from cogrip.cli.terminal.session_progress import form_line
from cogrip.machine.compiled_files import form
from cogrip.machine.stop import Stop, on_signals
from cogrip.results.reading.folder import summary_text, write_warnings
from cogrip.results.verdict.verdict import succeeded
from cogrip.results.writing.laboratory_run import run_laboratory

LONG_S = 30.0  # length of a session from which on it is told at once which form of cogrip runs it


def lab(
    config: Config,
    /,
    *,
    overrides: Overrides = (),
    hands: Hands = (),
    device: Devices = (),
    allow_unstable: AllowUnstable = False,
    python_worlds: PythonWorlds = (),
    json: Json = None,
    runs: Runs = Path("runs"),
) -> int:
    """Run a whole session in virtual time, without sleeping.

    The cores are those of the live processes. A run folder is left, or with --json only the summary is written. Exit code 0
    only if the run was passive and stable, devices included, and nobody ended in a fault; what left the workspace, or sat at a
    device's limit and was let go, is a warning.
    """
    allow_python_worlds(python_worlds)
    rates = RateChoices(stated)
    settings = with_people(load(config, overrides, rate=rates), hands, device)
    refuse_real(settings)
    try_hands(settings)
    warnings = check_settings(settings, allow_unstable)
    tell_scene(settings)
    console = make_console(stderr=True)
    folder = None if json else new_run_folder(runs, settings.name)
    for text in rates.lines():
        console.print(text, highlight=False, soft_wrap=True)
    if settings.seconds >= LONG_S:
        console.print(form_line(), highlight=False, soft_wrap=True)
    with on_signals(Stop()) as stop, Progress(
        TextColumn("[progress.description]{task.description}"), BarColumn(), TextColumn("{task.completed:.1f} s"),
        TimeRemainingColumn(), console=console, transient=True,
    ) as progress:  # fmt: skip
        task = progress.add_task(settings.name, total=settings.seconds)
        began_s = perf_counter()
        outcome = run_laboratory(settings, folder, lambda done, _: progress.update(task, completed=done), stop)
        took_s = perf_counter() - began_s
    summary = outcome.summary
    if json:
        write_text(summary_text(summary), json)
    else:
        from cogrip.cli.runs.summary_table import terminal_summary
        from cogrip.results.report.page import write_report

        assert folder is not None
        write_choice(folder, rates.found.get(settings.name))
        write_warnings(folder, warnings)
        with console.status("writing the report"):
            report = write_report(folder)
        make_console().print(terminal_summary(summary))
        done_s = float(summary["seconds"])
        console.print(
            f"{done_s:g} s in {took_s:.1f} s: {done_s / took_s:.1f} times real time, {form()}", highlight=False
        )
        make_console().print(f"report: {report}")
    for word in ("unstable", "saturated", "left"):
        for text in getattr(outcome, word):
            console.print(f"{word}: {text}", highlight=False)
    if outcome.interrupted:
        console.print("interrupted: the summary covers what was run", highlight=False)
        return 130
    return 0 if succeeded(summary) else 1
