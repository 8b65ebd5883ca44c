"""Actor of the directory: the clock, the nodes of Ray, and the actors of the hosts."""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.directory import LOST_S, ClusterState, Directory, Host, Report
from cogrip.server.hosting.cluster.host_actor import AT_ONCE, NAMESPACE, HostActor, actor_of
from cogrip.server.hosting.cluster.lines import GatheredLines

HOSTS_S = 1.0  # time between two looks at the nodes
AGAIN_S = 10.0  # least time between two starts of a host's actor


class DirectoryActor:
    """Directory of the one cluster. loopback: all hosts are this machine, and people reach them so."""

    def __init__(self, command: Sequence[str], loopback: bool) -> None:
        self._directory = Directory()
        self._command, self._loopback = tuple(command), loopback
        self._nodes: list[Host] = []
        self._nodes_s = float("-inf")
        self._reported_s: dict[str, float] = {}  # hosts, and when their actors reported last
        self._started: dict[str, float] = {}
        self._leaving: set[str] = set()  # hosts that Ray drains: `ray start --block` had SIGTERM there
        self._emptied: set[str] = set()
        self._lines = GatheredLines()

    def front(self, place: str, jobs: Mapping[str, bytes], next_line: int | None) -> ClusterState:
        """Take in a front and the rooms that it wants served. next_line: of the rooms' lines, None for those from now on."""
        refused = self._directory.offer(jobs)
        fronts = self._directory.keep_front(place, time.monotonic())
        self._look()
        counts = {"room moved": self._directory.moved, "room lost with its host": self._directory.lost}
        lines = self._lines.all
        if next_line is None or next_line > lines.end:  # of a directory before this one
            next_line = lines.end if next_line is None else 0
        first, news = lines.since(next_line)
        return ClusterState(refused, self._directory.homes(), fronts, counts, news, first + len(news))

    def report(
        self, host: str, told: Sequence[tuple[Any, ...]], first: int, lines: Sequence[ServerEvent]
    ) -> tuple[set[tuple[str, int]], int, tuple[str, ...]]:
        """Take in a host. Returns the processes that are to end, the number of the line to tell next, and the hosts."""
        now_s = time.monotonic()
        self._reported_s[host] = now_s
        forbidden = set()
        for report in map(Report._make, told):
            if not self._directory.report(report, now_s):
                forbidden.add((report.room, report.number))
        taken = self._lines.take(actor_of(host), first, lines)
        self._look()
        return forbidden, taken, tuple(each.name for each in self._ready())

    def drain(self, host: str) -> tuple[str, bool]:
        """See `Directory`."""
        said = self._directory.drain(host, self._living())
        self._look()
        return said

    def leave(self, place: str) -> list[str] | None:
        """Forget a front. Returns the actors that it has to end, as it was the last; else None."""
        if not self._directory.leave_front(place):
            return None
        return [actor_of(host) for host in self._started.keys() | self._reported_s.keys()]

    def _living(self) -> list[Host]:
        import ray
        from ray._private.state import state

        now_s = time.monotonic()
        if now_s - self._nodes_s > HOSTS_S:
            self._nodes_s = now_s
            self._nodes = [
                Host(node["NodeID"], node["NodeManagerAddress"], node["Resources"].get("CPU", 1.0))
                for node in ray.nodes()
                if node["Alive"]
            ]
            for host in state.get_draining_nodes():
                self._leaving.add(host)
                self._directory.drain(host, self._nodes)  # refused while it is the last one, and asked again
        return self._nodes

    def _ready(self) -> list[Host]:
        """Return the hosts whose actors have reported just now."""
        now_s = time.monotonic()
        return [each for each in self._living() if now_s - self._reported_s.get(each.name, float("-inf")) < LOST_S]

    def _look(self) -> None:
        """Start what is to be started: rooms, and an actor on each host. Empty hosts that Ray is to take down."""
        import ray

        ready = self._ready()
        self._empty()
        names = [host.name for host in ready]
        all_reported = all(host.name in self._reported_s for host in self._living())
        for start in self._directory.look(ready, time.monotonic(), all_reported):
            with suppress(ValueError):  # it has died: the room is missed
                ray.get_actor(actor_of(start.host), NAMESPACE).serve.remote(tuple(start), names)
        now_s = time.monotonic()
        for host in self._living():
            there = host.name in names or host.name in self._leaving
            if not there and now_s - self._started.get(host.name, float("-inf")) > AGAIN_S:
                self._started[host.name] = now_s
                self._start(host)

    def _empty(self) -> None:
        """Let the rooms of hosts that Ray drains move, and end the actors that have none left: Ray waits for them."""
        import ray

        for host in self._leaving - self._emptied:
            if self._directory.is_empty(host):
                self._emptied.add(host)
                with suppress(ValueError):
                    ray.get_actor(actor_of(host), NAMESPACE).end.remote("")

    def _start(self, host: Host) -> None:
        """Start the actor of a host, where it is not there."""
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        there = NodeAffinitySchedulingStrategy(node_id=host.name, soft=False)
        options: dict[str, Any] = {
            "name": actor_of(host.name), "namespace": NAMESPACE, "lifetime": "detached", "get_if_exists": True,
            "num_cpus": 0, "max_concurrency": AT_ONCE, "scheduling_strategy": there,
        }  # fmt: skip
        address = "127.0.0.1" if self._loopback else host.address
        ray.remote(HostActor).options(**options).remote(self._command, host.name, address)
