"""Cells on the processors of this machine: spawned workers with one BLAS thread each."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Any, Protocol, cast

from cogrip.protocol.io.stop import Stop
from cogrip.sim.blas_threads import BLAS_THREADS, SAFE_PATH
from cogrip.sim.experiments.sweep.case import Result, at_once, run_cases

MOST_DEATHS = 3  # of a worker, before its cells are given up
_LOOK_EVERY_S = 0.2
_KEEPER_S = 10.0  # for the pool's own thread to end, once its workers have


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Numbered(Protocol):
    """A job, by the number of its cell."""

    @property
    def case(self) -> int: ...


class LocalWorkers:
    """`workers` processes, used as a context manager. `deaths` counts workers that ended by themselves."""

    def __init__(
        self,
        workers: int,
        stop: Stop | None = None,
        task: Callable[[list[Any]], list[Result]] = run_cases,
        at_once: Callable[[Sequence[Any]], int] = at_once,
    ) -> None:
        """task: what a worker does with jobs, a sweep's if none is given; at_once: how many of them it gets together."""
        self._task = task
        self._at_once = at_once
        self._workers = workers
        self._stop = stop or Stop()
        self._pool: ProcessPoolExecutor | None = None
        self.deaths = 0

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def run(self, jobs: Sequence[Numbered]) -> Iterator[Result]:
        """Results as they come, in any order. Ends early once `stop` is set; what was under way then is lost."""
        at_once = self._at_once(jobs)
        todo = [list(jobs[start : start + at_once]) for start in range(0, len(jobs), at_once)]
        under_way: dict[Future[list[Result]], list[Numbered]] = {}
        while todo or under_way:
            pool = self._begin()
            try:
                while todo and len(under_way) < 2 * self._workers:
                    under_way[pool.submit(self._task, todo[0])] = todo[0]
                    todo.pop(0)
                done, _ = wait(under_way, timeout=_LOOK_EVERY_S, return_when=FIRST_COMPLETED)
                if self._stop.reason:
                    self._end()
                    return
                for future in done:
                    results = future.result()
                    del under_way[future]
                    yield from results
            except BrokenProcessPool:
                self.deaths += 1
                self._end()
                lost = list(under_way.values())
                under_way.clear()
                if self.deaths > MOST_DEATHS:
                    for jobs_lost in (*lost, *todo):
                        yield from (Result(job.case, {}, "a worker process died again and again") for job in jobs_lost)
                    return
                todo = lost + todo

    def _begin(self) -> ProcessPoolExecutor:
        if self._pool is None:
            theirs = {
                **dict.fromkeys(BLAS_THREADS, "1"),
                SAFE_PATH: "1",
            }  # read where numpy is first imported: in the workers
            before = {name: os.environ.get(name) for name in theirs}
            os.environ.update(theirs)
            try:
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(self._workers, mp_context=context, initializer=_begin_worker)
                for _ in range(self._workers):
                    self._pool.submit(self._task, [])  # starts a worker, while the environment is theirs
            finally:
                for name, value in before.items():
                    if value is None:
                        os.environ.pop(name, None)
                    else:
                        os.environ[name] = value
        return self._pool

    def _end(self) -> None:
        if self._pool is None:
            return
        mine = list((self._pool._processes or {}).values())
        # reaps them too: whoever comes second knows no exit code until it is through
        housekeeping = cast(threading.Thread | None, self._pool._executor_manager_thread)
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in mine:
            process.terminate()
        for process in mine:
            process.join()
        if housekeeping is not None:
            housekeeping.join(_KEEPER_S)
        self._pool = None


def _begin_worker() -> None:
    """In a worker: Ctrl-C reaches the whole group, and the parent decides; a parent that was killed leaves nobody behind."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
