"""Parts of a cluster without Ray: lines, replicas, announcements, ports, checkpoints, homes without a directory."""

import socket
import threading
from pathlib import Path

import pytest

from cogrip.server.checkpoint import RoomCheckpoint, encode
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.announcement import AnnouncementFile
from cogrip.server.hosting.cluster.connection import found_homes
from cogrip.server.hosting.cluster.directory import Home
from cogrip.server.hosting.cluster.guard import Guard
from cogrip.server.hosting.cluster.lines import GatheredLines, Lines
from cogrip.server.hosting.cluster.replicas import KEPT_S, LATEST_S, NOTHING, Kept, Replicas, gather, newest, next_host
from cogrip.server.hosting.cluster.room_checkpoints import newest as newest_checkpoint
from cogrip.server.io.state_folder import StateFolder, make_folder
from cogrip.server.io.udp_port import PortRange, ServeError, UdpPort

from tests.server.patience import until


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    return make_folder(tmp_path / "state")


def line(number: int) -> ServerEvent:
    return ServerEvent("notice", f"line {number}")


def test_lines_are_told_once_and_the_oldest_go_first() -> None:
    lines = Lines(most=3)
    assert lines.since(0) == (0, [])
    for number in range(5):
        lines.add(line(number))
    assert lines.since(0) == (2, [line(2), line(3), line(4)])
    assert lines.since(4) == (4, [line(4)])
    assert lines.since(5) == (5, [])


def test_gathered_lines_hear_a_repetition_once_and_a_source_that_begins_anew() -> None:
    gathered = GatheredLines()
    assert gathered.take("a", 0, [line(0), line(1)]) == 2
    assert gathered.take("a", 0, [line(0), line(1), line(2)]) == 3, "its answer was lost"
    assert gathered.take("b", 7, [line(7)]) == 8, "another directory has the lines before"
    assert gathered.take("a", 0, [line(3)]) == 1, "its actor was started again"
    assert [each.text for each in gathered.all.since(0)[1]] == [f"line {number}" for number in (0, 1, 2, 7, 3)]


def test_a_host_sends_what_another_does_not_have() -> None:
    replicas, first = Replicas(), Kept(1, 1, b"1")
    replicas.keep({"attic": first, "of another": first})
    assert replicas.to_send("b", ["attic"]) == {"attic": first}
    replicas.sent({"attic": first})
    assert replicas.to_send("b", ["attic"]) == {}
    assert replicas.to_send("c", ["attic"]) == {"attic": first}, "another host has nothing yet"
    replicas.sent({"attic": first})
    replicas.keep({"attic": Kept(1, 2, b"2")})
    replicas.keep({"attic": first})
    assert replicas.to_send("c", ["attic"]) == {"attic": Kept(1, 2, b"2")}, "an older one replaces none"
    assert replicas.get("cellar") == NOTHING == newest([])
    assert newest([Kept(1, 900, b"a"), Kept(2, 1, b"b"), NOTHING]) == Kept(2, 1, b"b"), "of the latest process"


@pytest.mark.parametrize(
    ("own", "answers", "found", "waited_s"),
    [
        (NOTHING, [([], 0)], NOTHING, KEPT_S),
        (NOTHING, [([NOTHING, Kept(1, 3, b"3")], 1)], Kept(1, 3, b"3"), KEPT_S),
        (Kept(1, 2, b"2"), [([], 1)], Kept(1, 2, b"2"), KEPT_S),
        (Kept(1, 2, b"2"), [([Kept(1, 3, b"3")], 1)], Kept(1, 3, b"3"), KEPT_S),
        (Kept(1, 2, b""), [([NOTHING], 1)], Kept(1, 2, b""), KEPT_S),
        (NOTHING, [([NOTHING], 1), ([Kept(1, 3, b"3")], 0)], Kept(1, 3, b"3"), LATEST_S),
        (NOTHING, [([NOTHING], 1), ([], 1)], NOTHING, LATEST_S),
    ],
    ids=["none", "another's", "own", "newer", "none is needed", "late", "never"],
)
def test_a_host_that_may_have_the_only_checkpoint_is_waited_for(
    own: Kept, answers: list[tuple[list[Kept], int]], found: Kept, waited_s: float
) -> None:
    limits: list[float] = []

    def come(limit_s: float) -> tuple[list[Kept], int]:
        limits.append(limit_s)
        return answers[len(limits) - 1]

    assert gather(own, come) == found
    assert sum(limits) == waited_s


