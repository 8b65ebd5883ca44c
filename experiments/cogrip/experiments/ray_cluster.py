"""Execution of cases on a Ray cluster (extra `cluster`). Tasks of a node that dies are run again on another node."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any

from cogrip.experiments.experiment import Job, Measure, Result, run_cases
from cogrip.machine.stop import Stop
from cogrip.protocol.io.cluster_address import ClusterError as ClusterError
from cogrip.protocol.io.cluster_address import probe

_UNDER_WAY = 4  # number of tasks that are kept in the cluster's queue for each of its processors
_POLL_S = 0.2
_RETRIES = 20  # most retries of a task whose node or worker died


class RayWorkers:
    """The workers of the cluster at `address`, or $RAY_ADDRESS, else of a new one on this machine; a context manager."""

    def __init__(self, address: str = "", stop: Stop | None = None) -> None:
        self._address = address or os.environ.get("RAY_ADDRESS", "")
        self._stop = stop or Stop()
        self._ray: Any = None

    def __enter__(self) -> RayWorkers:
        """Raises ClusterError."""
        try:
            import ray
        except ImportError:
            raise ClusterError("--cluster ray needs the package ray: pip install 'cogrip[cluster]'") from None
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        probe(self._address)
        try:
            where: dict[str, Any] = {"address": self._address} if self._address else {"include_dashboard": False}
            ray.init(**where, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise ClusterError(f"no Ray cluster at {self._address or 'this machine'}: {error}") from None
        self._ray = ray
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ray.shutdown()

    def run(self, measure: Measure, jobs: Sequence[Job], batch: int = 1) -> Iterator[Result]:
        """Yield results in any order; `batch` jobs are one task. Ends early once `stop` is set."""
        ray = self._ray
        todo = deque(jobs[start : start + batch] for start in range(0, len(jobs), batch))
        task = ray.remote(run_cases).options(num_cpus=1, max_retries=_RETRIES)
        under_way: list[Any] = []
        while todo or under_way:
            room = _UNDER_WAY * max(1, int(ray.cluster_resources().get("CPU", 1)))
            while todo and len(under_way) < room:
                under_way.append(task.remote(measure, todo.popleft()))
            done, under_way = ray.wait(under_way, num_returns=1, timeout=_POLL_S)
            if self._stop.reason:
                for reference in under_way:
                    ray.cancel(reference, force=True)
                return
            for reference in done:
                yield from ray.get(reference)
