"""Metrics: snapshots of a room, health, and the process that serves both, alive, killed and stopped."""

import http.client
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from math import inf, isnan, nan

import numpy as np
import pytest
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

from cogrip.protocol.accounts import LinkCount
from cogrip.protocol.histogram import DurationHistogram
from cogrip.protocol.io.pacing import Pacer
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.settings import resolve
from cogrip.server.io import metrics_process
from cogrip.server.io.metrics_families import families
from cogrip.server.io.metrics_feed import START_AGAIN_NS, MetricsError, MetricsFeed, open_metrics
from cogrip.server.io.metrics_process import MOST_AT_ONCE
from cogrip.server.room import Room
from cogrip.server.seat_limits import Record
from cogrip.server.snapshot import (
    FRESH_NS,
    REFRESHED_ROOMS,
    Health,
    RoomSnapshot,
    SeatSnapshot,
    Snapshot,
    SnapshotMaker,
    Times,
    decode,
    encode,
    times,
)

from tests.server.recorded_rooms import scripted

FRAME_NS = 7_812_500
PHANTOM = Record("sim:phantom", 1, 1024.0, 10.0, 2.0)
LIMIT_S = 60.0  # for anything a process is waited for


def a_room(name: str = "lab", people: tuple[str, ...] = ("anna", "ben")) -> Room:
    return Room(resolve({"name": name, "users": [{"name": person} for person in people]}))


def waves(frame: int, value: float = 0.1) -> Waves:
    """Frame `frame` alone, with a true energy ledger."""
    made_j = (frame + 1) * value * value * FRAME_NS * 0.5e-9
    return Waves(1, frame, (value,), (frame * value,), (frame * value * value,), made_j, 0.0, 0, Stamp(1), (0.0, 0.0))


def hold(room: Room, frames: range, number: int = 0) -> None:
    """One person sends frames and the room ticks."""
    for frame in frames:
        port = room.seats[number].port
        assert port is not None
        assert port.receive(waves(frame))
        room.tick(frame * FRAME_NS)


def take_seat(room: Room, number: int = 0) -> None:
    room.take_seat(number, 1, 1, 0, PHANTOM)


def maker(*rooms: Room) -> SnapshotMaker:
    return SnapshotMaker(rooms, {room.name: Pacer(128, 0) for room in rooms}, "1.2.3")


def test_a_snapshot_says_what_the_room_knows():
    room, pacer = a_room(), Pacer(128, 0)
    take_seat(room)
    hold(room, range(20))
    assert room.seats[0].port.receive(waves(19)), "a duplicate"
    room.seats[0].clock.read(
        Stamp(5_010_000_000, 1_000_000_000, 0), 1_040_000_000
    )  # 40 ms there and back, 3.99 s ahead
    for tick in (0, 1, 5):
        pacer.take(pacer.due_ns(tick) + 300_000)
    snapshot = SnapshotMaker([room], {"lab": pacer}, "1.2.3").make(
        2.5, {"malformed": 3, "rate": 1}, {"malformed": 4}, rtt_ns={("lab", 0): 41_000_000}, datagrams=(7, 8)
    )
    (seen,) = snapshot.rooms
    anna, ben = seen.seats
    assert (snapshot.software, snapshot.uptime_s) == ("1.2.3", 2.5)
    assert snapshot.dropped == {"malformed": 7, "rate": 1}
    assert (snapshot.received, snapshot.sent) == (7, 8)
    assert (seen.room, seen.seated, seen.observers, seen.diverged) == ("lab", 1, 0, "")
    assert (seen.ticks_due, seen.ticks_run, seen.ticks_skipped) == (6, 3, 3)
    assert seen.position_m == tuple(room.world.position.tolist()) != (0.0,)
    assert seen.travel_m == room.travel_m > 0.0
    assert anna.seated
    assert anna.frames == room.seats[0].port.count()
    assert (anna.frames.sent, anna.frames.applied, anna.frames.duplicate) == (20, 20, 1)
    assert anna.rtt_s == pytest.approx(0.041)
    assert (anna.up_delay_s, anna.down_delay_s, anna.clock_offset_s) == pytest.approx((0.02, 0.02, 3.99))
    assert anna.rendered_npm == room.world.stiffness_of(0) > 0.0
    assert (ben.up_delay_s, ben.down_delay_s, ben.clock_offset_s, ben.rendered_npm) == (None, None, None, None)
    assert anna.up_margin_j == room.seats[0].port.up_margin_j
    assert (anna.up_reserve_j, anna.line_reserve_j) == (
        room.seats[0].port.up_reserve.now_j,
        room.seats[0].line_reserve.now_j,
    )
    assert None not in (anna.up_reserve_j, anna.line_reserve_j)
    assert (ben.user, ben.seated, ben.frames, ben.rtt_s, ben.up_margin_j) == ("ben", False, LinkCount(), None, None)


