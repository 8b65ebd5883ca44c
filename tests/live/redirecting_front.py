"""A front of a cluster without the cluster: it redirects to one server."""

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cogrip.cli.serving.server_state import front_channel_of
from cogrip.cli.settings.settings_file import load
from cogrip.machine.stop import Stop
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.directory import Home
from cogrip.server.hosting.cluster.front import ClusterFront
from cogrip.server.hosting.workers.steering import open_public
from cogrip.server.io.state_folder import StateFolder


class OneHome:
    """Where the one room is. place: HOST:PORT, which may be changed."""

    def __init__(self, room: str, place: str) -> None:
        self.homes = {room: Home("", place, (), b"")}
        self.fronts: tuple[str, ...] = ()
        self.counts: dict[str, int] = {}
        self.lines: deque[ServerEvent] = deque()

    def poll(self, now_s: float) -> None:
        pass

    def answers(self) -> list[Any]:
        return []


@contextmanager
def redirecting(config: Path, place: str, state: Path | None) -> Iterator[int]:
    """Serve as a front on a free port until left. state: with the key, None for unencrypted."""
    room, stop = load(config, ()), Stop()
    public = open_public("127.0.0.1", 0)
    pool, port = OneHome(room.name, place), int(public.getsockname()[1])
    pool.fronts = (f"127.0.0.1:{port}",)
    channel = front_channel_of(lambda address: False, [room], StateFolder(state) if state else None)
    front = ClusterFront(public, [room], pool, stop, lambda event: None, channel)  # type: ignore[arg-type]
    thread = threading.Thread(target=front.run)
    thread.start()
    try:
        yield port
    finally:
        stop.reason = "over"
        thread.join()
        public.close()
