"""Settings and workers for tests of compared methods."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cogrip.experiments.experiment import Measure, Result, run_case
from cogrip.experiments.methods.method import METHODS
from cogrip.experiments.methods.query import ComparisonQuery, prepare
from cogrip.experiments.methods.table import TABLE
from cogrip.protocol.settings.room import resolve

TWO: dict[str, Any] = {
    "name": "two",
    "seconds": 2.0,
    "rates": {"device_hz": 512},
    "users": [
        {"name": "a", "hand": "tremor&amplitude_m=0.02"},
        {"name": "b", "hand": "reach&amplitude_m=0.02&delay_s=0.2", "decimator": "none"},
    ],
}
FREE = "push&force_n={}&start_s={}"  # a force, and a device that nobody damps: theory section 6 has free devices


class InProcess:
    """Workers of the simplest kind: this process."""

    def run(self, measure: Measure, jobs: Sequence[Any], batch: int = 1) -> Iterator[Result]:
        return (run_case(measure, job) for job in jobs)


def small(
    methods: Sequence[str] = ("wave", "coupling"), networks: Sequence[str] = ("wifi",), seeds: int = 2
) -> ComparisonQuery:
    return prepare(resolve(TWO), methods, networks, seeds)


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table that an experiment has left."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def row_of(network: str = "wan", method: str = "wave", **changes: Any) -> dict[str, Any]:
    """Return a row of the table of results: twenty stable sessions."""
    numbers = {column.measure: {"median": 1.0, "q1": 1.0, "q3": 1.0, "worst": 2.0, "n": 5, "of": 5} for column in TABLE}
    counts = dict.fromkeys(("failed", "diverged", "oscillates", "not_passive", "not_felt"), 0)
    known = {
        "network": network, "method": method, "ours": METHODS[method].ours, "runs": 20, "errors": {}, "diverged_s": None,
        "felt": [], "credit_mj": 1.0,
    }  # fmt: skip
    return {**known, **counts, **numbers, **changes}