def test_tick_times_are_in_seconds_and_skips_are_counted():
    values_ns = np.random.default_rng(7).lognormal(11, 1, 2000).astype(int).tolist()
    histogram = DurationHistogram()
    for value_ns in values_ns:
        histogram.add(value_ns)
    found = times(histogram)
    assert found.sum_s == pytest.approx(sum(values_ns) * 1e-9)
    assert found.max_s == pytest.approx(max(values_ns) * 1e-9)
    for q, value_s in ((50, found.p50_s), (99, found.p99_s)):
        assert value_s == pytest.approx(np.percentile(values_ns, q, method="inverted_cdf") * 1e-9, rel=1 / 32)
    assert times(DurationHistogram()) == Times()
    late_by_nothing = DurationHistogram()
    late_by_nothing.add(0)
    assert times(late_by_nothing) == Times(0.0, 0.0, 0.0, 0.0), "not the same as no tick"


def test_least_margins_stay_when_the_seat_is_left_and_taken_again():
    room = a_room()
    make = maker(room).make
    take_seat(room)
    room.seats[0].line_margin_j = -0.25
    assert make(0.5).rooms[0].least_line_margin_j == -0.25
    room.leave_seat(0, "leave")
    left = make(1.0).rooms[0]
    assert (left.seated, left.least_line_margin_j, left.seats[0].line_margin_j) == (0, -0.25, -0.25)
    take_seat(room)
    again = make(1.5).rooms[0]
    assert (again.least_line_margin_j, again.seats[0].line_margin_j) == (-0.25, 0.0)


