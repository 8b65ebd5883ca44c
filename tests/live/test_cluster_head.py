"""The head of a cluster is killed: seated people go on without Ray, and a head that is started anew takes their rooms over."""

import os
import re
import sys

import pytest

from tests.live.held_arms import fairly, until
from tests.live.raylets import descendants, kill, raylet_of, raylets
from tests.live.test_cluster import Fronts, home_of, leave

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="a cluster needs Linux"),
    pytest.mark.filterwarnings("ignore::Warning"),  # what ray itself warns of
]
RECONNECT_S = 5  # for which a raylet and a driver wait for their head; else Ray waits a minute


@fairly
def test_the_head_is_killed_and_started_again(start, tmp_path, monkeypatch):
    pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")
    monkeypatch.setenv("RAY_gcs_rpc_server_reconnect_timeout_s", str(RECONNECT_S))
    with raylets(1) as cluster:
        address, head = cluster.address, cluster.head_node
        (node,) = cluster.worker_nodes
        fronts = Fronts(start, tmp_path, address)
        people = {room: fronts.join(number, room) for number, room in enumerate(fronts.rooms)}
        homes = {room: home_of(fronts, room) for room in fronts.rooms}
        begun = {room: people[room].said.count("trying to resume") for room in fronts.rooms}
        on_head = descendants(raylet_of(head))
        kill([*(each.process.pid for kind in head.all_processes.values() for each in kind)])
        for process in fronts.processes:
            process.hear("the directory of the cluster is silent: rooms and their people go on")
        until(
            lambda: not os.path.exists(f"/proc/{raylet_of(node)}") or zombie(raylet_of(node)), "the other raylet ends"
        )
        until(
            lambda: all(b'"alone"' in (fronts.shared / f"room-{room}.json").read_bytes() for room in fronts.rooms),
            "both rooms go on alone",
        )
        assert on_head
        for room, person in people.items():
            assert person.popen.poll() is None
            assert person.said.count("trying to resume") == begun[room], "nobody notices"
        with raylets(1, port=int(address.rpartition(":")[2])):
            for process in fronts.processes:
                process.hear("the directory of the cluster answers again")
            for room, person in people.items():
                person.hear("resumed after")
                person.hear("the server answers again: force ramps in")
                assert home_of(fronts, room) != homes[room]
            assert "2 in 2 rooms" in fronts.ask(0, "who")
            leave(*people.values())
            for process in fronts.processes:
                process.stop()


def zombie(pid: int) -> bool:
    """Return whether a process has ended, and nobody has asked for its exit code."""
    with open(f"/proc/{pid}/stat") as stat:
        return re.sub(r".*\) ", "", stat.read()).startswith("Z")
