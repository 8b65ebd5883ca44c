"""`cogrip bench concealment`: ways through gaps, on the same storm, beside a clean link."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from cogrip.cli.problem import BadInput
from cogrip.cli.settings_file import override
from cogrip.protocol.settings import resolve
from cogrip.protocol.settings_table import SettingsError
from cogrip.sim.concealment_trial import CLEAN, ROWS, Setup, Trial, drifts_mm, table, try_out
from cogrip.sim.sweep.local import processors

BEST = "elastic"
MOST_PEAK = 0.75  # of zero-fill's
MOST_DRIFT_MM = 1.0
NOTHING_J = -1e-12
LEAST_S = 6.0


def bench_concealment(
    *,
    minutes: Annotated[float, Parameter(name=["--minutes", "-m"])] = 10.0,
    people: int = 2,
    axes: Literal[1, 2, 3] = 1,
    object_kind: Literal["cube", "faces"] = "cube",
    frames: int = 8,
    seed: int = 1,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
) -> int:
    """50 % loss, 50 ms jitter, outages of 0.5 s every 3 s: each concealment under the same hands, in virtual time.

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
        Override a setting: section.key=value. Repeatable; those of the link are the storm's alone.
    """
    console = Console(highlight=False)
    changes = tuple(override(text) for text in overrides)
    setup = Setup(60.0 * minutes, people, axes, object_kind, frames, seed, overrides=changes)
    check(setup)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(len(ROWS), processors()), mp_context=context) as pool:
        trials = dict(zip(ROWS, pool.map(try_out, [setup] * len(ROWS), ROWS), strict=True))
    said = [f"{minutes:g} virtual minutes", f"{people} people", object_kind, f"{axes} axes", f"playout {frames} frames"]
    title = ", ".join([*said, f"seed {seed}", *overrides])
    shown = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    columns = (
        "",
        "peak\nN",
        "of\nzero",
        "step\nN",
        "law:\npeak N",
        "law:\nstep N",
        "drift\nmm",
        "margin\nJ",
        "leak\nJ",
    )
    for column in columns:
        shown.add_column(column, justify="right", no_wrap=True)
    clean, zero = trials[CLEAN], trials["zero"]
    for trial in trials.values():
        drifts = drifts_mm(trial, clean)
        shown.add_row(
            trial.name, f"{trial.peak_n:.2f}", f"{trial.peak_n / zero.peak_n:.2f}", f"{trial.step_n:.3f}",
            f"{trial.law_peak_n:.2f}", f"{trial.law_step_n:.3f}", f"{max(drifts, default=0.0):.2f}",
            f"{trial.least_margin_j:.0e}", f"{trial.least_leak_j:.3f}",
        )  # fmt: skip
    console.print(shown)
    recoveries = len(clean.gaps_m)
    console.print(
        f"drift: the largest of {recoveries} recoveries, against the clean link, hands at rest for 1 s or more; "
        f"{trials[BEST].missing:.1%} of the frames were not there in time"
    )
    failures = shortfalls(trials)
    for failure in failures:
        console.print(f"NOT reached: {failure}")
    if not failures:
        console.print(
            f"{BEST}: lowest in every column, {MOST_PEAK:g} of zero-fill's peak or less, drift below 1 mm, passive"
        )
    return 1 if failures else 0


def check(setup: Setup) -> None:
    """Raises BadInput for settings that cannot be."""
    if setup.seconds < LEAST_S:
        raise BadInput(
            f"--minutes {setup.seconds / 60:g}: at least {LEAST_S / 60:g}, so that there is an outage to recover from"
        )
    try:
        resolve(table(setup, BEST), dict(setup.overrides))
    except SettingsError as error:
        raise BadInput(str(error)) from None


def shortfalls(trials: dict[str, Trial]) -> list[str]:
    """What is asked for and not so."""
    best, clean, zero = trials[BEST], trials[CLEAN], trials["zero"]
    drift = max(drifts_mm(best, clean), default=0.0)
    out = []
    if best.peak_n > MOST_PEAK * zero.peak_n:
        out.append(f"a peak of {best.peak_n:.2f} N is above {MOST_PEAK:g} of zero-fill's {zero.peak_n:.2f} N")
    if drift >= MOST_DRIFT_MM:
        out.append(f"a drift of {drift:.2f} mm is not below {MOST_DRIFT_MM:g} mm")
    for name, trial in trials.items():
        if trial.diverged:
            out.append(f"{name} diverged: {trial.diverged}")
        if name in (BEST, CLEAN):
            continue
        keys = ("peak_n", "step_n", "law_peak_n", "law_step_n")
        out += [
            f"{key} of {BEST} is not below that of {name}" for key in keys if getattr(best, key) >= getattr(trial, key)
        ]
    if best.least_margin_j < NOTHING_J:
        out.append(f"a margin of {best.least_margin_j:.1e} J is below 0")
    return out
