"""`dev.py bench impaired`: whole sessions on every network, and whether each shows what it must."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, TypeVar

import msgspec
from cyclopts import Parameter
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from cogrip.cli.settings.settings_file import override
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Overrides, Workers
from cogrip.cli.terminal.problem import BadInput, at_least_one
from cogrip.cli.terminal.tables import plain_table
from cogrip.experiments.experiment import Result
from cogrip.experiments.methods.method import ChoiceError, choose
from cogrip.experiments.worker_pool import LocalWorkers
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.table import SettingsError
from cogrip.results.reading.folder import finite

from tests.bench.impaired_network.case import Job, measure_case, rest_from_s
from tests.bench.impaired_network.matrix import (
    LEAST_S,
    MOST_NPM,
    MOST_PEOPLE,
    MOST_S,
    MOST_SEEDS,
    LooseRow,
    Matrix,
    Row,
    batch,
    rows,
    wrong,
)
from tests.bench.impaired_network.room import NETWORKS
from tests.bench.targets import refuse_own

MOST_EVENTS = 10
LEAST_WIDTH = 132
ROOMS = 8  # kinds of rooms: seeds that are so far apart have the same
DRAWN = "each room is another, by its seed"
OWN = {  # of the matrix: its flags and rooms have them
    "link": "give --profiles",
    "users": "give --people; their devices and hands are drawn from the seed",
    "seed": "give --seeds",
    "seconds": "give --seconds",
    "name": "leave it out",
    "coupling.kind": "`cogrip compare` has the other methods",
    "coupling.server_step": "`cogrip compare` has the paper's",
    "coupling.stiffness_npm": "give --stiffness",
    "rates.network_hz": "the growth of loose cubes is calculated for that rate",
    "object.kind": DRAWN,
    "object.axes": DRAWN,
}
Number = TypeVar("Number", int, float)


def bench_impaired(
    *,
    profiles: str = ",".join(NETWORKS),
    people: str = "2,3,4,5",
    stiffness: Annotated[str, Parameter(name="--stiffness")] = "1000,10000,100000",
    seeds: int = 20,
    seconds: float = 8.0,
    loose_seeds: int = 5,
    overrides: Overrides = (),
    workers: Workers = None,
    json: Json = None,
) -> int:
    """Run whole sessions on every network: every one must be passive and must not diverge.

    A person who pushes with more than the device has is let go, and ends the session: that is right, and counted.

    Each seed is another room: gripped or pushed, on 1 axis or 3, with other hands, devices and rates. Besides, loose cubes
    are pushed once: virtual coupling and the paper's step must fail wherever their eigenvalues say so, and ours hold. What
    --set says is for sessions of ours alone.

    Exit code 0 if every session showed what it must, 1 if not, 130 if it was interrupted.

    Parameters
    ----------
    profiles
        Networks, with commas between: names of link.profile.
    people
        Numbers of people, with commas between.
    stiffness
        Stiffnesses K [N/m], with commas between.
    seeds
        How many rooms for each of these.
    seconds
        Virtual time of each session; in its last 3 s, or second half, hands come to rest where they began.
    loose_seeds
        How many loose cubes for each network, number of people, scheme and stiffness; 0 for none.
    """
    at_least_one("--workers", workers)
    matrix = _matrix(profiles, people, stiffness, seeds, seconds, loose_seeds, overrides)
    jobs = matrix.jobs()
    console, stop, results = make_console(soft_wrap=True, stderr=json == "-"), Stop(), dict[int, Result]()
    console.width = max(console.width, LEAST_WIDTH)  # in a file, too: no cell is cut
    with on_signals(stop), Progress(
        TextColumn("[progress.description]{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TimeRemainingColumn(), console=make_console(stderr=True), transient=True,
    ) as bar, LocalWorkers(workers, stop) as these:  # fmt: skip
        task = bar.add_task("sessions", total=len(jobs))
        for result in these.run(measure_case, jobs, batch(jobs)):
            results[result.case] = result
            bar.update(task, completed=len(results))
    return _tell([(job, results[job.case]) for job in jobs if job.case in results], len(jobs), stop, json, console)


def _matrix(
    profiles: str, people: str, stiffness: str, seeds: int, seconds: float, loose_seeds: int, overrides: Sequence[str]
) -> Matrix:
    changes = dict(override(text) for text in overrides)
    refuse_own("bench impaired", changes, OWN)
    try:
        networks = choose("profile", [name.strip() for name in profiles.split(",") if name.strip()], NETWORKS)
    except ChoiceError as error:
        raise BadInput(f"--profiles {profiles}: {error}") from None
    counts = _numbers("--people", people, int, (2, MOST_PEOPLE), "people")
    values = _numbers("--stiffness", stiffness, float, (0.0, MOST_NPM), "N/m")
    if not 1 <= seeds <= MOST_SEEDS:
        raise BadInput(f"--seeds {seeds}: at least one seed and at most {MOST_SEEDS} are run")
    if not 0 <= loose_seeds <= MOST_SEEDS:
        raise BadInput(f"--loose-seeds {loose_seeds}: from 0, for none, to {MOST_SEEDS}")
    if not LEAST_S <= seconds <= MOST_S:
        raise BadInput(f"--seconds {seconds:g}: from {LEAST_S:g} to {MOST_S:g} s")
    matrix = Matrix(networks, counts, values, tuple(range(seeds)), seconds, loose_seeds, changes)
    try:
        for job in replace(matrix, seeds=matrix.seeds[:ROOMS], loose_seeds=min(1, loose_seeds)).jobs():
            job.settings()
    except SettingsError as error:
        raise BadInput(f"--set: {error}") from None
    return matrix


def _numbers(
    flag: str, text: str, read: Callable[[str], Number], bounds: tuple[Number, Number], unit: str
) -> tuple[Number, ...]:
    """Those in `text`, none twice. Raises BadInput for one that is none or out of bounds."""
    found: dict[Number, None] = {}
    for part in text.split(","):
        try:
            value = read(part)
        except ValueError:
            value = None
        if value is None or not bounds[0] <= value <= bounds[1]:
            least, most = bounds
            raise BadInput(f"{flag} {text}: from {least:g} to {most:g} {unit}, with commas between; {part!r} is not")
        found[value] = None
    return tuple(found)


def _tell(pairs: Sequence[tuple[Job, Result]], asked: int, stop: Stop, json: str | None, console: Console) -> int:
    sessions, cubes = rows(pairs)
    failures = [(job, why) for job, result in pairs if (why := wrong(job, result))]
    seconds = pairs[0][0].seconds if pairs else 0.0
    console.print(_session_table(sessions, seconds - rest_from_s(seconds)))
    if cubes:
        console.print(_loose_table(cubes))
    for job, why in failures[:MOST_EVENTS]:
        what = f"{job.network}, {job.people} people, K = {job.stiffness_npm:g}, seed {job.seed}"
        console.print(f"✗ {what}{f', loose, {job.scheme}' if job.scheme else ''}: {why}", markup=False)
    if len(failures) > MOST_EVENTS:
        console.print(f"... and {len(failures) - MOST_EVENTS} more")
    console.print(f"{len(pairs)} of {asked} sessions run; {len(failures)} did not show what they must")
    if json:
        write_json(finite({"impaired": msgspec.to_builtins(sessions), "loose": msgspec.to_builtins(cubes)}), json)
    if stop.reason:
        return 130
    return 1 if failures or len(pairs) < asked else 0


def _session_table(sessions: Sequence[Row], rest_s: float) -> Table:
    headings = (
        "\nnetwork", "\npeople", "K\nN/m", "\nruns", "\nwrong", "let\ngo", "margin\nmJ", "views\nrms",
        "apart\nmax", "drift\nmed", "\nmax", "force\nN", "step\nN",
    )  # fmt: skip
    rows = [
        [
            row.network, f"{row.people}", f"{row.stiffness_npm:g}", f"{row.sessions}", f"{row.wrong}", f"{row.overpowered}",
            f"{row.margin_mj:.0e}", f"{row.coherence_rms_mm:.2f}", f"{row.coherence_max_mm:.1f}", f"{row.median_drift_mm:.3g}",
            f"{row.drift_mm:.2f}", f"{row.peak_force_n:.1f}", f"{row.force_step_n:.1f}",
        ]
        for row in sessions
    ]  # fmt: skip
    title = (
        f"the worst of each case, views and drift in mm; drift after {rest_s:g} s of rest, beyond that of a clean link;"
        " let go: who pushed with more than the device has"
    )
    return plain_table(headings, rows, title=title)


def _loose_table(cubes: Sequence[LooseRow]) -> Table:
    headings = (
        "\nnetwork", "\nscheme", "\npeople", "K\nN/m", "\nruns", "\nrestless", "\ndiverged", "eigen-\nvalue",
        "powers\nof ten", "\nwrong",
    )  # fmt: skip
    rows = [
        [
            row.network, row.scheme, f"{row.people}", f"{row.stiffness_npm:g}", f"{row.sessions}", f"{row.restless}",
            f"{row.diverged}", f"{row.radius:.4f}", f"{row.growth:.1f}", f"{row.wrong}",
        ]
        for row in cubes
    ]  # fmt: skip
    title = "loose cubes: largest eigenvalue of a frame, and what a session makes of it"
    return plain_table(headings, rows, left=2, title=title)
