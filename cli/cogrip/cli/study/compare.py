"""`cogrip compare`: the same hands with every method and network profile, and the table of them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.runs.run_folder import new_run_folder
from cogrip.cli.settings.before_run import AllowUnstable, check_compared, check_plausible
from cogrip.cli.settings.settings_file import load, try_hands, with_people
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Hands, Overrides, Runs, Workers
from cogrip.cli.terminal.problem import BadInput, Problem, at_least_one
from cogrip.cli.terminal.session_progress import SessionProgress
from cogrip.cli.terminal.tables import Fitted, plain_table
from cogrip.experiments.folder import ExperimentFolder, FolderError
from cogrip.experiments.methods.method import (
    CLEAN,
    METHODS,
    NETWORKS,
    OWN,
    ChoiceError,
    choose,
    methods_of,
    session_settings,
)
from cogrip.experiments.methods.query import ComparisonQuery, prepare
from cogrip.experiments.methods.table import cells, columns_of, notes, tone
from cogrip.experiments.methods.tasks import TASKS
from cogrip.experiments.runner import run_experiment
from cogrip.experiments.worker_pool import LocalWorkers
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import finite
from cogrip.results.verdict.compared_methods import failed_of_ours, failure_sentence

SEEDS = 20
_PIPED_WIDTH = 160
_STYLES = {"good": "", "warn": "yellow", "bad": "red"}  # styles of a verdict, by its tone


def compare(
    config: Path,
    /,
    *,
    profiles: str = ",".join(NETWORKS),
    methods: str | None = None,
    seeds: int = SEEDS,
    task: str | None = None,
    hands: Hands = (),
    overrides: Overrides = (),
    allow_unstable: AllowUnstable = False,
    workers: Workers = None,
    out: Path | None = None,
    runs: Runs = Path("runs"),
    json: Json = None,
) -> int:
    """Compare coupling methods under the same hands over network profiles; resumable.

    One table, plots and a report. All settings stay but the method, the link and the seed. In the last three tenths of each
    session (3 s at most) the hands come to rest where they began. A clean link is always run as well, as the reference of
    forces.

    The same command with --out continues where the last one ended. Exit code 0 once it has run, whatever the other methods
    do; 1 if one of cogrip's own (wave, tuned, local, partner) diverged, oscillated or was not passive, or if a session could
    not be run; 130 if interrupted.

    Parameters
    ----------
    config
        Settings file, or the name of one that comes with cogrip (`cogrip configs`); compare is made for this.
    profiles
        Network profiles, with commas between: names of link.profile, or `own` for [link] as the settings have it.
    methods
        Methods, with commas between: wave, tuned (ours), and partner for a cube that is held; paper, coupling, tdpa, and local
        for walls, faces and scenes; else all that the object has: paper has no scenes, local no object that is held.
    seeds
        How many sessions of each: a seed is that of the network's losses and of hand tremor, the same for all methods.
    task
        What two people do, in place of their hands in the settings: pull, opposed, together, rest, collide, let-go
        or limp
        (docs/methods.md).
    out
        The comparison's folder, new or to be resumed; else runs/TIME-compare-NAME.
    """
    console = make_console(stderr=True, soft_wrap=True)
    asked = _prepare(config, overrides, _hands_of(task, hands), methods, profiles, seeds)
    at_least_one("--workers", workers)
    check_compared(_sessions(asked), allow_unstable)
    path = out or new_run_folder(runs, f"compare-{asked.base['name']}")
    with BadInput.of(FolderError, where="--out: "), Problem.of(OSError, where=f"--out {path}: cannot be written: "):
        folder = ExperimentFolder(path, asked)
    if folder.finished:
        console.print(f"{len(folder.finished)} of {asked.cases} sessions are finished already, in {folder.path}")
    stop = Stop()
    with (
        on_signals(stop),
        SessionProgress(console, "sessions", asked.cases, len(folder.finished)) as progress,
        LocalWorkers(workers, stop) as these,
    ):
        run_experiment(asked, folder, these, progress)
    if folder.finished:
        failed = _write(asked, folder, json, console)
    else:
        console.print("no session was finished")
        failed = True
    if stop.reason:
        console.print(f"{stop.reason}: the same command with --out {folder.path} continues from here")
        return 130
    return 1 if failed else 0


def _prepare(
    config: Path, overrides: tuple[str, ...], hands: tuple[str, ...], methods: str | None, profiles: str, seeds: int
) -> ComparisonQuery:
    with BadInput.of(ChoiceError, where="compare: "):
        chosen = choose("method", _names(methods), tuple(METHODS)) if methods is not None else ()
        networks = choose("profile", _names(profiles), (*NETWORKS, CLEAN, OWN))
        settings = with_people(load(config, overrides), hands, ())
        try_hands(settings)
        check_plausible(settings)
        return prepare(settings, chosen or methods_of(settings), networks, seeds)


def _hands_of(task: str | None, hands: tuple[str, ...]) -> tuple[str, ...]:
    """Return the hands of a task, or those that are given."""
    if task is None:
        return hands
    if hands:
        raise BadInput(f"compare: --task {task} says what both hands do; leave --hands out")
    with BadInput.of(ChoiceError, where="compare: "):
        (name,) = choose("task", [task], tuple(TASKS))
    return TASKS[name].hands


def _sessions(asked: ComparisonQuery) -> dict[str, Settings]:
    """Return one session of every method on every network."""
    return {
        f"{method} on {network}": session_settings(asked.base, method, network, asked.seeds[0])
        for method in asked.methods
        for network in asked.networks
    }


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _write(asked: ComparisonQuery, folder: ExperimentFolder, json: str | None, console: Console) -> bool:
    """Write files, table, answer. Return whether a session could not be run, or a method of ours failed."""
    with console.status("writing the report"):
        from cogrip.experiments.methods.report import REPORT, write_outcome

        summary = write_outcome(folder.path, asked, folder.finished)
    if json:
        write_json(finite(summary), json)
    if json != "-":
        make_console(piped_width=_PIPED_WIDTH).print(methods_table(summary))
    where = console if json == "-" else make_console(soft_wrap=True)
    where.print(f"report: {folder.path / REPORT}")
    if failed := failed_of_ours(summary):
        console.print(f"cogrip's own method failed: {failure_sentence(failed)}")
    return bool(_not_run(summary, console)) or bool(failed)


def _not_run(summary: Mapping[str, Any], console: Console) -> int:
    count = 0
    for row in summary["rows"]:
        count += row["failed"]
        for error, times in row["errors"].items():
            where = f"{row['method']} on {row['network']}"
            console.print(f"could not be run: {where}, {times} sessions: {error}")
    return count


def methods_table(summary: Mapping[str, Any]) -> Group:
    """Return a row a method, a group a network; a verdict is red where any session was unstable or not passive.

    Where it is narrow verdicts have their own table.
    """
    tables = Fitted(
        lambda: [_table(summary, verdicts=True, numbers=True)],
        lambda: [_table(summary, verdicts=True, numbers=False), _table(summary, verdicts=False, numbers=True)],
    )
    return Group(tables, Text(""), Text("\n".join(notes(summary, "the worst are in table.md")), style="dim"))


def _table(summary: Mapping[str, Any], *, verdicts: bool, numbers: bool) -> Table:
    shown = columns_of(summary)
    columns = [f"{column.heading.replace(' ', chr(10))}\n{column.unit}" for column in shown] if numbers else []
    table = plain_table(["method", *(["verdict"] if verdicts else []), *columns], [], left=2 if verdicts else 1)
    if verdicts:
        table.columns[1].no_wrap = False
    last = None
    for row in summary["rows"]:
        if row["network"] != last:
            last = row["network"]
            table.add_row(Text(last, style="bold"))
        verdict, *values = cells(row, worst_too=False, columns=shown)
        judged = [Text(verdict, style=_STYLES[tone(row)])] if verdicts else []
        measured = map(Text, values) if numbers else ()
        table.add_row(Text(f"  {row['method']}"), *judged, *measured)
    return table
