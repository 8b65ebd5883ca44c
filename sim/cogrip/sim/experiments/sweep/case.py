"""One cell of a sweep, wherever it runs: settings in, measures out. Plain data both ways, so that any process can take it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cogrip.protocol.settings import resolve
from cogrip.sim.analysis.measures import LIFTED
from cogrip.sim.experiments.sweep.measures import PREFIX, finite, needs_session, read
from cogrip.sim.runs.laboratory_run import run_laboratory


@dataclass(frozen=True, slots=True)
class Job:
    """A cell's number, base settings as a table, what it sets, and the columns wanted."""

    case: int
    base: Mapping[str, Any]
    values: Mapping[str, Any]
    columns: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Result:
    """`error` is "" unless the cell could not be run; a session that diverges is a result."""

    case: int
    measures: dict[str, Any]
    error: str = ""


def run_case(job: Job) -> Result:
    """Run one cell. Whatever goes wrong in it is its result: a sweep goes on."""
    try:
        settings = resolve(job.base, job.values)
        summary = run_laboratory(settings).summary if needs_session(job.columns) else {}
        measures = {
            column: finite(LIFTED[column](settings)) if column.startswith(PREFIX) else read(summary, column)
            for column in job.columns
        }
    except Exception as error:  # noqa: BLE001 (kept with the cell, counted and shown)
        return Result(job.case, {}, f"{type(error).__name__}: {error}")
    return Result(job.case, measures)


def run_cases(jobs: list[Job]) -> list[Result]:
    return [run_case(job) for job in jobs]


def at_once(jobs: Sequence[Job]) -> int:
    """How many cells are worth sending to another process together: those of a linear model take milliseconds."""
    return 1 if jobs and needs_session(jobs[0].columns) else 16