@pytest.mark.parametrize("count", [1, REFRESHED_ROOMS, REFRESHED_ROOMS + 1, 3 * REFRESHED_ROOMS - 1])
def test_every_room_gets_new_percentiles_in_turn(count):
    rooms = [a_room(f"r{number}", ("anna",)) for number in range(count)]
    pacers = {room.name: Pacer(128, 0) for room in rooms}
    make = SnapshotMaker(rooms, pacers, "1").make
    make(0.0)
    for pacer in pacers.values():
        pacer.take(1_000_000)
    needed = -(-count // REFRESHED_ROOMS)
    seen = [make(number * 0.5) for number in range(needed)]
    assert all(room.late.max_s == pytest.approx(1e-3) for room in seen[-1].rooms)
    assert len([room for room in seen[0].rooms if room.late.max_s]) == min(count, REFRESHED_ROOMS)


def test_a_snapshot_is_not_recorded():
    """A replay would be asked for what nobody had asked."""
    core = scripted().core
    puts: list[object] = []
    core.record(type("Sink", (), {"put": lambda self, *message: puts.append(message)})())
    make = maker(*core.rooms).make
    assert make(1.0, core.dropped) == make(1.0, core.dropped)
    assert puts == []
    core.rooms[0].account()
    assert puts, "as an account is"


def test_what_is_not_finite_is_said_as_such():
    room = a_room()
    take_seat(room)
    room.world.position = np.array([nan])
    room.travel_m = inf
    room.diverged = "the object left the workspace at (nan,) m"
    back = decode(encode(maker(room).make(1.0)))
    assert back.rooms[0].position_m == (None,)
    assert back.rooms[0].travel_m is None
    samples = scraped(back)
    assert isnan(samples["cogrip_object_position_meters"][0].value)
    assert isnan(samples["cogrip_object_travel_meters_total"][0].value)
    assert samples["cogrip_diverged"][0].value == 1.0


# how well it is ------------------------------------------------------------------------------------------------------


def state(uptime_s: float = 1.0, ticks: int = 128, diverged: str = "", rooms: tuple[str, ...] = ("lab",)) -> Snapshot:
    return Snapshot(
        "1.2.3", uptime_s, tuple([RoomSnapshot(name, 0, (), (0.0,), 0.0, ticks, diverged=diverged) for name in rooms])
    )


def test_a_server_that_said_nothing_is_not_well():
    assert Health().trouble(0) == "the server has said nothing yet"


def test_a_snapshot_is_good_for_two_seconds():
    health = Health()
    health.take(state(), 10**9)
    assert health.trouble(10**9 + FRESH_NS - 1) == ""
    assert "has said nothing for 2.0 s" in health.trouble(10**9 + FRESH_NS)


def test_a_room_without_a_tick_for_two_seconds_is_not_well():
    health = Health()
    health.take(state(1.0, 128, rooms=("lab", "hall")), 0)
    health.take(state(2.5, 128, rooms=("lab", "hall")), 1)
    assert health.trouble(1) == ""
    health.take(state(3.0, 128, rooms=("lab", "hall")), 2)
    assert health.trouble(2) == "room lab: no tick for 2.0 s"
    health.take(state(3.5, 129, rooms=("lab", "hall")), 3)
    assert health.trouble(3) == ""


def test_a_room_whose_people_took_the_object_away_makes_no_server_unwell():
    health = Health()
    health.take(state(diverged="the object left"), 0)
    assert health.trouble(0) == ""


# what is written -----------------------------------------------------------------------------------------------------


class One(Collector):
    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def collect(self):
        return families(self._snapshot)


def scraped(snapshot: Snapshot) -> dict:
    registry = CollectorRegistry()
    registry.register(One(snapshot))
    return samples_in(generate_latest(registry).decode())


def samples_in(text: str) -> dict:
    """Samples by name, as Prometheus' own reader finds them."""
    found: dict = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, []).append(sample)
    return found


def test_the_text_says_what_the_snapshot_says():
    seat = SeatSnapshot(
        "anna", True, LinkCount(9, 8, 7, 6, 5, 4), 0.04, 1e-3, -2e-3, {"wave clipped": 12}, 0.02, 0.03, -7.0, 1837.0
    )
    room = RoomSnapshot(
        "lab", 1, (seat, SeatSnapshot("b\"e\\n\n", False)), (0.1, 0.2, 0.3), 1.5, 100, 2,
        Times(0.5, 1e-4, 2e-4, 3e-4), Times(), 3, 1e-3, -2e-3,
    )  # fmt: skip
    found = scraped(Snapshot("1.2.3", 60.0, (room,), {"refused: token": 5}, 1000, 2000))

    def value(name: str, **labels: str) -> float:
        (sample,) = [each for each in found[f"cogrip_{name}"] if each.labels == labels]
        return sample.value

    anna = {"room": "lab", "user": "anna"}
    assert value("build_info", version="1.2.3") == 1.0
    assert value("uptime_seconds") == 60.0
    assert value("dropped_total", reason="refused: token") == 5.0
    assert (value("datagrams_total", direction="in"), value("datagrams_total", direction="out")) == (1000.0, 2000.0)
    assert (value("seats", room="lab"), value("users_seated", room="lab"), value("observers", room="lab")) == (2, 1, 3)
    assert [value(f"ticks_{kind}_total", room="lab") for kind in ("due", "run", "skipped")] == [102, 100, 2]
    assert value("tick_lateness_seconds", room="lab", quantile="0.5") == 1e-4
    assert value("tick_lateness_seconds", room="lab", quantile="0.99") == 2e-4
    assert value("tick_lateness_seconds_sum", room="lab") == 0.5
    assert value("tick_lateness_seconds_count", room="lab") == 100
    assert value("tick_lateness_max_seconds", room="lab") == 3e-4
    assert "cogrip_tick_work_max_seconds" not in found, "not known, not said"
    assert [value("object_position_meters", room="lab", axis=axis) for axis in "xyz"] == [0.1, 0.2, 0.3]
    assert value("object_travel_meters_total", room="lab") == 1.5
    assert value("diverged", room="lab") == 0.0
    assert (value("least_up_margin_joules", room="lab"), value("least_line_margin_joules", room="lab")) == (1e-3, -2e-3)
    assert (value("up_margin_joules", **anna), value("line_margin_joules", **anna)) == (1e-3, -2e-3)
    assert value("rtt_seconds", **anna) == 0.04
    assert (value("up_delay_seconds", **anna), value("down_delay_seconds", **anna)) == (0.02, 0.03)
    assert (value("clock_offset_seconds", **anna), value("rendered_newtons_per_meter", **anna)) == (-7.0, 1837.0)
    assert value("seat_taken", **anna) == 1.0
    assert value("seat_taken", room="lab", user='b"e\\n\n') == 0.0, "a name cannot break a line"
    assert value("limited_total", **anna, reason="wave clipped") == 12.0
    fates = ("sent", "received", "applied", "lost", "late", "duplicate")
    assert [value(f"frames_{fate}_total", **anna, direction="up") for fate in fates] == [9, 8, 7, 6, 5, 4]


