"""Directory of a cluster in virtual time: placement by load, hosts that die, drained hosts, and its own pauses."""

import pytest

from cogrip.server.hosting.cluster.directory import (
    GAP_S,
    LOST_S,
    RETRY_S,
    SETTLE_S,
    START_S,
    Directory,
    Host,
    ProcessStart,
    Report,
)

HOSTS = [Host("aaaa1111", "10.0.0.1", 4.0), Host("bbbb2222", "10.0.0.2", 4.0)]
EVERY_S = 0.25


class Cluster:
    """Actors that report four times a second: as long as their host lives."""

    def __init__(self, hosts: list[Host]) -> None:
        self.directory, self.hosts, self.now_s = Directory(), list(hosts), 100.0
        self.living = {host.name for host in hosts}
        self.running: dict[tuple[str, int], Report] = {}
        self.started: list[ProcessStart] = []
        self.fenced: list[tuple[str, int]] = []

    def pass_by(self, seconds: float, ready: bool = True) -> None:
        """Let time pass. ready: actors that are started serve at once; else never."""
        for _ in range(round(seconds / EVERY_S)):
            self.now_s += EVERY_S
            for start in self.directory.look(self.hosts, self.now_s):
                self.started.append(start)
                place = f"{start.host}:{start.number}" if ready else ""
                taken = ("anna",) if start.room == "full" else ()
                self.running[start.room, start.number] = Report(
                    f"{start.room} {start.number}", start.room, start.number, start.host, start.job, place, taken
                )
            for key, report in list(self.running.items()):
                if report.host in self.living and not self.directory.report(report, self.now_s):
                    self.fenced.append(key)
                    del self.running[key]

    def serve(self, *rooms: str) -> None:
        """Let the rooms be offered, and five seconds pass."""
        self.directory.offer(dict.fromkeys(rooms, b"job"))
        self.pass_by(5.0)

    def where(self) -> dict[str, str]:
        return {room: home.place for room, home in self.directory.homes().items()}


@pytest.fixture
def cluster() -> Cluster:
    return Cluster(HOSTS)


def test_rooms_go_to_the_host_with_the_least_load(cluster: Cluster) -> None:
    cluster.serve("full", "b")
    assert {start.host for start in cluster.started} == {"aaaa1111", "bbbb2222"}
    crowded = next(start.host for start in cluster.started if start.room == "full")
    cluster.directory.offer({"c": b""})
    cluster.pass_by(1.0)
    assert cluster.started[-1].host != crowded, "a room with a person weighs as much as two"


def test_a_host_with_more_processors_takes_more_rooms() -> None:
    cluster = Cluster([Host("aaaa1111", "10.0.0.1", 1.0), Host("bbbb2222", "10.0.0.2", 3.0)])
    cluster.serve(*[f"room {number}" for number in range(8)])
    assert [start.host for start in cluster.started].count("bbbb2222") == 6


def test_a_host_that_dies_loses_its_rooms_to_another(cluster: Cluster) -> None:
    cluster.serve("attic", "cellar")
    dead, alive = cluster.started
    cluster.living.remove(dead.host)
    cluster.pass_by(LOST_S + 2 * EVERY_S)
    again = cluster.started[-1]
    assert (again.room, again.number, again.job, again.after) == (dead.room, 2, b"job", "")
    assert again.host == alive.host, "Ray may still list the dead one"
    assert cluster.where()[dead.room] == f"{alive.host}:2"
    assert cluster.directory.lost == 1
    cluster.living.add(dead.host)  # it was away only: its room is not served twice
    cluster.pass_by(EVERY_S)
    assert cluster.fenced == [(dead.room, 1)]
    assert len(cluster.started) == 3


