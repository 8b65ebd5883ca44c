"""The same cells on a Ray cluster (extra `cluster`). Tasks of a node that dies are run again elsewhere."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any

from cogrip.protocol.io.stop import Stop
from cogrip.sim.experiments.sweep.case import Job, Result, run_cases
from cogrip.sim.experiments.sweep.measures import needs_session

_AT_ONCE = 16
_UNDER_WAY = 4  # tasks kept in the cluster's queue for each of its processors
_LOOK_EVERY_S = 0.2
_KNOCK_S = 3.0
_RETRIES = 20  # of a task whose node or worker died


class ClusterError(Exception):
    """There is no Ray, or no such cluster."""


class RayWorkers:
    """Used as a context manager. Connects to `address`, or $RAY_ADDRESS; else starts a cluster of this machine alone."""

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
        self._knock()
        try:
            if self._address:
                ray.init(address=self._address, log_to_driver=False, logging_level=logging.ERROR)
            else:
                ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise ClusterError(f"no Ray cluster at {self._address or 'this machine'}: {error}") from None
        self._ray = ray
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ray.shutdown()

    def _knock(self) -> None:
        """Ray itself waits a minute for a cluster that is not there."""
        host, colon, port = self._address.rpartition(":")
        if not (colon and port.isdigit()) or "/" in host:
            return  # "auto", ray://...: Ray's own to resolve
        try:
            socket.create_connection((host.strip("[]"), int(port)), timeout=_KNOCK_S).close()
        except OSError as error:
            raise ClusterError(
                f"no Ray cluster at {self._address}: {error.strerror or error}; start one: ray start --head"
            ) from None

    def run(self, jobs: Sequence[Job]) -> Iterator[Result]:
        """Results as they come, in any order. Ends early once `stop` is set."""
        ray = self._ray
        at_once = 1 if jobs and needs_session(jobs[0].columns) else _AT_ONCE
        todo = [list(jobs[start : start + at_once]) for start in range(0, len(jobs), at_once)]
        task = ray.remote(run_cases).options(num_cpus=1, max_retries=_RETRIES)
        under_way: list[Any] = []
        while todo or under_way:
            room = _UNDER_WAY * max(1, int(ray.cluster_resources().get("CPU", 1)))
            while todo and len(under_way) < room:
                under_way.append(task.remote(todo.pop(0)))
            done, under_way = ray.wait(under_way, num_returns=1, timeout=_LOOK_EVERY_S)
            if self._stop.reason:
                for reference in under_way:
                    ray.cancel(reference, force=True)
                return
            for reference in done:
                yield from ray.get(reference)
