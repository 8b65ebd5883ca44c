"""An experiment as the runner sees it: numbered cases, what each one sets, and the function that measures one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from cogrip.results.reading.folder import finite


class ExperimentKind(NamedTuple):
    """The kind of an experiment: its name in messages, and the file that holds its query."""

    word: str
    manifest: str


class Job(Protocol):
    """One case, as plain data that any process can take."""

    @property
    def case(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Result:
    """Measures of one case. `error` is "" unless the case could not be run; a session that diverges is a result."""

    case: int
    measures: dict[str, Any]
    error: str = ""


Measure = Callable[[Any], dict[str, Any]]  # measures of a job, by name


class Workers(Protocol):
    """An executor of cases."""

    def run(self, measure: Measure, jobs: Sequence[Any], batch: int = 1) -> Iterator[Result]: ...


class Experiment(Protocol):
    """A checked query. `query` is what makes this experiment this one and no other; `batch` jobs go to a worker together."""

    @property
    def kind(self) -> ExperimentKind: ...
    @property
    def query(self) -> Mapping[str, Any]: ...
    @property
    def keys(self) -> Sequence[str]: ...
    @property
    def columns(self) -> Sequence[str]: ...
    @property
    def cases(self) -> int: ...
    @property
    def batch(self) -> int: ...
    @property
    def measure(self) -> Measure: ...
    def values(self, case: int) -> Mapping[str, Any]: ...
    def jobs(self, finished: Mapping[int, Result]) -> Sequence[Job]: ...


def run_case(measure: Measure, job: Job) -> Result:
    """Run one case. An exception in it is its result, so that the experiment goes on."""
    try:
        return Result(job.case, finite(measure(job)))
    except Exception as error:  # noqa: BLE001 (kept with the case, counted and shown)
        return Result(job.case, {}, f"{type(error).__name__}: {error}")


def run_cases(measure: Measure, jobs: Sequence[Job]) -> list[Result]:
    """Run several cases, one after the other."""
    return [run_case(measure, job) for job in jobs]
