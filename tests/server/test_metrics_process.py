"""The process that serves metrics and health: alive, killed and stopped."""

import http.client
import json
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

from cogrip.server.io import metrics_process
from cogrip.server.io.metrics_feed import START_AGAIN_NS, MetricsError, MetricsFeed, open_metrics
from cogrip.server.io.metrics_process import MOST_AT_ONCE

from tests.fair_time import FairTime
from tests.server.patience import LIMIT_S, until
from tests.server.test_metrics import samples_in, state


class Site:
    """A feed, what it said, and somebody who asks."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.now_ns = 0
        self.feed: MetricsFeed = open_metrics(0, self.words.append, lambda: self.now_ns)

    @property
    def pid(self) -> int:
        return self.feed._process.pid

    def ask(self, path: str, host: str = "127.0.0.1", verb: str = "GET") -> tuple[int, str, str]:
        with closing(http.client.HTTPConnection("127.0.0.1", self.feed.port, timeout=LIMIT_S)) as connection:
            connection.request(verb, path, headers={"Host": f"{host}:{self.feed.port}"})
            answer = connection.getresponse()
            return answer.status, answer.headers.get("Content-Type", ""), answer.read().decode()

    def connection(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.feed.port), timeout=LIMIT_S)

    def seen(self, name: str) -> float | None:
        """A sample without labels, as scraped now."""
        found = samples_in(self.ask("/metrics")[2]).get(f"cogrip_{name}")
        return found[0].value if found else None

    def answers(self) -> bool:
        try:
            return self.ask("/metrics")[0] == 200
        except (OSError, http.client.HTTPException):
            return False

    def tell(self, uptime_s: float, *left: str) -> None:
        """Put a snapshot in, and wait until it is served."""
        self.feed.put(state(uptime_s, left=left))
        until(lambda: self.seen("uptime_seconds") == uptime_s)


OWN_THREADS = 2  # of the process: one takes snapshots in, one listens


@pytest.fixture
def site() -> Iterator[Site]:
    there = Site()
    yield there
    if there.feed._process.poll() is None:
        os.kill(there.pid, signal.SIGCONT)
    there.feed.close()


def test_it_serves_metrics_and_health_and_nothing_else_to_this_machine_alone(site):
    status, content, body = site.ask("/healthz")
    assert (status, content) == (503, "application/json")
    assert json.loads(body) == {"status": "the server has said nothing yet"}
    assert site.seen("healthy") == 0.0

    site.tell(1.5)
    status, content, body = site.ask("/healthz")
    assert status == 200
    told = json.loads(body)
    assert told.pop("age_s") < LIMIT_S
    assert told == {
        "status": "ok", "version": "1.2.3", "uptime_s": 1.5, "rooms": {"lab": {"seated": 0, "observers": 0}},
    }  # fmt: skip
    status, content, body = site.ask("/metrics?format=any")
    assert (status, content) == (200, "text/plain; version=0.0.4; charset=utf-8")
    assert samples_in(body)["cogrip_healthy"][0].value == 1.0
    assert samples_in(body)["cogrip_process_resident_memory_bytes"][0].value > 1e6, "of the server, not of the scraped"

    site.tell(2.0, "the object")
    status, _, body = site.ask("/healthz")
    assert (status, json.loads(body)["status"]) == (200, "ok")
    assert json.loads(body)["rooms"] == {"lab": {"seated": 0, "observers": 0, "left": ["the object"]}}

    assert [site.ask(path)[0] for path in ("/", "/metrics/", "/../etc/passwd", "/favicon.ico")] == [404] * 4
    assert site.ask("/metrics", verb="POST")[0] == 501
    for path in ("/metrics", "/healthz", "/"):
        status, content, body = site.ask(path, verb="HEAD")
        assert (status, content, body) == (*site.ask(path)[:2], "")
    assert site.ask("/metrics", host="elsewhere.example")[0] == 421, "a page that has its name point here"
    assert site.ask("/metrics", host="localhost")[0] == 200
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", site.feed.port))


def test_it_ends_with_the_server_and_not_before(site):
    process = site.feed._process
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(site.pid, number)
    site.tell(3.5)
    assert os.getsid(site.pid) == site.pid, "Ctrl-C at the server's terminal does not reach it"
    process.stdin.close()
    assert process.wait(LIMIT_S) == 0
    process.stdout.close()
    assert site.words == []


def test_a_dead_process_is_named_once_and_started_again_after_a_minute(site):
    first, port = site.feed._process, site.feed.port
    os.kill(site.pid, signal.SIGKILL)
    first.wait(LIMIT_S)
    site.now_ns = START_AGAIN_NS - 1
    for number in range(10):
        site.feed.put(state(float(number)))
    not_served = "/metrics and /healthz are not served: their process ended with code -9; tried again once a minute"
    assert site.words == [not_served]
    assert site.feed.not_taken == 10
    assert site.feed._process is first

    site.now_ns = START_AGAIN_NS
    site.feed.put(state(10.0))
    assert site.feed._process is not first
    until(lambda: site.feed.put(state(11.0)) or site.feed.answered)
    assert site.words[1:] == [f"/metrics and /healthz are served again, on 127.0.0.1:{port}"]
    until(lambda: site.feed.put(state(12.0)) or site.seen("uptime_seconds") == 12.0)


def test_a_process_that_reads_nothing_costs_snapshots_and_no_time(site):
    os.kill(site.pid, signal.SIGSTOP)
    many = "x" * 100_000
    last = 0
    while site.feed.not_taken < 3:  # nothing here waits: else this never ends
        last += 1
        site.feed.put(state(float(last), unstable=many))
    os.kill(site.pid, signal.SIGCONT)
    until(lambda: site.feed.put(state(-1.0)) or site.seen("uptime_seconds") == -1.0)
    assert site.seen("unstable") is not None, "whole, after one of which a part had been taken"
    assert site.words == []
    assert site.feed._process.poll() is None


def test_a_taken_port_is_named():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        words: list[str] = []
        with pytest.raises(MetricsError, match=rf"\.0\.1:{port}: Address already in use; choose another --metrics"):
            open_metrics(port, words.append)
        assert words == []


def test_an_asker_who_hangs_up_is_counted(site):
    site.feed.put(state())
    with site.connection() as rude:
        rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # its end is a reset
        rude.sendall(b"GET /metrics HTTP/1.0\r\n")
    until(lambda: site.seen("scrapes_broken_off_total") == 1.0)


@pytest.mark.skipif(sys.platform != "linux", reason="counts the threads of another process in /proc")
def test_so_many_connections_are_answered_at_once_and_no_more(site):
    """The others are closed at once; when there is room again everybody is answered."""
    site.tell(1.0)
    threads = Path(f"/proc/{site.pid}/task")
    held = [site.connection() for _ in range(MOST_AT_ONCE)]
    until(lambda: len(os.listdir(threads)) >= MOST_AT_ONCE)
    for _ in range(20):
        with site.connection() as more, suppress(ConnectionError):
            assert more.recv(1) == b""
    assert len(os.listdir(threads)) <= MOST_AT_ONCE + OWN_THREADS
    for each in held:
        each.close()
    until(site.answers)
    assert site.seen("scrapes_turned_away_total") >= 20.0


def test_a_connection_that_trickles_is_ended_all_the_same(monkeypatch):
    """A byte now and then is no life: its whole time is bounded."""
    monkeypatch.setattr(metrics_process, "ASK_LIMIT_S", 0.3)
    with metrics_process.MetricsServer(0, metrics_process.Latest()) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        with socket.create_connection(server.server_address, timeout=LIMIT_S) as slow:
            slow.sendall(b"GET /metrics HTTP/1.0\r\nX: ")
            slow.settimeout(0.05)
            waited, ended = FairTime(), False
            while not ended:
                assert waited.spent_s() < LIMIT_S, "it was held for ever"
                try:
                    slow.sendall(b"x")
                    ended = slow.recv(1) == b""
                except TimeoutError:
                    continue
                except ConnectionError:
                    ended = True
        server.shutdown()


def test_where_no_thread_can_be_had_a_connection_is_closed_and_counted(monkeypatch, capsys):
    def refuse(self):
        raise RuntimeError("can't start new thread")

    latest = metrics_process.Latest()
    server = metrics_process.MetricsServer(0, latest)
    monkeypatch.setattr("threading.Thread.start", refuse)
    with server, socket.create_connection(server.server_address, timeout=LIMIT_S) as asker:
        server.handle_request()
        assert asker.recv(1) == b""
    assert latest.turned_away == 1
    assert capsys.readouterr().err == ""
