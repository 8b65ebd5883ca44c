"""Rooms on the hosts of a Ray cluster: two real raylets, real fronts and people, a real kill -9, a drained host."""

import os
import re
import secrets
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.free_ports import free_port
from tests.live.held_arms import DEMO, Spoken, fairly
from tests.live.test_unauthenticated_peers import MOST_STEP_N, PULL, before_silence, largest_step_n, recording_of

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="a cluster needs Linux"),
    pytest.mark.filterwarnings("ignore::Warning"),  # what ray itself warns of
]
NODE = {"num_cpus": 1, "object_store_memory": 100 * 1024 * 1024, "include_dashboard": False}
ROOMS = ("attic", "cellar")


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_agent_register_timeout_ms", "120000")  # a raylet ends where its agent takes 30 s to start
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ray.cluster_utils import Cluster
    both = Cluster(initialize_head=True, head_node_args=NODE)
    yield both
    both.shutdown()


class Fronts:
    """Two fronts of the rooms attic and cellar, each with a state folder of its own, and one shared by both."""

    def __init__(self, start: Callable[..., Spoken], base: Path, address: str, rooms: Sequence[str] = ROOMS) -> None:
        self._start, self._base = start, base
        configs = []
        for name in rooms:
            configs.append(base / f"{name}.toml")
            configs[-1].write_text(DEMO.read_text("utf-8").replace('name = "demo"', f'name = "{name}"'), "utf-8")
        self.states = [base / "front-0", base / "front-1"]
        self.processes = []
        for state in self.states:
            self.processes.append(start(
                "serve", *configs, "--cluster", f"ray://{address}", "--seal", "--port", free_port(), "--state", state,
                "--shared", base / "shared", "--seconds", "900", "--no-report", "--set", "link.delay_ms=0", "--runs",
                base / "rooms",
            ))  # fmt: skip
            self.processes[-1].hear(rf"(?s)(room \w+ is served at \S+.*?){{{len(rooms)}}}")

    def join(self, front: int, room: str) -> Spoken:
        """Return a person in a room, by the link of this front."""
        found = re.search(rf"join {room} as player: .*'(cogrip:\S+)'", self.processes[front].said)
        assert found
        runs = self._base / secrets.token_hex(4)
        person = self._start("join", found[1], "--no-report", "--runs", runs, *PULL)
        person.runs = runs
        person.hear(f"holds cube in room {room}")
        return person

    def ask(self, front: int, *words: object) -> str:
        """Return what an administrator's command says."""
        asked = self._start(*words, "--state", self.states[front])
        assert asked.end() == 0, asked.said
        return asked.said


def descendants(pid: int) -> list[int]:
    """Return a process and all that it, and they, have started."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
            children.setdefault(parent, []).append(int(entry.name))
    found, todo = [], [pid]
    while todo:
        found.append(todo.pop())
        todo += children.get(found[-1], [])
    return found


def leave(*people: Spoken) -> None:
    for person in people:
        person.popen.send_signal(signal.SIGINT)
    for person in people:
        person.end()
        end = recording_of(person)
        step_n = largest_step_n(end, before_silence(end))
        print(*re.findall(r"resumed after [0-9.]+ s", person.said))
        print(f"largest step of the force from before the silence on: {step_n:.3f} N")
        assert step_n < MOST_STEP_N


@fairly
def test_a_host_is_killed_and_its_people_resume_elsewhere_by_any_front(start, tmp_path, cluster):
    doomed = cluster.add_node(**NODE)
    fronts = Fronts(start, tmp_path, cluster.address)
    people = {room: fronts.join(number, room) for number, room in enumerate(ROOMS)}
    who = fronts.ask(1, "who")
    assert all(room in who for room in ROOMS), "each front sees all hosts"
    for process in descendants(doomed.all_processes["raylet"][0].process.pid):
        os.kill(process, signal.SIGKILL)
    moved = fronts.processes[0].hear(r"room (\w+) is served at")[1]
    person = people.pop(moved)
    person.hear("resumed after")
    person.hear("the server answers again: force ramps in")
    (other,) = people.values()
    assert "trying to resume" not in other.said
    assert "2 in 2 rooms" in fronts.ask(0, "who")
    leave(person)


@fairly
def test_a_host_is_drained_and_nobody_loses_a_seat(start, tmp_path, cluster):
    cluster.add_node(**NODE)
    fronts = Fronts(start, tmp_path, cluster.address)
    people = [fronts.join(number, room) for number, room in enumerate(ROOMS)]
    said = fronts.ask(1, "drain", cluster.head_node.node_id[:12])
    moved = re.search(r"its rooms move: (\w+)", said)
    assert moved, said
    (person,) = [each for each in people if f"in room {moved[1]}" in each.said]
    person.hear("resumed after")
    person.hear("the server answers again: force ramps in")
    fronts.processes[1].hear(f"room {moved[1]} is served at")
    assert "2 in 2 rooms" in fronts.ask(0, "who")
    assert "anna was kicked" in fronts.ask(0, "kick", "anna", "--room", moved[1])
    person.hear("kicked")
    leave(person)