def test_names_units_and_help_are_what_prometheus_asks_for():
    room = a_room()
    take_seat(room)
    hold(room, range(5))
    for family in families(maker(room).make(1.0, {"malformed": 1}, datagrams=(1, 1))):
        assert family.name.startswith("cogrip_")
        assert family.documentation.endswith(".")
        assert not family.name.endswith("_total"), "the format adds it"
        labels = {label for sample in family.samples for label in sample.labels}
        assert labels <= {"room", "user", "reason", "direction", "axis", "quantile", "version"}
        for unit in ("_s", "_ms", "_us", "_j", "_m", "_ns"):
            assert not family.name.endswith(unit), "base units, in full"


# the process ---------------------------------------------------------------------------------------------------------


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
        connection = http.client.HTTPConnection("127.0.0.1", self.feed.port, timeout=LIMIT_S)
        try:
            connection.request(verb, path, headers={"Host": f"{host}:{self.feed.port}"})
            answer = connection.getresponse()
            return answer.status, answer.headers.get("Content-Type", ""), answer.read().decode()
        finally:
            connection.close()

    def seen(self, name: str) -> float | None:
        """A sample without labels, as scraped now."""
        found = samples_in(self.ask("/metrics")[2]).get(f"cogrip_{name}")
        return found[0].value if found else None

    def answers(self) -> bool:
        try:
            return self.ask("/metrics")[0] == 200
        except (OSError, http.client.HTTPException):
            return False

    def await_uptime(self, uptime_s: float) -> None:
        until(lambda: self.seen("uptime_seconds") == uptime_s)


OWN_THREADS = 2  # of the process: one takes snapshots in, one listens


def threads_of(pid: int) -> int:
    """Return the number of threads of the metrics process."""
    return len(os.listdir(f"/proc/{pid}/task"))


def until(holds: Callable[[], bool]) -> None:
    limit_s = time.monotonic() + LIMIT_S
    while not holds():
        assert time.monotonic() < limit_s, "it never came true"


@pytest.fixture
def site() -> Iterator[Site]:
    there = Site()
    yield there
    if there.feed._process.poll() is None:
        os.kill(there.pid, signal.SIGCONT)
    there.feed.close()