@pytest.mark.parametrize(
    ("host", "hosts", "to"), [("a", "abc", "b"), ("c", "abc", "a"), ("a", "a", ""), ("b", "ac", "c")]
)
def test_checkpoints_go_round_a_ring_of_hosts(host: str, hosts: str, to: str) -> None:
    assert next_host(host, hosts) == to


def test_a_room_that_nobody_directs_is_claimed_and_handed_over(folder: StateFolder) -> None:
    before = Guard(folder, "attic", 1)
    before.serve("10.0.0.1:1")
    file = AnnouncementFile(folder, "attic")
    until(lambda: file.read() is not None)
    before.note_directory(answers=False)
    until(lambda: (found := file.read()) is not None and found.state == "alone")
    after = Guard(folder, "attic", 1)
    assert after.number == 2, "a directory that has just begun counts from 1"
    claiming = threading.Thread(target=after.claim)
    claiming.start()
    until(lambda: before.claimed == "hand over")
    before.ended()
    claiming.join()
    after.serve("10.0.0.2:2")
    until(lambda: (found := file.read()) is not None and (found.place, found.state) == ("10.0.0.2:2", "served"))
    before.close(remove=False)
    after.close(remove=True)
    assert file.read() is None


def test_a_process_that_is_cut_off_ends_once_another_serves(folder: StateFolder) -> None:
    before = Guard(folder, "attic", 1)
    before.serve("10.0.0.1:1")
    before.note_directory(answers=False)
    AnnouncementFile(folder, "attic").write(2, "10.0.0.2:2", "served")
    until(lambda: before.claimed == "lost")
    before.close(remove=False)
    found = AnnouncementFile(folder, "attic").read()
    assert found is not None
    assert (found.number, found.place) == (2, "10.0.0.2:2"), "it leaves the announcement of the other"


def test_a_front_without_a_directory_finds_rooms_by_their_announcements(folder: StateFolder) -> None:
    for room, number, state in (("attic", 3, "alone"), ("cellar", 1, "served"), ("hall", 5, "ended")):
        AnnouncementFile(folder, room).write(number, f"10.0.0.1:{number}", state)  # type: ignore[arg-type]
    (folder.shared / "room-porch.json").write_text("{", "utf-8")
    known = {"cellar": Home("host b", "10.0.0.2:9", ("anna",), b"", 2)}
    found = found_homes(folder, ("attic", "cellar", "hall", "porch", "yard"), known)
    assert found == {"attic": Home("", "10.0.0.1:3", (), b"", 3), **known}


def test_a_room_takes_a_free_port_of_the_range_and_says_when_there_is_none() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = int(taken.getsockname()[1])
        there = UdpPort("127.0.0.1", 0, PortRange(port, min(port + 100, 65535)))
        assert port < there.place[1] <= port + 100
        there.close()
        with pytest.raises(ServeError, match=f"none of the UDP ports {port}-{port} is free .*: give more --room-ports"):
            UdpPort("127.0.0.1", 0, PortRange(port, port))


def test_a_room_begins_from_the_later_checkpoint() -> None:
    early, late = (encode(RoomCheckpoint(1, "attic", "", (0.0,), 0.0, steps, ())) for steps in (5, 9))
    assert newest_checkpoint(early, late) == newest_checkpoint(late, early) == late
    assert newest_checkpoint(b"{", early) == early
    assert newest_checkpoint(None, b"{") == b"{", "its trouble is reported"
    assert newest_checkpoint(None, None) is None
