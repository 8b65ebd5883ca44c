"""`cogrip sweep`: sessions, or their linear models, over a grid of settings."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.settings.before_run import check_plausible
from cogrip.cli.settings.settings_file import load, try_hands
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Config, Overrides
from cogrip.cli.terminal.parameters import Workers as WorkerCount
from cogrip.cli.terminal.problem import BadInput, Problem, at_least_one
from cogrip.cli.terminal.session_progress import SessionProgress
from cogrip.experiments.experiment import Workers
from cogrip.experiments.folder import ExperimentFolder, FolderError
from cogrip.experiments.ray_cluster import ClusterError, RayWorkers
from cogrip.experiments.runner import CasesRun, run_experiment
from cogrip.experiments.sweep.grid import GridError, parse_axis
from cogrip.experiments.sweep.measures import MeasureError, defaults, needs_session
from cogrip.experiments.sweep.picture import draw_measure
from cogrip.experiments.sweep.query import Sweep, prepare
from cogrip.experiments.worker_pool import LocalWorkers
from cogrip.machine.addition import add_integers
from cogrip.machine.stop import Stop, on_signals
from cogrip.results.plots.style import NotDrawnError, png

MOST_PICTURES = 12


def sweep(
    config: Config,
    /,
    *,
    vary: Annotated[tuple[str, ...], Parameter(negative="")],
    measure: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    overrides: Overrides = (),
    out: Path | None = None,
    workers: Annotated[WorkerCount, Parameter(name=["--workers", "--jobs"])] = None,
    json: Json = None,
    cluster: Literal["ray"] | None = None,
    address: str = "",
) -> int:
    """Run sessions, or their linear models, over a grid of settings; resumable.

    A case for every combination of values; table.csv, and a heat map for each measure. The same command again continues
    where the last one ended: no finished case is run twice. Exit code 0 if every case could be run, 1 if some failed, 130 if
    it was interrupted.

    Parameters
    ----------
    vary
        A setting and its values: key=first:last:count, key=first:last:countlog, or key=value,value. Repeatable.
    measure
        What to read of each case: a path into summary.json (users.0.peak_force_n, users.*.peak_force_n), or a number
        of the lifted model (lifted.radius_without_structural, lifted.stable, lifted.largest_stable_stiffness_npm,
        lifted.felt_stiffness_npm, ...), for which no session is run. Repeatable. Else verdict, forces, margins, travel; of a
        scene lift, slip and contact force too.
    out
        The sweep's folder; else `sweeps/<name>-<digest>`, the digest being that of the query.
    cluster
        Run the cases on a Ray cluster instead (needs the extra `cluster`).
    address
        The cluster's address; else $RAY_ADDRESS, else a new one on this machine.
    """
    console = make_console(stderr=True, soft_wrap=True)
    asked = _prepare(config, overrides, vary, measure)
    stop = Stop()
    pool = _pool(cluster, address, workers, stop)
    path = out or Path("sweeps") / f"{asked.grid.base['name']}-{asked.digest}"
    with BadInput.of(FolderError, where="--out: "), Problem.of(OSError, where=f"--out {path}: cannot be written: "):
        folder = ExperimentFolder(path, asked)
    if folder.finished:
        console.print(f"{len(folder.finished)} of {asked.grid.cases} cases are finished already, in {folder.path}")
    with (
        on_signals(stop),
        SessionProgress(console, "cases", asked.grid.cases, len(folder.finished)) as progress,
        Problem.of(ClusterError),
        pool as these,
    ):
        report = run_experiment(asked, folder, these, progress)
    return _report(report, folder.path, _draw(asked, folder, console), stop, json, console)


def _prepare(config: Path, overrides: tuple[str, ...], vary: tuple[str, ...], measure: tuple[str, ...]) -> Sweep:
    settings = load(config, overrides)
    measure = measure or defaults(settings)
    with BadInput.of(GridError, MeasureError):
        axes = [parse_axis(text) for text in vary]
        if needs_session(measure):
            try_hands(settings)
            check_plausible(settings)
        return prepare(settings, axes, measure)


def _pool(cluster: str | None, address: str, workers: int | None, stop: Stop) -> AbstractContextManager[Workers]:
    at_least_one("--workers", workers)
    if cluster:
        return RayWorkers(address, stop)
    if address:
        raise BadInput(f"--address {address}: is for a cluster; give --cluster ray with it")
    return LocalWorkers(workers, stop)


def _draw(asked: Sweep, folder: ExperimentFolder, console: Console) -> list[Path]:
    from cogrip.analysis.figures.page import svg

    paths: list[Path] = []
    for column in asked.columns[:MOST_PICTURES]:
        try:
            figure = draw_measure(asked.grid, folder.finished, column)
        except NotDrawnError as reason:
            console.print(f"not drawn: {reason}")
            continue
        path = folder.path / f"heatmap-{column}.png"
        path.write_bytes(png(figure))
        path.with_suffix(".svg").write_bytes(svg(figure))
        paths.append(path)
    return paths


def _report(
    report: CasesRun, folder: Path, pictures: list[Path], stop: Stop, json: str | None, console: Console
) -> int:
    failed = add_integers(report.failed.values())
    if json:
        answer = {
            "cells": report.cases, "computed": report.computed, "kept": report.kept, "failed": failed, "folder": str(folder),
            "table": str(report.table),
        }  # fmt: skip
        write_json(answer, json)
    console.print(
        f"{report.computed} cases run, {report.kept} kept from before, of {report.cases}; table: {report.table}"
    )
    for picture in pictures:
        console.print(f"picture: {picture}")
    for reason, count in sorted(report.failed.items(), key=lambda item: -item[1]):
        console.print(f"failed: {count} cases: {reason}")
    if stop.reason:
        console.print(f"{stop.reason}: the same command continues from here")
        return 130
    return 1 if failed else 0
