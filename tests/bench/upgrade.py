"""`dev.py bench upgrade`: the hosts of a Ray cluster are started anew one after the other, while people hold in rooms.

Each host is drained, ended by SIGTERM to all of its processes, as a service manager does, and started again. The head is the
last: Ray does not survive it, so rooms go on alone meanwhile, and all hosts are started again under them.
"""

import os
import re
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within
from cogrip.cli.terminal.tables import plain_table

from tests.bench.losses import RESUMED, commands, let_go
from tests.bench.targets import reached
from tests.live.held_arms import Spoken
from tests.live.raylets import NODE, raylets
from tests.live.test_cluster import Fronts, rooms_of, terminate
from tests.live.test_unauthenticated_peers import MOST_STEP_N, recording_of

PER_ROOM = 2
RECONNECT_S = "10"
"""Time for which raylets wait for their head; else Ray waits a minute."""
LIMIT_S = 120.0
QUIET_S = 3.0


class Step(msgspec.Struct, frozen=True):
    """Outcome for one host. silence_s: longest one until a person had resumed; at_ns: Unix time of its begin."""

    what: str
    at_ns: int
    moved: int
    silence_s: float


def bench_upgrade(*, hosts: int = 3, people: int = 20, device_hz: int = 1024, json: Json = None) -> int:
    """Start every host of a cluster anew while people hold, the head last.

    Exit code 0 if nobody loses the seat, and no force steps by more than 0.5 N.

    Parameters
    ----------
    hosts
        How many raylets, the head included.
    people
        How many, two in a room.
    device_hz
        Rate of their device loops.
    """
    within("--hosts", hosts, 2, 8)
    within("--people", people, 2, 100)
    if sys.platform != "linux":
        raise Problem("a cluster needs Linux")
    console = make_console(stderr=json == "-")
    os.environ |= {"RAY_gcs_rpc_server_reconnect_timeout_s": RECONNECT_S}
    with commands() as (start, base), raylets(hosts - 1) as cluster:
        try:
            steps, everybody, end_ns = _upgrade(cluster, start, base, people, device_hz, console.print)
            bounds_ns = [*(step.at_ns for step in steps), end_ns]
            forces = {name: _steps_n(person, bounds_ns) for name, person in everybody.items()}
        except AssertionError as error:
            raise Problem(f"the session did not come to its end: {error}") from None
    rows, worst_n = [], 0.0
    for number, step in enumerate(steps):
        step_n = max(each[number] for each in forces.values())
        worst_n = max(worst_n, step_n)
        rows.append((step.what, f"{step.moved}", f"{step.silence_s:.1f}", f"{step_n:.3f}"))
    heading = "", "people\nmoved", "longest\nsilence [s]", f"largest step [N],\nasked {MOST_STEP_N:g}"
    console.print(plain_table(heading, rows, left=1))
    well = worst_n <= MOST_STEP_N
    console.print(f"{people} people, {hosts} hosts: nobody lost the seat; steps of force {reached(well)}")
    if json is not None:
        write_json({"steps": msgspec.to_builtins(steps), "forces_n": forces, "reached": well}, json)
    return 0 if well else 1


