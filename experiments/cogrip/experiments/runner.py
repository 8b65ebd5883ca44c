"""The runner of every experiment: what its folder holds is kept, the other cases are run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cogrip.experiments.experiment import Experiment, Workers
from cogrip.experiments.folder import ExperimentFolder


@dataclass(frozen=True, slots=True)
class CasesRun:
    """Counts of cases in all, kept from before, run now, and failed (by error); the path of table.csv."""

    cases: int
    kept: int
    computed: int
    failed: dict[str, int]
    table: Path


def run_experiment(
    experiment: Experiment,
    folder: ExperimentFolder,
    workers: Workers,
    progress: Callable[[int], None] = lambda finished: None,
) -> CasesRun:
    """Run the cases that the folder does not have, keep each at once, and write the table of all that are finished.

    progress: called with the number of finished cases. The table is written and the folder closed on an exception, too.
    """
    kept = len(folder.finished)
    progress(kept)
    try:
        for result in workers.run(experiment.measure, experiment.jobs(folder.finished), experiment.batch):
            folder.add(result)
            progress(len(folder.finished))
    finally:
        table = folder.write_table()
        folder.close()
    failed = Counter(result.error for result in folder.finished.values() if result.error)
    return CasesRun(experiment.cases, kept, len(folder.finished) - kept, failed, table)
