"""`dev.py bench concealment`: packet loss concealments on the same impaired network, and a clean link."""

from typing import Annotated, Literal

from cyclopts import Parameter
from rich.box import SIMPLE_HEAD
from rich.table import Table

from cogrip.cli.settings.settings_file import override
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.experiments.worker_pool import LocalWorkers, processors
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.table import SettingsError

from tests.bench.concealment_trial import CLEAN, ROWS, Job, Setup, Trial, drifts_mm, measure_row, table
from tests.bench.targets import refuse_own

BEST = "elastic"
MOST_PEAK = 0.75  # of zero-fill's
MOST_DRIFT_MM = 1.0
NOTHING_J = -1e-12
LEAST_S, FULL_S, MOST_S = 6.0, 600.0, 6e5
KEYS = ("peak_n", "law_peak_n", "law_step_n")  # at the motor the limit of slopes makes all largest steps alike
OWN = {  # of the rows, or of flags
    "coupling.kind": "concealment is of waves alone",
    "playout.concealment": "there is a row of each",
    "playout.tank_mj": "the rows have their own",
    "playout.frames": "give --frames",
    "object.kind": "give --object-kind",
    "object.axes": "give --axes",
    "users": "give --people; their hands rest where recoveries are judged",
    "seed": "give --seed",
    "seconds": "give --minutes",
    "name": "leave it out",
}


def bench_concealment(
    *,
    minutes: Annotated[float, Parameter(name=["--minutes", "-m"])] = 10.0,
    people: int = 2,
    axes: Literal[1, 2, 3] = 1,
    object_kind: Literal["cube", "faces"] = "cube",
    frames: int | Literal["auto"] = 8,
    seed: int = 1,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
) -> int:
    """50 % loss, 50 ms jitter, outages of 0.5 s every 3 s: each concealment under the same hands, in virtual time.

    Exit code 0 if elastic, the default, reaches what is asked for, 1 if not, 130 if it was interrupted.

    Parameters
    ----------
    minutes
        Virtual time of each row.
    people
        How many hold the object.
    axes
        Axes of the object.
    object_kind
        What they hold.
    frames
        Playout depth.
    seed
        Of the network's chance.
    overrides
        Override a setting: section.key=value. Repeatable; the link keeps its own.
    """
    console = make_console()
    changes = tuple(override(text) for text in overrides)
    setup = Setup(60.0 * minutes, people, axes, object_kind, frames, seed, overrides=changes)
    check(setup)
    stop = Stop()
    trials = _run(setup, stop)
    if stop.reason:
        make_console(stderr=True).print(f"{stop.reason}: nothing is reported without all {len(ROWS)} rows")
        return 130
    said = [f"{minutes:g} virtual minutes", f"{people} people", object_kind, f"{axes} axes", f"playout {frames} frames"]
    title = ", ".join([*said, f"seed {seed}", *overrides])
    shown = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    columns = (
        "", "peak\nN", "of\nzero", "step\nN", "law:\npeak N", "law:\nstep N", "drift\nmm", "deficit\nmm", "margin\nJ",
        "leak\nJ",
    )  # fmt: skip
    for column in columns:
        shown.add_column(column, justify="right", no_wrap=True)
    clean, zero = trials[CLEAN], trials["zero"]
    for trial in trials.values():
        of_zero = f"{trial.peak_n / zero.peak_n:.2f}" if zero.peak_n else "-"
        drifts = drifts_mm(trial, clean)
        shown.add_row(
            trial.name, f"{trial.peak_n:.2f}", of_zero, f"{trial.step_n:.3f}",
            f"{trial.law_peak_n:.2f}", f"{trial.law_step_n:.3f}", f"{max(drifts, default=0.0):.2f}",
            f"{1e3 * trial.deficit_m:.2f}",
            f"{trial.least_margin_j:.0e}", f"{trial.least_leak_j:.3f}",
        )  # fmt: skip
    console.print(shown)
    recoveries = len(clean.gaps_m)
    console.print(
        f"drift: the largest of {recoveries} recoveries, against the clean link, hands at rest for 1 s or more, with what the "
        "object still swings; deficit: the displacement that lines had lost by then and not compensated; "
        f"{trials[BEST].missing:.1%} of the frames were not there in time"
    )
    failures = shortfalls(trials, setup.seconds)
    for failure in failures:
        console.print(f"NOT reached: {failure}")
    if not failures:
        console.print(
            f"{BEST}: of all concealments the lowest in both peaks and both steps, {MOST_PEAK:g} of zero-fill's peak or less, "
            f"drift below {MOST_DRIFT_MM:g} mm, passive"
        )
    return 1 if failures else 0


def check(setup: Setup) -> None:
    """Raises BadInput for settings that cannot be."""
    refuse_own("bench concealment", dict(setup.overrides), OWN)
    if not LEAST_S <= setup.seconds <= MOST_S:
        raise BadInput(
            f"--minutes {setup.seconds / 60:g}: from {LEAST_S / 60:g}, so that there is an outage to recover from, "
            f"to {MOST_S / 60:g}"
        )
    if setup.people < 1:
        raise BadInput(f"--people {setup.people}: at least 1")
    try:
        resolve(table(setup, BEST), dict(setup.overrides))
    except SettingsError as error:
        raise BadInput(str(error)) from None


def _run(setup: Setup, stop: Stop) -> dict[str, Trial]:
    """Rows by name, in their order; none of them once `stop` is set. Raises Problem for one that could not be run."""
    jobs = [Job(number, setup, name) for number, name in enumerate(ROWS)]
    with on_signals(stop), LocalWorkers(min(len(ROWS), processors()), stop) as workers:
        results = {result.case: result for result in workers.run(measure_row, jobs)}
    if stop.reason:
        return {}
    for case, result in sorted(results.items()):
        if result.error:
            raise Problem(f"{ROWS[case]}: could not be run: {result.error}")
    return {name: results[number].measures["trial"] for number, name in enumerate(ROWS)}


def shortfalls(trials: dict[str, Trial], seconds: float = FULL_S) -> list[str]:
    """Return the targets that are missed. seconds: virtual time of each row; a target of ten minutes is reported as such."""
    best, clean, zero = trials[BEST], trials[CLEAN], trials["zero"]
    drift = max(drifts_mm(best, clean), default=0.0)
    out = []
    if best.peak_n > MOST_PEAK * zero.peak_n:
        short = f"; {MOST_PEAK:g} is asked of {FULL_S / 60:g} minutes: give --minutes {FULL_S / 60:g}"
        out.append(
            f"a peak of {best.peak_n:.2f} N is above {MOST_PEAK:g} of zero-fill's {zero.peak_n:.2f} N"
            + (short if seconds < FULL_S else "")
        )
    if drift >= MOST_DRIFT_MM:
        out.append(f"a drift of {drift:.2f} mm is not below {MOST_DRIFT_MM:g} mm")
    for name, trial in trials.items():
        if trial.diverged:
            out.append(f"{name} diverged: {trial.diverged}")
        if name in (BEST, CLEAN):
            continue
        out += [
            f"{key} of {BEST} is not below that of {name}" for key in KEYS if getattr(best, key) >= getattr(trial, key)
        ]
    if best.least_margin_j < -best.lent_j + NOTHING_J:
        out.append(f"a margin of {best.least_margin_j:.1e} J is below that of the credit, {-best.lent_j:.1e} J")
    return out
