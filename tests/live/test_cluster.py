"""Rooms on the hosts of a Ray cluster: real raylets, real fronts and people, real kills with -9, a drained host, orders."""

import json
import os
import re
import secrets
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.wire.join_link import parse_link

from tests.free_ports import free_port
from tests.live.held_arms import DEMO, Spoken, fairly, until
from tests.live.raylets import NODE, descendants, kill, ray_host, raylet_of, raylets
from tests.live.test_unauthenticated_peers import MOST_STEP_N, PULL, before_silence, largest_step_n, recording_of
from tests.live.university import University
from tests.stalls import MACHINE_STALLED

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="a cluster needs Linux"),
    pytest.mark.filterwarnings("ignore::Warning"),  # what ray itself warns of
]
ROOMS = ("attic", "cellar")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Start a cluster of one host, to which tests add others."""
    pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")
    with raylets(0) as alone:
        yield alone


@pytest.fixture
def other(cluster: Any) -> Iterator[Any]:
    """Start another host, for this test."""
    node = cluster.add_node(**NODE)
    yield node
    if node in cluster.worker_nodes:
        kill(descendants(raylet_of(node)))


class Fronts:
    """Two fronts of the rooms attic and cellar, each with a state folder of its own, and one shared by both."""

    def __init__(
        self, start: Callable[..., Spoken], base: Path, address: str, rooms: Sequence[str] = ROOMS, *flags: str
    ) -> None:
        self._start, self._base, self.rooms, self.shared = start, base, tuple(rooms), base / "shared"
        configs = []
        for name in rooms:
            configs.append(base / f"{name}.toml")
            configs[-1].write_text(DEMO.read_text("utf-8").replace('name = "demo"', f'name = "{name}"'), "utf-8")
        self.states = [base / "front-0", base / "front-1"]
        self.processes = []
        for state in self.states:
            self.processes.append(start(
                "serve", *configs, "--cluster", f"ray://{address}", "--encrypted", "--port", free_port(), "--state", state,
                "--shared", self.shared, "--seconds", "900", "--no-report", "--set", "link.delay_ms=0", "--runs",
                base / "rooms", *flags,
            ))  # fmt: skip
        for process in self.processes:
            for _ in rooms:
                process.hear(r"room \w+ is served at \S+")

    def link(self, front: int, room: str) -> str:
        """Return a player's link of this front."""
        found = re.search(rf"join {room} as player: .*'(cogrip:\S+)'", self.processes[front].said)
        assert found
        return found[1]

    def join(self, front: int, room: str, *arguments: str, link: str = "") -> Spoken:
        """Return a person in a room, by the link of this front, or another one."""
        runs = self._base / secrets.token_hex(4)
        person = self._start("join", link or self.link(front, room), "--no-report", "--runs", runs, *arguments, *PULL)
        person.runs = runs
        person.hear(f"holds cube in room {room}")
        return person

    def ask(self, front: int, *words: object) -> str:
        """Return what an administrator's command says."""
        asked = self._start(*words, "--state", self.states[front])
        assert asked.end() == 0, asked.said
        return asked.said

    def end(self) -> None:
        """End both; the last ends the rooms."""
        for process in self.processes:
            process.popen.send_signal(signal.SIGINT)
        for process in self.processes:
            process.end()


@pytest.fixture
def serve(start, tmp_path, cluster) -> Iterator[Callable[..., Fronts]]:
    """Return a function that starts fronts, given rooms and flags; they are ended after the test, and the rooms with them."""
    started: list[Fronts] = []

    def fronts(rooms: Sequence[str] = ROOMS, *flags: str) -> Fronts:
        started.append(Fronts(start, tmp_path, cluster.address, rooms, *flags))
        return started[-1]

    yield fronts
    for each in started:
        each.end()


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


def home_of(fronts: Fronts, room: str) -> str:
    """Return where a front says a room is served."""
    return re.findall(rf"room {room} is served at (\S+)", fronts.processes[0].said)[-1]


def announced_pid(fronts: Fronts, room: str) -> int:
    """Return the process that serves a room, as it announces itself."""
    return int(json.loads((fronts.shared / f"room-{room}.json").read_bytes())["pid"])


def terminate(node: Any) -> None:
    """Send SIGTERM to each process of a host, as a service manager does."""
    for pid in descendants(raylet_of(node)):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)


