"""The query of a sweep: a checked grid and the columns to read; and the measures of one of its cases."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from cogrip.experiments.experiment import ExperimentKind, Measure, Result
from cogrip.experiments.folder import FILES
from cogrip.experiments.sweep.grid import Axis, Grid
from cogrip.experiments.sweep.measures import LIFTED, PREFIX, expanded, needs_session, read
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.sim.input_files import files_read

MANIFEST = "sweep.json"
SWEEP = ExperimentKind("sweep", MANIFEST)
_EXAMPLE_FRAMES = 2
_BATCH = 16  # number of linear models that a worker computes at a time: one takes some milliseconds


@dataclass(frozen=True, slots=True)
class SweepJob:
    """The number of a case, the base settings as a table, what the case sets, and the columns wanted."""

    case: int
    base: Mapping[str, Any]
    values: Mapping[str, Any]
    columns: tuple[str, ...]


def measure_case(job: SweepJob) -> dict[str, Any]:
    """Run the session, or build the linear model, of one case, and return its columns."""
    settings = resolve(job.base, job.values)
    summary = run_laboratory(settings).summary if needs_session(job.columns) else {}
    return {
        column: LIFTED[column](settings) if column.startswith(PREFIX) else read(summary, column)
        for column in job.columns
    }


@dataclass(frozen=True, slots=True)
class Sweep:
    """A checked query: every case can be set, every column can be read. files: digests of the files that sessions read."""

    grid: Grid
    columns: tuple[str, ...]
    files: Mapping[str, str]
    kind: ExperimentKind = SWEEP
    measure: Measure = measure_case

    @property
    def query(self) -> dict[str, Any]:
        """See `Experiment.query`."""
        return {
            "version": VERSION,
            "settings": dict(self.grid.base),
            "vary": [{"key": axis.key, "values": list(axis.values), "log": axis.log} for axis in self.grid.axes],
            "columns": list(self.columns),
            FILES: dict(self.files),
        }

    @property
    def digest(self) -> str:
        """A digest of the query, for the folder's name."""
        return hashlib.sha256(json.dumps(self.query, sort_keys=True).encode()).hexdigest()[:12]

    @property
    def keys(self) -> tuple[str, ...]:
        """The settings that are varied."""
        return self.grid.keys

    @property
    def cases(self) -> int:
        return self.grid.cases

    @property
    def batch(self) -> int:
        return 1 if needs_session(self.columns) else _BATCH

    def values(self, case: int) -> dict[str, Any]:
        """Return what a case sets."""
        return self.grid.values(case)

    def jobs(self, finished: Mapping[int, Result]) -> list[SweepJob]:
        """Return the cases that are still to be run."""
        return [
            SweepJob(case, self.grid.base, self.values(case), self.columns)
            for case in self.grid
            if case not in finished
        ]


def prepare(settings: Settings, axes: Sequence[Axis], measures: Sequence[str]) -> Sweep:
    """Check a query. Raises GridError or MeasureError before anything is run."""
    grid = Grid(msgspec.to_builtins(settings), axes)
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