def _upgrade(
    cluster: Any, start: Callable[..., Spoken], base: Path, people: int, device_hz: int, say: Callable[[str], None]
) -> tuple[list[Step], dict[str, Spoken], int]:
    """Take down and start again every host. Returns also when the people were asked to leave (Unix time).

    Raises Problem where somebody loses the seat.
    """
    rooms = tuple(f"room{number}" for number in range((people + PER_ROOM - 1) // PER_ROOM))
    fronts = Fronts(start, base, cluster.address, rooms, "--set", f"rates.device_hz={device_hz}")
    everybody = {}
    for number in range(people):
        room, name = rooms[number // PER_ROOM], ("anna", "ben")[number % PER_ROOM]
        everybody[f"{room} {name}"] = fronts.join(number % 2, room, "--name", name)
    steps: list[Step] = []

    def step(what: str, act: Callable[[], Iterable[str]]) -> None:
        """Act, which returns the rooms that move, and wait until everybody there is back."""
        _wait(lambda: True, everybody, "", QUIET_S)
        before = {name: person.said.count(RESUMED) for name, person in everybody.items()}
        heard = {name: len(person.said) for name, person in everybody.items()}
        at_ns = time.time_ns()
        moved = set(act())
        moving = [name for name in everybody if name.partition(" ")[0] in moved]
        _wait(
            lambda: all(everybody[name].said.count(RESUMED) > before[name] for name in moving), everybody, what, QUIET_S
        )
        silences = [
            float(taken)
            for name, person in everybody.items()
            for taken in re.findall(r"resumed after ([0-9.]+) s", person.said[heard[name] :])
        ]
        steps.append(Step(what, at_ns, len(moving), max(silences, default=0.0)))
        say(f"{what}: {len(moving)} people moved, silent for at most {steps[-1].silence_s:.1f} s")

    def drain(node: Any) -> list[str]:
        found = re.search(r"its rooms move: (.*)", fronts.ask(1, "drain", node.node_id[:12]))
        return found[1].split(", ") if found else []

    def replace(node: Any) -> None:
        terminate(node)
        cluster.remove_node(node)
        new = cluster.add_node(**NODE)
        _wait(lambda: bool(rooms_of(new)), everybody, "the host that was started again is ready for rooms")

    for number, node in enumerate(list(cluster.worker_nodes)):
        step(f"host {number + 1} drained", partial(drain, node))
        replace(node)
    head, port = cluster.head_node, int(cluster.address.rpartition(":")[2])
    step("head drained", lambda: drain(head))
    others = list(cluster.worker_nodes)

    def start_head() -> tuple[str, ...]:
        cluster.remove_node(head)
        for front in fronts.processes:
            front.hear("the directory of the cluster is silent")
        for node in others:
            terminate(node)
            cluster.remove_node(node)
        cluster.add_node(**NODE, gcs_server_port=port)
        for _ in others:
            cluster.add_node(**NODE)
        return rooms

    step("head and then all hosts started again", start_head)
    end_ns = time.time_ns()
    let_go(everybody)
    fronts.end()
    return steps, everybody, end_ns


def _wait(good: Callable[[], bool], everybody: dict[str, Spoken], what: str, quiet_s: float = 0.0) -> None:
    """Wait until something is so, and then for a while. Raises Problem where somebody's client has ended."""
    begun_s, good_s = time.monotonic(), None
    while good_s is None or time.monotonic() - good_s < quiet_s:
        ended = [name for name, person in everybody.items() if person.popen.poll() is not None]
        if ended:
            words = [f"{name}: {everybody[name].said.strip().rpartition(chr(10))[2]}" for name in ended]
            raise Problem(f"{what or 'meanwhile'}: lost the seat: {'; '.join(words)}")
        if good_s is None and good():
            good_s = time.monotonic()
        if good_s is None and time.monotonic() - begun_s > LIMIT_S:
            raise Problem(f"not within {LIMIT_S:g} s: {what}")
        time.sleep(0.05)


def _steps_n(person: Spoken, bounds_ns: list[int]) -> list[float]:
    """Return the largest change of the force between two ticks that follow each other, in each step of the upgrade [N]."""
    end = recording_of(person)
    columns = end.columns("tick", "tick", "force_n")
    steps_n = np.linalg.norm(np.diff(columns["force_n"], axis=0), axis=1)
    follows, since_s = np.diff(columns["tick"]) == 1, columns["time_s"][1:]
    bounds_s = [(at_ns - end.recording.header.epoch_ns) * 1e-9 for at_ns in bounds_ns]
    spans = [follows & (since_s >= first) & (since_s < last) for first, last in pairwise(bounds_s)]
    return [float(np.max(steps_n[span], initial=0.0)) for span in spans]
