"""Actor of the directory: the clock, the nodes of Ray, and the actors that it starts."""

import secrets
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from cogrip.server.io.cluster.directory import LOST_S, START_S, Directory, Home, Host, Report
from cogrip.server.io.cluster.room_actor import NAMESPACE, RoomActor

HOSTS_S = 1.0  # between two looks at the nodes


class DirectoryActor:
    """Directory of the one cluster. loopback: all hosts are this machine, and people reach them so."""

    def __init__(self, command: Sequence[str], loopback: bool) -> None:
        self._directory = Directory()
        self._command, self._loopback = tuple(command), loopback
        self._hosts: list[Host] = []
        self._hosts_s = float("-inf")
        self._spares: dict[str, tuple[str, float]] = {}  # by host: name, and when it was heard of
        self._started: set[str] = set()

    def front(
        self, place: str, jobs: Mapping[str, bytes]
    ) -> tuple[tuple[str, ...], dict[str, Home], tuple[str, ...], dict[str, int]]:
        """Return rooms that are here with other settings, where the rooms are, the fronts, and counts, to a front."""
        refused = self._directory.offer(jobs)
        fronts = self._directory.keep_front(place, time.monotonic())
        self._look()
        counts = {"room moved": self._directory.moved, "room lost with its host": self._directory.lost}
        return refused, self._directory.homes(), fronts, counts

    def report(self, told: tuple[Any, ...]) -> bool:
        """See `Directory`; a spare may go on where this directory has started it."""
        report = Report(*told)
        if report.room:
            allowed = self._directory.report(report, time.monotonic())
        else:
            allowed = report.actor in self._started
            if self._spares.get(report.host, ("", 0.0))[0] == report.actor:
                self._spares[report.host] = report.actor, time.monotonic()
        self._look()
        return allowed

    def drain(self, host: str) -> tuple[str, bool]:
        """See `Directory`."""
        said = self._directory.drain(host, self._living())
        self._look()
        return said

    def leave(self, place: str) -> tuple[dict[str, Home], list[str]] | None:
        """Forget a front. Returns the rooms and the spares that it has to end, as it was the last; else None."""
        if not self._directory.leave_front(place):
            return None
        return self._directory.homes(), [spare for spare, _ in self._spares.values()]

    def _living(self) -> list[Host]:
        import ray

        now_s = time.monotonic()
        if now_s - self._hosts_s > HOSTS_S:
            self._hosts_s = now_s
            self._hosts = [
                Host(node["NodeID"], node["NodeManagerAddress"], node["Resources"].get("CPU", 1.0))
                for node in ray.nodes()
                if node["Alive"]
            ]
        return self._hosts

    def _look(self) -> None:
        """Start what is to be started: rooms, by the spares of their hosts, and a spare on each host."""
        import ray

        hosts, now_s = {host.name: host for host in self._living()}, time.monotonic()
        for start in self._directory.look(list(hosts.values()), now_s):
            spare, heard_s = self._spares.pop(start.host, ("", 0.0))
            if not spare or now_s - heard_s > LOST_S:
                spare = self._start(hosts[start.host])
            with suppress(ValueError):  # it has died: another one is tried once it was not heard of
                ray.get_actor(spare, NAMESPACE).serve.remote(start.room, start.job, start.number, start.after)
        for name, host in hosts.items() if self._directory.settled else ():
            if name not in self._spares or now_s - self._spares[name][1] > START_S:
                self._spares[name] = self._start(host), now_s

    def _start(self, host: Host) -> str:
        """Start an actor on a host. Returns its name."""
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        name = f"room {host.name[:8]} {secrets.token_hex(4)}"
        there = NodeAffinitySchedulingStrategy(node_id=host.name, soft=False)
        options: dict[str, Any] = {
            "name": name, "namespace": NAMESPACE, "lifetime": "detached", "num_cpus": 0, "max_concurrency": 4,
            "scheduling_strategy": there,
        }  # fmt: skip
        address = "127.0.0.1" if self._loopback else host.address
        ray.remote(RoomActor).options(**options).remote(self._command, name, host.name, address)
        self._started.add(name)
        return name