def rooms_of(node: Any) -> list[int]:
    """Return the processes of rooms, and their template, on a host."""
    return processes_of_rooms(raylet_of(node))


def processes_of_rooms(leader: int) -> list[int]:
    """Return those of them that descend from this process."""
    return [pid for pid in descendants(leader) if b"cluster_room" in Path(f"/proc/{pid}/cmdline").read_bytes()]


@fairly
@pytest.mark.parametrize("checkpoints", ["folder", "memory"])
def test_a_host_is_killed_and_its_people_resume_elsewhere_by_any_front(start, serve, cluster, other, checkpoints):
    fronts = serve(ROOMS, "--checkpoints", checkpoints)
    people = {room: fronts.join(number, room) for number, room in enumerate(ROOMS)}
    homes = {room: home_of(fronts, room) for room in ROOMS}
    who = fronts.ask(1, "who")
    assert all(room in who for room in ROOMS), "each front sees all hosts"
    kept = [fronts.shared / f"checkpoint-{room}.bin" for room in ROOMS]
    if checkpoints == "folder":
        until(lambda: all(path.exists() for path in kept), "checkpoints are in the folder")
    assert [path.exists() for path in kept] == [checkpoints == "folder"] * 2
    if len(rooms_of(other)) < 2:
        pytest.skip(f"{MACHINE_STALLED}: a host was not ready when the rooms were placed")
    kill(descendants(raylet_of(other)))
    moved = fronts.processes[0].hear(r"room (\w+) is served at")[1]
    person = people.pop(moved)
    person.hear("resumed after")
    person.hear("the server answers again: force ramps in")
    fronts.processes[1].hear(f"{moved}: restored: the object is at .* seats are kept for anna")
    assert home_of(fronts, moved) != homes[moved]
    (stayed,) = people.values()
    assert "trying to resume" not in stayed.said
    assert "2 in 2 rooms" in fronts.ask(0, "who")
    leave(person)


@fairly
def test_a_host_is_drained_and_nobody_loses_a_seat(start, serve, cluster, other):
    rooms = ("attic", "cellar", "hall", "porch")
    fronts = serve(rooms)
    people = [fronts.join(number % 2, room) for number, room in enumerate(rooms)]
    host = other if len(rooms_of(other)) > 1 else cluster.head_node
    said = fronts.ask(1, "drain", host.node_id[:12])
    moved = re.search(r"its rooms move: (.*)", said)
    assert moved, said
    moving = [each for each in people if any(f"in room {room}" in each.said for room in moved[1].split(", "))]
    assert moving
    for person in moving:
        person.hear("resumed after")
        person.hear("the server answers again: force ramps in")
    assert "4 in 4 rooms" in fronts.ask(0, "who")
    leave(*moving)


@fairly
def test_a_host_whose_ray_gets_sigterm_is_drained_before_ray_ends(start, tmp_path, cluster):
    """`ray start --block`, as the first process of a container, gets it alone; all others end with it at once."""
    with ray_host(os.environ, f"--address={cluster.address}", "--num-cpus=8") as host:
        until(lambda: len(cluster.global_state.node_table()) > 1, "Ray knows the host")
        fronts = Fronts(start, tmp_path, cluster.address)
        people = {room: fronts.join(number, room) for number, room in enumerate(ROOMS)}
        there = processes_of_rooms(host.pid)
        moving = [person for room, person in people.items() if announced_pid(fronts, room) in there]
        if not moving:
            pytest.skip(f"{MACHINE_STALLED}: the host was not ready when the rooms were placed")
        host.terminate()
        for person in moving:
            person.hear("resumed after")
            person.hear("the server answers again: force ramps in")
        until(lambda: host.poll() is not None, "Ray has ended by itself")
    assert "2 in 2 rooms" in fronts.ask(0, "who")
    leave(*moving)
    fronts.end()
    for front in fronts.processes:
        assert "room lost with its host" not in front.said


@fairly
def test_a_host_that_gets_sigterm_hands_its_rooms_over(start, serve, cluster, other):
    """A service manager sends it to each process of the host at once: Ray's, the actor's, the rooms', the recorders'."""
    fronts = serve()
    people = {room: fronts.join(number, room) for number, room in enumerate(ROOMS)}
    if len(rooms_of(other)) < 2:
        pytest.skip(f"{MACHINE_STALLED}: a host was not ready when the rooms were placed")
    terminate(other)
    moved = fronts.processes[0].hear(r"room (\w+) is served at")[1]
    person = people.pop(moved)
    person.hear("resumed after")
    person.hear("the server answers again: force ramps in")
    (stayed,) = people.values()
    assert "trying to resume" not in stayed.said
    assert "2 in 2 rooms" in fronts.ask(0, "who")
    until(lambda: not rooms_of(other), "the processes of the host's rooms have ended")
    leave(person)


