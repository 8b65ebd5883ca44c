"""The head of a cluster is killed: seated people go on without Ray, newcomers find them, a new head gets the rooms."""

import signal
import sys
from pathlib import Path

import pytest

from tests.live.held_arms import fairly, until
from tests.live.raylets import Apart, kill
from tests.live.test_cluster import Fronts, leave

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="a cluster needs Linux"),
    pytest.mark.filterwarnings("ignore::Warning"),  # what ray itself warns of
]
RECONNECT_S = 10  # for which raylets and drivers wait for their head; else Ray waits a minute


@pytest.fixture
def apart(monkeypatch):
    """Return a function that starts a cluster at a port."""
    pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")
    monkeypatch.setenv("RAY_gcs_rpc_server_reconnect_timeout_s", str(RECONNECT_S))
    started = []

    def begin(port: int = 0) -> Apart:
        started.append(Apart(port))
        return started[-1]

    yield begin
    for each in started:
        each.stop()


def ended(pid: int) -> bool:
    """Return whether a process has ended, whether or not anybody has asked for its exit code."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def headless(start, tmp_path, apart):
    """Return a cluster whose head was killed, its fronts, and a person in each room."""
    first = apart()
    fronts = Fronts(start, tmp_path, first.address)
    people = {room: fronts.join(number, room) for number, room in enumerate(fronts.rooms)}
    kill(first.head)
    for process in fronts.processes:
        process.hear("the directory of the cluster is silent: rooms and their people go on")
    until(lambda: ended(first.raylet), "the other raylet ends without its head")
    return first, fronts, people


@fairly
def test_the_head_is_killed_and_seated_people_go_on_without_ray(start, tmp_path, apart):
    _, fronts, people = headless(start, tmp_path, apart)
    announced = [fronts.shared / f"room-{room}.json" for room in fronts.rooms]
    until(lambda: all(b'"alone"' in path.read_bytes() for path in announced), "both rooms go on alone")
    for person in people.values():
        assert person.popen.poll() is None
        assert "trying to resume" not in person.said, "nobody notices"
    ben = fronts.join(1, "attic", "--name", "ben")
    asked = start("who", "--state", fronts.states[0])
    assert asked.end() == 1
    assert "the cluster is silent" in asked.said
    for person in (*people.values(), ben):
        person.popen.send_signal(signal.SIGINT)
    for person in (*people.values(), ben):
        assert person.end() == 0
    until(lambda: all(b'"ended"' in path.read_bytes() for path in announced), "rooms end once nobody is there")


@fairly
def test_a_head_that_is_started_again_gets_the_rooms_with_their_people(start, tmp_path, apart):
    first, fronts, people = headless(start, tmp_path, apart)
    first.stop()
    again = apart(int(first.address.rpartition(":")[2]))
    assert again.address == first.address
    for process in fronts.processes:
        process.hear("the directory of the cluster answers again")

    def told() -> bool:
        asked = start("who", "--state", fronts.states[0])
        return asked.end() == 0 and "2 in 2 rooms" in asked.said and all(room in asked.said for room in fronts.rooms)

    until(told, "an administrator sees both people again")
    leave(*people.values())
    fronts.end()
