"""`cogrip compare`: the same hands under every method and on every network, and the table of it."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from cogrip.cli.runs.new_run import new_run_folder
from cogrip.cli.session.before_run import AllowUnstable, check_compared, check_plausible
from cogrip.cli.session.settings_file import load, try_hands, with_people
from cogrip.cli.study.analysis_query import Overrides
from cogrip.cli.study.methods_table import methods_table
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.json_answer import Json, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import has_width
from cogrip.protocol.io.stop import Stop, on_signals
from cogrip.protocol.settings import Settings
from cogrip.sim.experiments.folder import ExperimentFolder, FolderError
from cogrip.sim.experiments.methods.method import CLEAN, METHODS, NETWORKS, OWN, ChoiceError, choose, session_settings
from cogrip.sim.experiments.methods.query import Comparison, prepare
from cogrip.sim.experiments.methods.table import ours_failed
from cogrip.sim.experiments.runner import run_experiment
from cogrip.sim.experiments.worker_pool import LocalWorkers
from cogrip.sim.runs.folder import finite

SEEDS = 20
_PIPED_WIDTH = 160
_TELL_EVERY = 0.1  # of the whole, where there is no terminal to draw a bar on


def compare_methods(
    config: Path,
    /,
    *,
    profiles: str = ",".join(NETWORKS),
    methods: str = ",".join(METHODS),
    seeds: int = SEEDS,
    hands: Annotated[tuple[str, ...], Parameter(name="--hands", negative="")] = (),
    overrides: Overrides = (),
    allow_unstable: AllowUnstable = False,
    workers: int | None = None,
    out: Path | None = None,
    runs: Path = Path("runs"),
    json: Json = None,
) -> int:
    """Compare methods of sharing an object over networks, under the same hands: one table, plots and a report.

    Everything in the settings stays but the method, the link and the seed. In the last three tenths of each session (3 s at
    most) the hands come to rest where they began. A clean link is always run as well, to hold forces against.

    The same command with --out goes on where the last one ended. Exit code 0 once it has run, however badly others do; 1
    if `wave` diverged or was not passive, or if a session could not be run; 130 if it was interrupted.

    Parameters
    ----------
    config
        Settings file, or the name of one that comes with cogrip (`cogrip configs`); compare is made for this.
    profiles
        Networks, with commas between: names of link.profile, or `own` for [link] as the settings have it.
    methods
        Methods, with commas between: wave (ours), paper, coupling, tdpa.
    seeds
        How many sessions of each: a seed is the network's fates and the tremor of hands that tremble, the same for all methods.
    hands
        Hand of the first, second ... person in place of the settings', such as a recorded one,
        'csv:hand.csv&time=t_s&x=x_m'. Repeatable.
    workers
        Worker processes; else one for each processor.
    out
        The comparison's folder, new or to be resumed; else runs/TIME-compare-NAME.
    runs
        Folder in which that is made.
    """
    console = make_console(stderr=True, soft_wrap=True)
    asked = _prepare(config, overrides, hands, methods, profiles, seeds)
    if workers is not None and workers < 1:
        raise BadInput(f"--workers {workers} must be at least 1")
    check_compared(_sessions(asked), allow_unstable)
    folder = _folder(out or new_run_folder(runs, f"compare-{asked.base['name']}"), asked)
    if folder.finished:
        console.print(f"{len(folder.finished)} of {asked.cases} sessions are finished already, in {folder.path}")
    stop = Stop()
    with on_signals(stop), _Shown(console, asked.cases) as progress, LocalWorkers(workers, stop) as these:
        run_experiment(asked, folder, these, progress)
    return _tell(asked, folder, stop, json, console)


# The list of commands has the first paragraph; the others stand below the parameters.
_paragraphs = inspect.cleandoc(compare_methods.__doc__ or "").partition("\nParameters\n")[0].split("\n\n")
compare = App(name="compare", help_epilogue="\n\n".join(_paragraphs[1:]).strip())
compare.default(compare_methods)


def _prepare(
    config: Path, overrides: tuple[str, ...], hands: tuple[str, ...], methods: str, profiles: str, seeds: int
) -> Comparison:
    try:
        chosen = choose("method", _names(methods), tuple(METHODS))
        networks = choose("profile", _names(profiles), (*NETWORKS, CLEAN, OWN))
        settings = with_people(load(config, overrides), hands, ())
        try_hands(settings)
        check_plausible(settings)
        return prepare(settings, chosen, networks, seeds)
    except ChoiceError as error:
        raise BadInput(f"compare: {error}") from None


def _sessions(asked: Comparison) -> dict[str, Settings]:
    """One session of every method on every network."""
    return {
        f"{method} on {network}": session_settings(asked.base, method, network, asked.seeds[0])
        for method in asked.methods
        for network in asked.networks
    }


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _folder(path: Path, asked: Comparison) -> ExperimentFolder:
    try:
        return ExperimentFolder(path, asked)
    except FolderError as error:
        raise BadInput(f"--out: {error}") from None
    except OSError as error:
        raise Problem(f"--out {path}: cannot be written: {error}") from None


class _Shown:
    """A bar on a terminal; elsewhere a line now and then. Gives what to call with the number of finished sessions."""

    def __init__(self, console: Console, total: int) -> None:
        self._console, self._total, self._told = console, total, 0
        self._bar = Progress(
            TextColumn("[progress.description]{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TimeRemainingColumn(), console=console, transient=True,
        )  # fmt: skip

    def __enter__(self) -> Callable[[int], None]:
        if not self._console.is_terminal:
            return self._tell
        task = self._bar.add_task("sessions", total=self._total)
        self._bar.start()
        return lambda finished: self._bar.update(task, completed=finished)

    def __exit__(self, *ending: object) -> None:
        self._bar.stop()

    def _tell(self, finished: int) -> None:
        if finished == self._total or finished - self._told >= max(1.0, _TELL_EVERY * self._total):
            self._told = finished
            self._console.print(f"{finished} of {self._total} sessions")


def _tell(asked: Comparison, folder: ExperimentFolder, stop: Stop, json: str | None, console: Console) -> int:
    if folder.finished:
        failed = _write(asked, folder, json, console)
    else:
        console.print("no session was finished")
        failed = True
    if stop.reason:
        console.print(f"{stop.reason}: the same command with --out {folder.path} goes on from here", markup=False)
        return 130
    return 1 if failed else 0


def _write(asked: Comparison, folder: ExperimentFolder, json: str | None, console: Console) -> bool:
    """Files, table, answer. Whether a session could not be run, or ours did not hold."""
    with console.status("writing the report"):
        from cogrip.sim.experiments.methods.report import REPORT, write_outcome

        summary = write_outcome(folder.path, asked, folder.finished)
    if json:
        write_json(finite(summary), json)
    if json != "-":
        shown = make_console()
        if not has_width(shown):  # a pipe has no width of its own
            shown = make_console(width=_PIPED_WIDTH)
        shown.print(methods_table(summary))
    where = console if json == "-" else make_console(soft_wrap=True)
    where.print(f"report: {folder.path / REPORT}", markup=False)
    return bool(_failed(summary, console)) or ours_failed(summary)


def _failed(summary: Mapping[str, Any], console: Console) -> int:
    count = 0
    for row in summary["rows"]:
        count += row["failed"]
        for error, times in row["errors"].items():
            console.print(
                f"could not be run: {row['method']} on {row['network']}, {times} sessions: {error}", markup=False
            )
    return count