@fairly
def test_rooms_are_administered_by_any_front(start, serve, cluster, tmp_path):
    first = free_port()
    fronts = serve(ROOMS, "--room-ports", f"{first}-{first + 60}")
    for room in ROOMS:
        assert first <= int(home_of(fronts, room).rpartition(":")[2]) <= first + 60
    made = fronts.ask(1, "token", "new", "--room", "cellar", "--name", "ben")
    token = re.search(r"'?(cogrip:\S+?)'?\s", made)
    assert token, made
    anna = fronts.join(0, "attic")
    ben = fronts.join(1, "cellar", link=token[1])
    for process in fronts.processes:
        process.hear(r"attic: anna joined")
        process.rewind()
        process.hear(r"cellar: ben joined")
    assert "1 in 1 room" in fronts.ask(1, "who", "--room", "attic")
    assert "marked in 2 rooms: the lamp goes on" in fronts.ask(1, "mark", "the lamp goes on")
    fronts.processes[0].hear("the lamp goes on")
    said = fronts.ask(1, "set", "anna", "force_scale=0.5")
    assert "anna" in said
    anna.hear("force")
    listed = fronts.ask(0, "token", "list")
    ident = next(line.split()[0] for line in listed.splitlines() if "ben" in line)
    assert "tokens were read again in 2 rooms" in fronts.ask(0, "token", "revoke", ident)
    ben.hear("revoked")
    assert ben.end() == 1
    university = University(tmp_path, "uni")
    assert "read again in 2 rooms" in fronts.ask(0, "token", "keys", "add", university.public, "--kid", university.kid)
    link, jti = university.mint(parse_link(token[1]), "--seat", "ben")
    ben = fronts.join(1, "cellar", link=link)
    listed = fronts.ask(1, "token", "list")
    assert re.search(rf"{jti}  good +ben ", listed), listed
    fronts.ask(1, "token", "keys", "remove", university.kid)
    ben.hear("revoked")
    assert ben.end() == 1
    assert "anna was kicked" in fronts.ask(1, "kick", "anna", "--room", "attic")
    anna.hear("kicked")


@fairly
def test_rooms_that_find_no_port_say_so_at_the_front(start, tmp_path, cluster):
    port = free_port()
    config = tmp_path / "one.toml"
    config.write_text(DEMO.read_text("utf-8"), "utf-8")
    other = tmp_path / "two.toml"
    other.write_text(DEMO.read_text("utf-8").replace('name = "demo"', 'name = "two"'), "utf-8")
    front = start(
        "serve", config, other, "--cluster", f"ray://{cluster.address}", "--port", free_port(), "--state", tmp_path / "state",
        "--seconds", "900", "--no-report", "--runs", tmp_path / "runs", "--room-ports", f"{port}-{port}",
    )  # fmt: skip
    front.hear(rf"room (\w+) is served at \S+:{port}")
    front.rewind()
    front.hear(rf"room \w+: none of the UDP ports {port}-{port} is free at 127.0.0.1, .*: give more --room-ports")
    front.popen.send_signal(signal.SIGINT)
    front.end()


@fairly
def test_the_directory_is_killed_and_nobody_notices(start, serve, cluster):
    fronts = serve()
    anna = fronts.join(0, "attic")
    homes = [home_of(fronts, room) for room in ROOMS]
    listed = subprocess.run(["ps", "-eo", "pid,args"], capture_output=True, text=True, check=True).stdout.splitlines()
    directories = [int(line.split()[0]) for line in listed if "ray::DirectoryActor" in line]
    kill([pid for pid in directories if pid in descendants(raylet_of(cluster.head_node))])
    fronts.processes[0].hear("the directory of the cluster is silent")
    fronts.join(1, "cellar")
    fronts.processes[0].hear("the directory of the cluster answers again")
    assert "2 in 2 rooms" in fronts.ask(1, "who")
    assert [home_of(fronts, room) for room in ROOMS] == homes
    assert "trying to resume" not in anna.said