def test_it_serves_metrics_and_health_and_nothing_else(site):
    status, content, body = site.ask("/healthz")
    assert (status, content) == (503, "application/json")
    assert json.loads(body) == {"status": "the server has said nothing yet"}
    assert site.seen("healthy") == 0.0

    site.feed.put(state(1.5))
    site.await_uptime(1.5)
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

    site.feed.put(state(2.0, diverged="the object left"))
    site.await_uptime(2.0)
    status, _, body = site.ask("/healthz")
    assert (status, json.loads(body)["status"]) == (200, "ok")
    assert json.loads(body)["rooms"] == {"lab": {"seated": 0, "observers": 0, "diverged": "the object left"}}

    assert [site.ask(path)[0] for path in ("/", "/metrics/", "/../etc/passwd", "/favicon.ico")] == [404] * 4
    assert site.ask("/metrics", verb="POST")[0] == 501
    for path in ("/metrics", "/healthz", "/"):
        status, content, body = site.ask(path, verb="HEAD")
        assert (status, content, body) == (*site.ask(path)[:2], "")
    assert site.ask("/metrics", host="elsewhere.example")[0] == 421, "a page that has its name point here"
    assert site.ask("/metrics", host="localhost")[0] == 200


def test_it_listens_on_this_machine_alone(site):
    with socket.socket() as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", site.feed.port))


def test_it_ends_with_the_server_and_not_before(site):
    process = site.feed._process
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(site.pid, number)
    site.feed.put(state(3.5))
    site.await_uptime(3.5)
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
    assert site.words == [
        "/metrics and /healthz are not served: their process ended with code -9; tried again once a minute"
    ]
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
        site.feed.put(state(float(last), diverged=many))
    os.kill(site.pid, signal.SIGCONT)
    until(lambda: site.feed.put(state(-1.0)) or site.seen("uptime_seconds") == -1.0)
    assert site.seen("diverged") is not None, "whole, after one of which a part had been taken"
    assert site.words == []
    assert site.feed._process.poll() is None


def test_a_taken_port_is_named():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        words: list[str] = []
        with pytest.raises(
            MetricsError, match=rf"127\.0\.0\.1:{port}: Address already in use; choose another --metrics"
        ):
            open_metrics(port, words.append)
        assert words == []


def test_an_asker_who_hangs_up_is_counted(site):
    site.feed.put(state())
    with socket.create_connection(("127.0.0.1", site.feed.port)) as rude:
        rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # its end is a reset
        rude.sendall(b"GET /metrics HTTP/1.0\r\n")
    until(lambda: site.seen("scrapes_broken_off_total") == 1.0)


@pytest.mark.skipif(sys.platform != "linux", reason="counts the threads of another process in /proc")
def test_so_many_connections_are_answered_at_once_and_no_more(site):
    """The others are closed at once; when there is room again everybody is answered."""
    site.feed.put(state(1.0))
    site.await_uptime(1.0)
    held = [socket.create_connection(("127.0.0.1", site.feed.port), timeout=LIMIT_S) for _ in range(MOST_AT_ONCE)]
    until(lambda: threads_of(site.pid) >= MOST_AT_ONCE)
    for _ in range(20):
        with (
            socket.create_connection(("127.0.0.1", site.feed.port), timeout=LIMIT_S) as more,
            suppress(ConnectionError),
        ):
            assert more.recv(1) == b""
    assert threads_of(site.pid) <= MOST_AT_ONCE + OWN_THREADS
    for each in held:
        each.close()
    until(site.answers)
    assert site.seen("scrapes_turned_away_total") >= 20.0


def test_a_connection_that_trickles_is_ended_all_the_same(site):
    """A byte now and then is no life: its whole time is bounded."""
    with socket.create_connection(("127.0.0.1", site.feed.port), timeout=LIMIT_S) as slow:
        slow.sendall(b"GET /metrics HTTP/1.0\r\nX: ")
        slow.settimeout(0.2)
        begun_s, ended = time.monotonic(), False
        while not ended:
            assert time.monotonic() - begun_s < LIMIT_S, "it was held for ever"
            try:
                slow.sendall(b"x")
                ended = slow.recv(1) == b""
            except TimeoutError:
                continue
            except ConnectionError:
                ended = True


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
