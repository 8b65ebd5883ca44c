"""Connection of a front to the Ray cluster: a thread asks the directory, further ones hand orders on; nobody waits for them."""

import logging
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from cogrip.protocol.io.cluster_address import ClusterError as ClusterError
from cogrip.protocol.io.cluster_address import probe
from cogrip.server.io.cluster.directory import Home
from cogrip.server.io.cluster.directory_actor import DirectoryActor
from cogrip.server.io.cluster.room_actor import DIRECTORY, NAMESPACE
from cogrip.server.io.control import Answer
from cogrip.server.io.workers.link import Answered, Obey, Void
from cogrip.server.snapshot import Snapshot, decode

EVERY_S = 0.2
CALL_S = 3.0  # for an answer of the directory
ORDER_S = 3.8  # for an answer of a room
END_S = 15.0
CALLERS = 8


class RemoteLink:
    """Link to a room's actor, as `Administration` uses one."""

    def __init__(self, order: Callable[[Obey], None]) -> None:
        self._order = order

    def send(self, message: Obey | Void) -> None:
        """Hand an order on. What is void by now every room reads in the shared tokens itself."""
        if isinstance(message, Obey):
            self._order(message)


@dataclass(slots=True)
class RemoteRoom:
    """A room on some host, as `Administration` sees a worker."""

    rooms: tuple[str, ...]
    link: RemoteLink
    snapshot: Snapshot | None
    state: str = "ready"


class RemoteRooms:
    """Rooms of a cluster as the directory told them last.

    homes, fronts  where the rooms are; places of all fronts
    refused        rooms that the cluster has with other settings
    """

    replaced = 0  # counted by the directory

    def __init__(self, address: str, command: Sequence[str], loopback: bool) -> None:
        """Connect. address: HOST:PORT of the head, "" for $RAY_ADDRESS, or the cluster of this machine. Raises ClusterError."""
        try:
            import ray
        except ImportError:
            raise ClusterError("--cluster needs the package ray: pip install 'cogrip[cluster]'") from None
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        where = address or os.environ.get("RAY_ADDRESS", "") or "auto"
        probe(where)
        try:
            ray.init(address=where, namespace=NAMESPACE, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, RuntimeError, ValueError) as error:
            text = str(error).splitlines()[0]
            raise ClusterError(f"no Ray cluster at {where}: {text}; start one: ray start --head") from None
        logging.getLogger("ray._private.worker").setLevel(logging.CRITICAL)  # it quotes all logs of a host that died
        self._ray: Any = ray
        self._command, self._loopback = tuple(command), loopback
        self.homes: dict[str, Home] = {}
        self.fronts: tuple[str, ...] = ()
        self.refused: tuple[str, ...] = ()
        self.counts: dict[str, int] = {}
        self.place = ""
        self._jobs: Mapping[str, bytes] = {}
        self._news: deque[Answered] = deque()
        self._callers = ThreadPoolExecutor(CALLERS, "orders")
        self._heard, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="directory", daemon=True)

    def begin(self, place: str, jobs: Mapping[str, bytes]) -> None:
        """Let the cluster serve rooms, by their names. Raises ClusterError."""
        self.place, self._jobs = place, jobs
        self._thread.start()
        if not self._heard.wait(END_S):
            raise ClusterError(f"the directory of the cluster did not answer within {END_S:g} s; see `ray status`")
        if self.refused:
            names = ", ".join(self.refused)
            raise ClusterError(
                f"the cluster has {names} with other settings or another front's flags; give the same, or rename the room"
            )

    @property
    def workers(self) -> list[RemoteRoom]:
        """Return the rooms that are served."""
        return [
            RemoteRoom(
                (room,),
                RemoteLink(partial(self._order, home.actor)),
                decode(home.snapshot) if home.snapshot else None,
            )
            for room, home in self.homes.items()
        ]

    def home(self, room: str) -> RemoteRoom | None:
        """Return a room; None while nobody serves it."""
        return next((each for each in self.workers if room in each.rooms), None)

    def void(self, revoked: Iterable[str], expired: Iterable[str]) -> None:
        """Do nothing: every room reads the shared tokens."""

    def answers(self) -> list[Answered]:
        """Return the answers that have come since the last call."""
        found = [self._news.popleft() for _ in range(len(self._news))]
        return found

    def drain(self, host: str) -> tuple[str, bool]:
        """Let the rooms of a host move. Returns what to tell, and whether it is done."""
        try:
            text, ok = self._ray.get(self._directory().drain.remote(host), timeout=CALL_S)
        except self._ray.exceptions.RayError:
            return "the directory of the cluster has not answered; try again", False
        return str(text), bool(ok)

    def end(self, reason: str) -> int:
        """Leave the cluster; the last front ends the rooms. Returns the worst exit code of those."""
        self._closing.set()
        self._thread.join(CALL_S)
        ray, code = self._ray, 0
        with suppress(ray.exceptions.RayError, ValueError):
            left = ray.get(self._directory().leave.remote(self.place), timeout=CALL_S)
            if left is not None:
                ray.kill(self._directory())  # or it would begin them anew
                homes, spares = left
                code = max(self._each_ends([home.actor for home in homes.values()], reason), default=0)
                self._each_ends(spares, reason)
        self._callers.shutdown(wait=False, cancel_futures=True)
        ray.shutdown()
        return code

    def _each_ends(self, names: Sequence[str], reason: str) -> list[int]:
        """End actors. Returns the exit codes of those that could be asked."""
        ray, codes = self._ray, []
        for name in names:
            with suppress(ValueError):
                codes.append(ray.get_actor(name, NAMESPACE).end.remote(reason))
        return list(ray.get(codes, timeout=END_S))

    def _directory(self) -> Any:
        """Return the directory, started if need be: by the head, which no cluster outlives."""
        ray = self._ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        heads = [each["NodeID"] for each in ray.nodes() if "node:__internal_head__" in each["Resources"]]
        there = NodeAffinitySchedulingStrategy(node_id=heads[0], soft=False) if heads else "DEFAULT"
        options: dict[str, Any] = {
            "name": DIRECTORY, "namespace": NAMESPACE, "lifetime": "detached", "get_if_exists": True, "num_cpus": 0,
            "max_restarts": -1, "scheduling_strategy": there,
        }  # fmt: skip
        return ray.remote(DirectoryActor).options(**options).remote(self._command, self._loopback)

    def _run(self) -> None:
        """Ask the directory again and again."""
        ray, directory = self._ray, None
        while not self._closing.is_set():
            try:
                directory = directory or self._directory()
                told = ray.get(directory.front.remote(self.place, dict(self._jobs)), timeout=CALL_S)
                self.refused, self.homes, self.fronts, self.counts = told
                self._heard.set()
            except (ray.exceptions.RayError, ValueError):  # it is being started again, or was ended
                directory = None
                self.counts = {**self.counts, "directory silent": self.counts.get("directory silent", 0) + 1}
            self._closing.wait(EVERY_S)

    def _order(self, name: str, order: Obey) -> None:
        self._callers.submit(self._ask, name, order)

    def _ask(self, name: str, order: Obey) -> None:
        ray = self._ray
        try:
            asked = ray.get_actor(name, NAMESPACE).obey.remote(msgspec.json.encode(order.order))
            answer = msgspec.json.decode(ray.get(asked, timeout=ORDER_S), type=Answer)
        except (ray.exceptions.RayError, ValueError):
            answer = Answer(False, "a room has not answered; try again")
        self._news.append(Answered(order.number, answer))
