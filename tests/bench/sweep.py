"""`dev.py bench sweep`: the same cases with one worker process and with several, in turns."""

import time

import msgspec

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.experiments.sweep.query import SweepJob, measure_case
from cogrip.experiments.worker_pool import LocalWorkers

COLUMNS = ("passive", "users.0.peak_force_n")
_BLOCKS = 4
_LEAST_OF_TWO = 1.8


def bench_sweep(*, cells: int = 400, seconds: float = 5.0, jobs: int = 2) -> int:
    """Two-user sessions of the demo's settings, each with its own stiffness; blocks of cases go to one and to many in turn.

    Parameters
    ----------
    cells
        How many cases.
    seconds
        Virtual time of each case's session.
    jobs
        Workers of the larger pool.
    """
    if cells < _BLOCKS or jobs < 2:
        raise BadInput(f"bench sweep needs at least {_BLOCKS} cases and 2 jobs")
    console = make_console()
    base = msgspec.to_builtins(load(shipped("demo"), [f"seconds={seconds}"]))
    all_jobs = [SweepJob(case, base, {"coupling.stiffness_npm": 200.0 + 2.0 * case}, COLUMNS) for case in range(cells)]
    blocks = [all_jobs[start::_BLOCKS] for start in range(_BLOCKS)]
    spent = {1: 0.0, jobs: 0.0}
    answers = {}
    with LocalWorkers(1) as one, LocalWorkers(jobs) as many:
        for workers, count in ((one, 1), (many, jobs)):
            list(workers.run(measure_case, [all_jobs[0]] * count))  # both have started before either is timed
        for number, block in enumerate(blocks):
            turns = ((one, 1), (many, jobs)) if number % 2 == 0 else ((many, jobs), (one, 1))
            for workers, count in turns:
                start = time.perf_counter()
                results = list(workers.run(measure_case, block))
                spent[count] += time.perf_counter() - start
                answers[number, count] = sorted((result.case, str(result.measures)) for result in results)
                console.print(f"block {number + 1} of {_BLOCKS}, {count} workers: {len(results)} cases")
    same = all(answers[number, 1] == answers[number, jobs] for number in range(_BLOCKS))
    ratio = spent[1] / spent[jobs]
    console.print(
        f"{cells} cases of {seconds:g} s: 1 worker {spent[1]:.1f} s, {jobs} workers {spent[jobs]:.1f} s, ratio {ratio:.2f}; "
        f"results {'equal' if same else 'DIFFER'}"
    )
    if jobs == 2:
        console.print(
            f"at least {_LEAST_OF_TWO:g} is asked for: {'reached' if ratio >= _LEAST_OF_TWO else 'NOT reached'}"
        )
    return 0 if same and (jobs != 2 or ratio >= _LEAST_OF_TWO) else 1
