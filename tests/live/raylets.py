"""Raylets of a Ray cluster on this machine, and a real kill -9 of one with all that it has started.

`python -m tests.live.raylets RAYLETS PORT` starts some until its standard input ends, and prints `Started` as one line: who
has started a head here ends where that is killed.
"""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tests.fair_time import FairTime

NODE = {"num_cpus": 1, "object_store_memory": 100 * 1024 * 1024, "include_dashboard": False}
START_S = 45.0  # Ray itself waits 30 s for a raylet: little, where others compute here too
TRIES = 4
LOOK_S = 0.5
ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def raylets(more: int, port: int = 0) -> Iterator[Any]:
    """Start a cluster: a head at this port, and so many more raylets. Yields `ray.cluster_utils.Cluster`."""
    os.environ |= {
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_agent_register_timeout_ms": str(round(START_S * 1e3)),
        "RAY_raylet_start_wait_time_s": str(round(START_S)),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ray._private import services
        from ray.cluster_utils import Cluster
    quick = services.get_node
    services.get_node = _patient(quick)
    cluster: Any = None
    try:
        for _ in range(TRIES):
            cluster = Cluster()
            with suppress(Exception):  # Ray's own: a raylet ends where its agent takes 15 s to start
                cluster.add_node(**NODE, **({"gcs_server_port": port} if port else {}))
                for _ in range(more):
                    cluster.add_node(**NODE)
                break
            cluster.shutdown()
        yield cluster
    finally:
        services.get_node = quick
        cluster.shutdown()


def _patient(get_node: Callable[..., Any]) -> Callable[..., Any]:
    def found(*arguments: Any, **keywords: Any) -> Any:
        waited = FairTime()
        while True:
            try:
                return get_node(*arguments, **keywords)
            except RuntimeError:
                if waited.spent_s() > START_S:
                    raise
                time.sleep(LOOK_S)

    return found


class Apart:
    """Head and another raylet, of a process of their own. address: HOST:PORT; head: processes; raylet: the other's."""

    def __init__(self, port: int = 0) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.live.raylets", str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True, start_new_session=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        assert self._process.stdout is not None
        line = next((each for each in self._process.stdout if each.startswith("{")), "{}")
        self.address, self.head, self.raylet = json.loads(line).values()

    def stop(self) -> None:
        """End what is left of it."""
        kill([*descendants(self._process.pid), self.raylet])
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()


def main(port: int) -> None:
    """Start a head and another raylet; wait for the end of the input."""
    with raylets(1, port) as cluster:
        (node,) = cluster.worker_nodes
        head = [each.process.pid for kind in cluster.head_node.all_processes.values() for each in kind]
        print(json.dumps({"address": cluster.address, "head": head, "raylet": raylet_of(node)}), flush=True)
        sys.stdin.read()


@contextmanager
def ray_host(environ: Mapping[str, str], *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Start a host as its administrator does, by `ray start --block`; yields that process, of which all others descend."""
    process = subprocess.Popen(
        [str(Path(sys.executable).parent / "ray"), "start", "--block", *words], env=environ, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        kill(descendants(process.pid))
        process.wait()


def descendants(pid: int) -> list[int]:
    """Return a process and all that it, and they, have started."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
            children.setdefault(parent, []).append(int(entry.name))
    found, todo = [], [pid]
    while todo:
        found.append(todo.pop())
        todo += children.get(found[-1], [])
    return found


def raylet_of(node: Any) -> int:
    """Return the process id of a node's raylet."""
    return int(node.all_processes["raylet"][0].process.pid)


def kill(pids: list[int]) -> None:
    """End processes with -9."""
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


if __name__ == "__main__":
    main(int(sys.argv[1]))
