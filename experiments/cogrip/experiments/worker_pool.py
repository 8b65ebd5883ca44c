"""Execution of cases on this machine: a loky pool of spawned workers with one BLAS thread each."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType

from loky import ProcessPoolExecutor, cpu_count  # type: ignore[import-untyped]

from cogrip.experiments.experiment import Job, Measure, Result, run_cases
from cogrip.machine.blas_threads import BLAS_THREADS, SAFE_PATH
from cogrip.machine.stop import Stop

MOST_DEATHS = 3  # most deaths of a worker before its cases are given up
_POLL_S = 0.2
_ENVIRONMENT = {**dict.fromkeys(BLAS_THREADS, "1"), SAFE_PATH: "1"}
"""Environment of workers, which is read when one starts."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    return int(cpu_count())


class LocalWorkers:
    """A pool of `workers` processes, used as a context manager. `deaths` counts how often a worker ended unasked."""

    def __init__(self, workers: int | None = None, stop: Stop | None = None) -> None:
        """Prepare `workers` processes, one for each processor if None. stop: ends a run early."""
        self._workers = workers or processors()
        self._stop = stop or Stop()
        self._pool: ProcessPoolExecutor | None = None
        self.deaths = 0

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end(kill=kind is not None or bool(self._stop.reason))

    def run(self, measure: Measure, jobs: Sequence[Job], batch: int = 1) -> Iterator[Result]:
        """Yield results in any order; `batch` jobs go to a worker together. Once `stop` is set, those under way are lost."""
        todo = deque(jobs[start : start + batch] for start in range(0, len(jobs), batch))
        under_way: dict[Future[list[Result]], Sequence[Job]] = {}
        while todo or under_way:
            pool = self._begin()
            try:
                while todo and len(under_way) < 2 * self._workers:
                    under_way[pool.submit(run_cases, measure, todo[0])] = todo[0]
                    todo.popleft()
                done, _ = wait(under_way, timeout=_POLL_S, return_when=FIRST_COMPLETED)
                if self._stop.reason:
                    self._end(kill=True)
                    return
                for future in done:
                    results = future.result()
                    del under_way[future]
                    yield from results
            except BrokenProcessPool:
                self.deaths += 1
                self._end(kill=True)
                todo.extendleft(under_way.values())
                under_way.clear()
                if self.deaths > MOST_DEATHS:
                    yield from (
                        Result(job.case, {}, "a worker process died again and again") for each in todo for job in each
                    )
                    return

    def _begin(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._workers, initializer=_begin_worker, initargs=(os.getpid(),), env=_ENVIRONMENT
            )
        return self._pool

    def _end(self, kill: bool) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, kill_workers=kill)
            self._pool = None


def _begin_worker(parent: int) -> None:
    """Prepare a worker: Ctrl-C reaches the whole process group, but the parent decides; a worker ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    os._exit(1)
