"""Process that speaks with Ray for a front: it gets a descriptor, its end of the pipe (`pipe`), and there first the front.

It asks the directory, hands orders on, and ends with the front, with Ray's connection, or where the directory stays silent:
the front starts it anew.
"""

import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import msgspec

from cogrip.protocol.io.cluster_address import ClusterError, probe
from cogrip.server.administration.orders import OrderReply
from cogrip.server.hosting.cluster import pipe
from cogrip.server.hosting.cluster.directory import ClusterState
from cogrip.server.hosting.cluster.directory_actor import DirectoryActor
from cogrip.server.hosting.cluster.host_actor import DIRECTORY, NAMESPACE
from cogrip.server.hosting.cluster.pipe import (
    DirectoryState,
    DrainHost,
    Failed,
    FromRay,
    LeaveCluster,
    Left,
    OrderAnswer,
    Ordered,
    PipeEndedError,
    Silent,
)
from cogrip.server.hosting.cluster.ray_token import asks_for_token

EVERY_S = 0.2
CALL_S = 3.0  # longest wait for an answer of the directory to an order
FRONT_S = 10.0  # longest wait for an answer of the directory to the front
ORDER_S = 3.8  # longest wait for an answer of a room
END_S = 15.0
CALLERS = 8
OPEN = (
    "the Ray cluster at {where} lets in whoever reaches its ports, and they could read the server's key: start Ray again with "
    "RAY_AUTH_MODE=token on every host (docs/scaling.md), or let everybody in with --insecure"
)
NEEDS_TOKEN = "; where it asks for a token, set RAY_AUTH_MODE=token here too, with its token in ~/.ray/auth_token"
SILENT_S = 20.0  # time without an answer of the directory after which Ray is connected anew


class RayFront(msgspec.Struct, frozen=True):
    """Front, as its process of Ray gets it. command: of the rooms' template; jobs: by the rooms' names.

    guarded: only a cluster that asks for its token will do
    """

    address: str
    command: tuple[str, ...]
    loopback: bool
    place: str
    jobs: dict[str, bytes]
    guarded: bool = False


