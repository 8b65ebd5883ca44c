"""A sweep from its question to its table: what is finished is kept, the rest is run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import msgspec

from cogrip.protocol.settings import Settings
from cogrip.sim.experiments.sweep.case import Job, Result
from cogrip.sim.experiments.sweep.folder import SweepFolder, digest, manifest
from cogrip.sim.experiments.sweep.grid import Axis, Grid
from cogrip.sim.experiments.sweep.measures import expanded, needs_session
from cogrip.sim.runs.laboratory_run import run_laboratory
from cogrip.sim.session.input_files import files_read

_EXAMPLE_FRAMES = 2


class Workers(Protocol):
    """Whoever runs cells."""

    def run(self, jobs: Sequence[Job]) -> Iterator[Result]: ...


@dataclass(frozen=True, slots=True)
class Sweep:
    """A checked question: every cell can be set, every column can be read."""

    grid: Grid
    columns: tuple[str, ...]
    files: Mapping[str, str]

    @property
    def asked(self) -> dict[str, Any]:
        return manifest(self.grid, self.columns, self.files)

    @property
    def digest(self) -> str:
        return digest(self.asked)


@dataclass(frozen=True, slots=True)
class Report:
    cases: int
    kept: int
    computed: int
    failed: dict[str, int]  # by reason
    table: Path


def prepare(settings: Settings, axes: Sequence[Axis], measures: Sequence[str]) -> Sweep:
    """Raises GridError or MeasureError before anything is run."""
    base = msgspec.to_builtins(settings)
    grid = Grid(base, axes)
    grid.check()
    example: dict[str, Any] = {}
    files: dict[str, str] = {}
    if needs_session(measures):
        first = grid.settings(0)
        short = msgspec.structs.replace(first, seconds=_EXAMPLE_FRAMES / first.rates.network_hz)
        example = run_laboratory(short).summary
        for settings in grid.each_value():
            files |= files_read(settings)
    return Sweep(grid, expanded(measures, example), dict(sorted(files.items())))


def run_sweep(
    sweep: Sweep, folder: SweepFolder, workers: Workers, progress: Callable[[int], None] = lambda finished: None
) -> Report:
    """Run the cells that the folder does not have, keep each as it comes, and write the table, of however many there are."""
    grid = sweep.grid
    kept = len(folder.finished)
    jobs = [Job(case, grid.base, grid.values(case), sweep.columns) for case in grid if case not in folder.finished]
    progress(kept)
    try:
        for result in workers.run(jobs):
            folder.add(result, grid.values(result.case))
            progress(len(folder.finished))
    finally:
        table = folder.write_table(grid, sweep.columns)
        folder.close()
    failed: dict[str, int] = {}
    for result in folder.finished.values():
        if result.error:
            failed[result.error] = failed.get(result.error, 0) + 1
    return Report(grid.cases, kept, len(folder.finished) - kept, failed, table)
