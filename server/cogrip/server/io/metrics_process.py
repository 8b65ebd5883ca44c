"""Metrics process: `python -m cogrip.server.io.metrics_process PORT`, snapshots on its standard input.

It writes to standard output where it listens, or why it cannot, and ends when its input closes. It serves `/metrics` and
`/healthz` on 127.0.0.1 alone; a scrape never costs the server time.
"""

import json
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import IO, Any

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from cogrip.machine.platform import system
from cogrip.machine.server_platform import be_nice
from cogrip.server.io.metrics_families import families
from cogrip.server.snapshot import LENGTH_BYTES, Health, RoomSnapshot, Snapshot, decode

MOST_BYTES = 1 << 26  # longest snapshot; longer ones are not the server's
MOST_AT_ONCE = 16  # most connections at once, each with a thread: a service has few
ASK_LIMIT_S = 5.0  # longest time of a whole connection
HOSTS = ("127.0.0.1", "localhost", "")
"""Names under which the service is asked: a page elsewhere that has its name point here is not answered."""


class Latest:
    """Newest snapshot, and health: written by one thread, read by those that answer."""

    def __init__(self) -> None:
        self._health = Health()
        self._lock = threading.Lock()
        self.broken_off = 0  # the asker was gone before the answer
        self.turned_away = 0  # too many asked at once

    def take(self, snapshot: Snapshot) -> None:
        with self._lock:
            self._health.take(snapshot, time.monotonic_ns())

    def newest(self) -> tuple[Snapshot | None, str, str, float]:
        """Return (newest snapshot, trouble or "", what is degraded or "", its age [s])."""
        with self._lock:
            now_ns, health = time.monotonic_ns(), self._health
            return health.newest, health.trouble(now_ns), health.degraded(), health.age_ns(now_ns) * 1e-9


class ServerCollector(Collector):
    """Collector of the newest snapshot and its age."""

    def __init__(self, latest: Latest) -> None:
        self._latest = latest

    def collect(self) -> Iterator[Metric]:
        snapshot, trouble, degraded, age_s = self._latest.newest()
        healthy = float(not (trouble or degraded))
        yield GaugeMetricFamily("cogrip_healthy", "1 where /healthz says ok, else 0.", value=healthy)
        broken_off = self._latest.broken_off
        yield CounterMetricFamily(
            "cogrip_scrapes_broken_off", "Askers who were gone before the answer.", value=broken_off
        )
        yield CounterMetricFamily(
            "cogrip_scrapes_turned_away", f"Askers beyond {MOST_AT_ONCE} at once.", value=self._latest.turned_away
        )
        if snapshot is not None:
            yield GaugeMetricFamily("cogrip_snapshot_age_seconds", "How old all this is.", value=age_s)
            yield from families(snapshot)


class Page(BaseHTTPRequestHandler):
    """Answers of one connection."""

    timeout = ASK_LIMIT_S
    server: "MetricsServer"

    def do_GET(self) -> None:
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        path = self.path.partition("?")[0]
        if host not in HOSTS:
            self._answer(HTTPStatus.MISDIRECTED_REQUEST, "text/plain; charset=utf-8", b"ask 127.0.0.1\n")
        elif path == "/metrics":
            encode, content = choose_encoder("")
            self._answer(HTTPStatus.OK, content, encode(self.server.registry))
        elif path == "/healthz":
            self._answer_health()
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"there is /metrics, and /healthz\n")

    def do_HEAD(self) -> None:
        """Answer without the body, as some probes ask."""
        self.do_GET()

    def _answer_health(self) -> None:
        snapshot, trouble, degraded, age_s = self.server.latest.newest()
        words: dict[str, Any] = {"status": trouble or (f"degraded: {degraded}" if degraded else "ok")}
        if snapshot is not None:
            words |= {
                "version": snapshot.software,
                "uptime_s": round(snapshot.uptime_s, 1),
                "age_s": round(age_s, 3),
                **({"degraded": snapshot.degraded} if snapshot.degraded else {}),
                "rooms": {room.room: _room(room) for room in snapshot.rooms},
            }
        status = HTTPStatus.SERVICE_UNAVAILABLE if trouble else HTTPStatus.OK
        self._answer(status, "application/json", json.dumps(words).encode() + b"\n")

    def _answer(self, status: HTTPStatus, content: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def version_string(self) -> str:
        return "cogrip"

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 (the base class calls it so)
        """Log nothing."""


def _room(room: RoomSnapshot) -> dict[str, Any]:
    words: dict[str, Any] = {"seated": room.seated, "observers": room.observers}
    incidents: dict[str, Any] = {"unstable": room.unstable, "left": list(room.left)}
    return words | {name: value for name, value in incidents.items() if value}


class MetricsServer(ThreadingHTTPServer):
    """HTTP server of at most MOST_AT_ONCE connections, each for ASK_LIMIT_S at most; others are closed, and counted."""

    daemon_threads = True
    block_on_close = False
    _open: dict[socket.socket, float]  # time at which each connection was opened [s]

    def __init__(self, port: int, latest: Latest) -> None:
        self.latest = latest
        self.registry = CollectorRegistry()
        self.registry.register(ServerCollector(latest))
        server = os.getppid()
        ProcessCollector(namespace="cogrip", pid=lambda: server, registry=self.registry)
        self._open = {}
        super().__init__(("127.0.0.1", port), Page)

    def process_request(self, request: Any, client_address: Any) -> None:
        if len(self._open) < MOST_AT_ONCE:
            self._open[request] = time.monotonic()
            try:
                super().process_request(request, client_address)
                return
            except RuntimeError:  # there may be no more threads
                pass
        self.latest.turned_away += 1
        self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        self._open.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """End the connections whose time is over."""
        over_s = time.monotonic() - ASK_LIMIT_S
        for request, since_s in list(self._open.items()):
            if since_s < over_s:
                with suppress(OSError):
                    request.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: object, client_address: object) -> None:
        if isinstance(sys.exc_info()[1], OSError):  # gone, or silent for too long
            self.latest.broken_off += 1
        else:
            super().handle_error(request, client_address)  # type: ignore[arg-type]  # a defect: its traceback is shown


def follow(source: IO[bytes], latest: Latest) -> None:
    """Take snapshots until the input closes, even within one."""
    while len(head := source.read(LENGTH_BYTES)) == LENGTH_BYTES:
        size = int.from_bytes(head, "big")
        if size > MOST_BYTES:
            raise ValueError(f"a snapshot of {size} bytes, more than {MOST_BYTES}: this is not the server's pipe")
        body = source.read(size)
        if len(body) < size:
            return
        latest.take(decode(body))


def main(arguments: list[str]) -> int:
    system.ignore_end_signals()  # it ends when the server does, not before
    system.ordinary_priority()
    be_nice()
    latest = Latest()
    try:
        server = MetricsServer(int(arguments[0]), latest)
    except OSError as error:
        print(json.dumps({"trouble": error.strerror or str(error)}), flush=True)
        return 1
    print(json.dumps({"port": server.server_address[1]}), flush=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    follow(sys.stdin.buffer, latest)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