class RayProcess:
    """Connection to the cluster, until one of its ends is gone."""

    def __init__(self, end: socket.socket, front: RayFront) -> None:
        """Connect. Raises ClusterError."""
        try:
            import ray
        except ImportError:
            raise ClusterError("--cluster needs the package ray: pip install 'cogrip[cluster]'") from None
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        where = front.address or os.environ.get("RAY_ADDRESS", "") or "auto"
        probe(where)
        try:
            ray.init(address=where, namespace=NAMESPACE, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, RuntimeError, ValueError) as error:
            text = str(error).splitlines()[0]
            cure = f"start one: ray start --head{NEEDS_TOKEN}"
            raise ClusterError(f"no Ray cluster at {where}: {text}; {cure}") from None
        if front.guarded and not asks_for_token(ray.get_runtime_context().gcs_address):
            ray.shutdown()
            raise ClusterError(OPEN.format(where=where))
        logging.getLogger("ray._private.worker").setLevel(logging.CRITICAL)  # it quotes all logs of a host that died
        self._ray: Any = ray
        self._end, self._front, self._sending = end, front, threading.Lock()
        self._jobs: Mapping[str, bytes] = front.jobs
        self._callers = ThreadPoolExecutor(CALLERS, "orders")
        self._closing, self._asking = threading.Event(), threading.Lock()

    def run(self) -> int:
        """Ask the directory again and again. Return the exit code."""
        threading.Thread(target=self._obey, daemon=True).start()
        ray, directory, next_line = self._ray, None, None
        answered_s = time.monotonic()
        while time.monotonic() - answered_s < SILENT_S:
            try:
                directory = directory or self._directory()
                with self._asking:
                    if self._closing.is_set():
                        break
                    asked = directory.front.remote(self._front.place, dict(self._jobs), next_line)
                    told: ClusterState = ray.get(asked, timeout=FRONT_S)
                next_line, answered_s = told.next_line, time.monotonic()
                self._send(DirectoryState(told))
            except (ray.exceptions.RayError, ValueError):  # it is being started again, or was ended
                directory = None
                self._send(Silent())
            self._closing.wait(EVERY_S)
        if self._closing.is_set():
            threading.Event().wait()  # the other thread ends this process
        return 1

    def _obey(self) -> None:
        try:
            while True:
                match pipe.to_ray(pipe.take(self._end)):
                    case Ordered() as given:
                        self._callers.submit(self._order, given)
                    case DrainHost() as given:
                        self._callers.submit(self._drain, given.host)
                    case LeaveCluster() as given:
                        self._closing.set()
                        with self._asking:
                            self._send(Left(self._leave(given.reason)))
                        os._exit(0)
        except PipeEndedError:
            os._exit(1)

    def _send(self, message: FromRay) -> None:
        with self._sending:
            try:
                pipe.put(self._end, message)
            except PipeEndedError:
                os._exit(1)

    def _order(self, given: Ordered) -> None:
        ray = self._ray
        try:
            asked = ray.get_actor(given.actor, NAMESPACE).obey.remote(given.room, msgspec.json.encode(given.order))
            answer = bytes(ray.get(asked, timeout=ORDER_S))
        except (ray.exceptions.RayError, ValueError):
            answer = msgspec.json.encode(OrderReply(False, f"room {given.room} has not answered; try again"))
        self._send(OrderAnswer(given.number, True, answer))

    def _drain(self, host: str) -> None:
        ray = self._ray
        try:
            text, ok = ray.get(self._directory().drain.remote(host), timeout=CALL_S)
        except (ray.exceptions.RayError, ValueError):
            text, ok = "the directory of the cluster has not answered; try again", False
        self._send(OrderAnswer(0, ok, str(text).encode()))

    def _leave(self, reason: str) -> int:
        """Leave; the last front ends the rooms. Returns the worst exit code of those."""
        ray, code = self._ray, 0
        with suppress(ray.exceptions.RayError, ValueError):
            left: Sequence[str] | None = ray.get(self._directory().leave.remote(self._front.place), timeout=CALL_S)
            if left is not None:
                ray.kill(self._directory())  # or it would begin them anew
                asked = []
                for name in left:
                    with suppress(ValueError):
                        asked.append(ray.get_actor(name, NAMESPACE).end.remote(reason))
                done, _ = ray.wait(asked, num_returns=len(asked), timeout=END_S) if asked else ([], [])
                for each in done:
                    with suppress(ray.exceptions.RayError):
                        code = max(code, int(ray.get(each)))
        return code

    def _directory(self) -> Any:
        """Return the directory, started if need be: by the head, which no cluster outlives."""
        ray = self._ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        heads = [
            each["NodeID"] for each in ray.nodes() if each["Alive"] and "node:__internal_head__" in each["Resources"]
        ]
        there = NodeAffinitySchedulingStrategy(node_id=heads[0], soft=False) if heads else "DEFAULT"
        options: dict[str, Any] = {
            "name": DIRECTORY, "namespace": NAMESPACE, "lifetime": "detached", "get_if_exists": True, "num_cpus": 0,
            "max_restarts": -1, "scheduling_strategy": there,
        }  # fmt: skip
        return ray.remote(DirectoryActor).options(**options).remote(self._front.command, self._front.loopback)


def main(arguments: list[str]) -> int:
    """Speak with Ray for the front at the other end of this descriptor. Return the exit code."""
    end = socket.socket(fileno=int(arguments[0]))
    try:
        front = msgspec.msgpack.decode(pipe.take(end), type=RayFront)
    except PipeEndedError:
        return 1
    try:
        process = RayProcess(end, front)
    except ClusterError as error:
        with suppress(PipeEndedError):
            pipe.put(end, Failed(str(error)))
        return 1
    process.run()
    os._exit(1)  # no thread of Ray's may hold it up


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