def test_a_drained_host_hands_its_rooms_over_and_gets_none(cluster: Cluster) -> None:
    cluster.serve("attic", "cellar")
    text, ok = cluster.directory.drain("aaaa", HOSTS)
    assert ok
    moved = next(start.room for start in cluster.started if start.host == "aaaa1111")
    assert f"its rooms move: {moved}" in text
    assert not cluster.directory.is_empty("aaaa1111")
    cluster.pass_by(2.0)
    assert cluster.directory.is_empty("aaaa1111")
    assert not cluster.directory.is_empty("bbbb2222"), "it is not drained"
    assert cluster.started[-1] == ProcessStart(moved, 2, "bbbb2222", b"job", f"{moved} 1")
    assert (cluster.directory.moved, cluster.directory.lost) == (1, 0)
    assert set(cluster.where().values()) == {"bbbb2222:1", "bbbb2222:2"}
    cluster.directory.offer({"hall": b""})
    cluster.pass_by(1.0)
    assert cluster.started[-1].host == "bbbb2222"
    text, ok = cluster.directory.drain("10.0.0.2", HOSTS)
    assert not ok
    assert "the last host that is left" in text


@pytest.mark.parametrize("host", ["10.0.0.9", "", "a", "192"])
def test_no_such_host_is_drained(cluster: Cluster, host: str) -> None:
    text, ok = cluster.directory.drain(host, HOSTS)
    assert not ok
    assert "10.0.0.1 (aaaa1111), 10.0.0.2 (bbbb2222)" in text


def test_a_start_that_fails_is_tried_again_elsewhere(cluster: Cluster) -> None:
    cluster.directory.offer({"attic": b""})
    cluster.living.clear()
    cluster.pass_by(START_S + 3.0)
    first, second = cluster.started
    assert (first.number, second.number) == (1, 2)
    assert first.host != second.host


def test_a_process_that_ends_is_replaced_at_once_and_one_that_cannot_begin_after_a_while(cluster: Cluster) -> None:
    cluster.serve("attic")
    (key, report), *_ = cluster.running.items()
    del cluster.running[key]
    assert not cluster.directory.report(report._replace(place="", ended=True), cluster.now_s)
    assert cluster.where() == {}
    cluster.pass_by(EVERY_S)
    assert [start.number for start in cluster.started] == [1, 2]
    assert cluster.started[1].host != cluster.started[0].host, "the other host is tried"
    cluster.running.clear()
    failed = Report("", "attic", 2, cluster.started[1].host, b"", ended=True)
    cluster.directory.report(failed._replace(number=3, ended=False), cluster.now_s)  # 3 is being started
    assert not cluster.directory.report(failed._replace(number=3), cluster.now_s)
    cluster.pass_by(RETRY_S - EVERY_S)
    assert len(cluster.started) == 2
    cluster.pass_by(3 * EVERY_S)
    assert cluster.started[-1].number == 4


def test_a_directory_that_has_just_begun_waits_for_hosts_that_have_not_reported() -> None:
    directory = Directory()
    directory.offer({"attic": b""})
    for step in range(round((SETTLE_S - EVERY_S) / EVERY_S)):
        assert directory.look(HOSTS, step * EVERY_S, all_reported=False) == []
    assert directory.look(HOSTS, SETTLE_S - EVERY_S, all_reported=True) != []


def test_a_pause_of_the_directory_is_no_death_of_a_room(cluster: Cluster) -> None:
    cluster.serve("attic")
    cluster.now_s += 100 * LOST_S
    cluster.pass_by(5.0)
    assert len(cluster.started) == 1
    assert cluster.directory.lost == 0
    assert LOST_S > GAP_S > EVERY_S


def test_a_directory_that_is_started_again_learns_where_the_rooms_are(cluster: Cluster) -> None:
    cluster.serve("attic")
    cluster.directory = Directory()
    cluster.serve("attic")
    assert len(cluster.started) == 1
    assert list(cluster.where()) == ["attic"]
    assert cluster.directory.offer({"attic": b"job"}) == ()
    assert cluster.directory.offer({"attic": b"another"}) == ("attic",)


def test_fronts_that_are_silent_are_forgotten() -> None:
    directory = Directory()
    assert directory.keep_front("10.0.0.1:1", 0.0) == ("10.0.0.1:1",)
    assert directory.keep_front("10.0.0.2:1", 0.25) == ("10.0.0.1:1", "10.0.0.2:1")
    assert not directory.leave_front("10.0.0.2:1")
    assert directory.keep_front("10.0.0.3:1", LOST_S) == ("10.0.0.3:1",)
    assert directory.leave_front("10.0.0.3:1")
