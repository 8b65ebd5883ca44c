"""Actor of the directory: the clock, the nodes of Ray, and the actors that it starts."""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from cogrip.server.io.cluster.directory import Directory, Home, Host, Report
from cogrip.server.io.cluster.room_actor import NAMESPACE, RoomActor

HOSTS_S = 1.0  # between two looks at the nodes


def actor_name(room: str, number: int) -> str:
    """Return the name of a room's actor."""
    return f"room {room} {number}"


class DirectoryActor:
    """Directory of the one cluster. loopback: all hosts are this machine, and people reach them so."""

    def __init__(self, command: Sequence[str], loopback: bool) -> None:
        self._directory = Directory()
        self._command, self._loopback = tuple(command), loopback
        self._hosts: list[Host] = []
        self._hosts_s = float("-inf")

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
        """See `Directory`."""
        allowed = self._directory.report(Report(*told), time.monotonic())
        self._look()
        return allowed

    def drain(self, host: str) -> tuple[str, bool]:
        """See `Directory`."""
        said = self._directory.drain(host, self._living())
        self._look()
        return said

    def leave(self, place: str) -> dict[str, Home] | None:
        """Forget a front. Returns the rooms that it has to end, as it was the last; else None."""
        return self._directory.homes() if self._directory.leave_front(place) else None

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
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        hosts = self._living()
        for start in self._directory.look(hosts, time.monotonic()):
            address = next(host.address for host in hosts if host.name == start.host)
            there = NodeAffinitySchedulingStrategy(node_id=start.host, soft=False)
            options: dict[str, Any] = {
                "name": actor_name(start.room, start.number), "namespace": NAMESPACE, "lifetime": "detached",
                "num_cpus": 0, "max_concurrency": 4, "scheduling_strategy": there,
            }  # fmt: skip
            with suppress(ValueError):  # there is one of this name: it is heard of, or another number is tried
                ray.remote(RoomActor).options(**options).remote(
                    self._command, start.room, start.job, start.number, start.host,
                    "127.0.0.1" if self._loopback else address, actor_name(start.room, start.after) if start.after else "",
                )  # fmt: skip
