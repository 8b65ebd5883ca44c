"""`dev.py bench cluster`: a host of a Ray cluster is killed, another one is drained, while people hold in rooms.

Several raylets run on this machine, with rooms, fronts and people as real processes. Figures are of this one machine: they
share its processors.
"""

import signal
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np
from cyclopts import Parameter
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.recording.reader import open_recording
from cogrip.server.recorder import step_topic
from cogrip.sim.runs.records import End

from tests.bench.targets import reached
from tests.live.held_arms import Spoken
from tests.live.raylets import descendants, kill, raylet_of, raylets
from tests.live.test_cluster import Fronts, rooms_of
from tests.live.test_unauthenticated_peers import MOST_STEP_N, recording_of

BACK_S = 5.0  # within which everybody is asked to have resumed
MOST_RATIO = 1.5  # of the p99 after to the one before, within what two spans of a shared machine differ
FEW_US = 100.0  # a p99 below which no ratio is asked for
QUIET_S = 8.0
LOOK_S = 0.02
WIDTH = 120
RESUMED = "the server answers again"


class Result(msgspec.Struct, frozen=True):
    """Result of one loss of a host. late_us: worst p99 of the rooms that stayed, before and after."""

    what: str
    moved: int
    back_s: float
    step_n: float
    late_us: tuple[float, float]

    @property
    def well(self) -> bool:
        before_us, after_us = self.late_us
        return self.back_s <= BACK_S and self.step_n <= MOST_STEP_N and after_us <= max(MOST_RATIO * before_us, FEW_US)


def bench_cluster(
    *,
    hosts: int = 3,
    rooms: int = 4,
    quiet: Annotated[float, Parameter(name="--seconds")] = QUIET_S,
    checkpoints: Literal["folder", "memory"] = "folder",
    json: Json = None,
) -> int:
    """Kill a host of a cluster with -9, then drain another one, while a person holds in each room.

    Exit code 0 if everybody is back in 5 s, no force steps by more than 0.5 N, and the other rooms' p99 is unchanged.

    Parameters
    ----------
    hosts
        How many raylets, the head included.
    rooms
        How many, with a person each.
    quiet
        How long the rooms are measured before and after each loss [s].
    checkpoints
        Where those are: in the shared folder, or in the memory of two hosts.
    """
    within("--hosts", hosts, 2, 8)
    within("--rooms", rooms, 2, 16)
    within("--seconds", quiet, 2, 60)
    if sys.platform != "linux":
        raise Problem("a cluster needs Linux")
    console = make_console(stderr=json == "-")
    console.width = max(console.width, WIDTH)
    try:
        import ray  # noqa: F401
    except ImportError:
        raise Problem("this needs the package ray: python3 dev.py setup") from None
    started: list[Spoken] = []

    def start(*arguments: object) -> Spoken:
        started.append(Spoken(*map(str, arguments)))
        return started[-1]

    with ExitStack() as stack:
        stack.callback(_stop, started)
        base = Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="cogrip-bench-", ignore_cleanup_errors=True))
        )
        cluster = stack.enter_context(raylets(hosts - 1))
        try:
            losses, people = _lose_hosts(cluster, start, base, rooms, quiet, checkpoints)
            results = [_result(loss, people, base / "rooms", quiet) for loss in losses]
        except AssertionError as error:
            raise Problem(f"the session did not come to its end: {error}") from None
    console.print(_table(results))
    well = all(result.well for result in results)
    if json is not None:
        write_json({"losses": msgspec.to_builtins(results), "reached": well}, json)
    return 0 if well else 1


def _stop(started: Sequence[Spoken]) -> None:
    for process in reversed(started):
        process.stop()


def _lose_hosts(
    cluster: Any, start: Callable[..., Spoken], base: Path, rooms: int, quiet_s: float, checkpoints: str
) -> "tuple[list[Loss], dict[str, Spoken]]":
    """Kill a host that has rooms, and drain another one; then everybody leaves."""
    names = tuple(f"room{number}" for number in range(rooms))
    fronts = Fronts(start, base, cluster.address, names, "--checkpoints", checkpoints)
    people = {name: fronts.join(number % 2, name) for number, name in enumerate(names)}
    doomed = max(cluster.worker_nodes, key=lambda node: len(rooms_of(node)))
    losses = [_lose("kill -9", lambda: kill(descendants(raylet_of(doomed))), people, quiet_s)]
    drained = max(
        (node for node in cluster.list_all_nodes() if node is not doomed), key=lambda node: len(rooms_of(node))
    )
    losses.append(_lose("drain", lambda: fronts.ask(1, "drain", drained.node_id[:12]), people, quiet_s))
    for person in people.values():
        person.popen.send_signal(signal.SIGINT)
    for person in people.values():
        person.end()
    fronts.end()
    return losses, people


class Loss(NamedTuple):
    """One host that is gone. at_ns: Unix time; back_s: until force ramped in again, of each room that moved."""

    what: str
    at_ns: int
    back_s: dict[str, float]


def _lose(what: str, act: Callable[[], object], people: Mapping[str, Spoken], quiet_s: float) -> Loss:
    """Act after a quiet span, and follow who resumes until nobody can any more."""
    time.sleep(quiet_s)
    before = {name: person.said.count(RESUMED) for name, person in people.items()}
    at_ns, begun_s, back_s = time.time_ns(), time.monotonic(), {}
    act()
    while (passed_s := time.monotonic() - begun_s) < BACK_S + quiet_s:
        for name, person in people.items():
            if name not in back_s and person.said.count(RESUMED) > before[name]:
                back_s[name] = passed_s
        time.sleep(LOOK_S)
    ended = [name for name, person in people.items() if person.popen.poll() is not None]
    if ended or not back_s:
        words = [f"{name} ended: {people[name].said.strip().rpartition(chr(10))[2]}" for name in ended]
        raise Problem(f"{what}: " + ("; ".join(words) or "nobody had to move"))
    return Loss(what, at_ns, back_s)


def _result(loss: Loss, people: Mapping[str, Spoken], runs: Path, quiet_s: float) -> Result:
    """Read the steps of the forces and the lateness of the rooms that stayed from the recordings."""
    end_ns = loss.at_ns + int((BACK_S + quiet_s) * 1e9)
    step_n = 0.0
    for name in loss.back_s:
        end = recording_of(people[name])
        begin_s, end_s = ((at - end.recording.header.epoch_ns) * 1e-9 for at in (loss.at_ns, end_ns))
        columns = end.columns("tick", "tick", "force_n")
        here = (columns["time_s"] >= begin_s - 1) & (columns["time_s"] < end_s)
        ticks, forces_n = columns["tick"][here], columns["force_n"][here]
        steps_n = np.linalg.norm(np.diff(forces_n, axis=0), axis=1)[np.diff(ticks) == 1]
        step_n = max(step_n, float(np.max(steps_n)))
    late_us: tuple[list[float], list[float]] = ([], [])
    for path in runs.glob("**/server.mcap"):
        end = End(open_recording(path))
        for name in people.keys() - loss.back_s.keys():
            if step_topic(name) in end.recording.topics:
                columns = end.columns(step_topic(name), "late_us")
                since_s = columns["time_s"] - (loss.at_ns - end.recording.header.epoch_ns) * 1e-9
                for spans, here in zip(
                    late_us, ((-quiet_s < since_s) & (since_s < 0), (since_s >= 0) & (since_s < quiet_s)), strict=True
                ):
                    if here.any():
                        spans.append(float(np.percentile(columns["late_us"][here], 99)))
    if not all(late_us):
        raise Problem(f"{loss.what}: no room stayed where it was; give more --rooms")
    return Result(loss.what, len(loss.back_s), max(loss.back_s.values()), step_n, (max(late_us[0]), max(late_us[1])))


def _table(results: Sequence[Result]) -> Table:
    headings = (
        "host",
        "rooms moved",
        f"all back [s], asked {BACK_S:g}",
        f"largest step [N], asked {MOST_STEP_N:g}",
        "others' p99 late before, after [us]",
        "",
    )
    rows = [
        (each.what, f"{each.moved}", f"{each.back_s:.2f}", f"{each.step_n:.3f}",
         f"{each.late_us[0]:.0f}, {each.late_us[1]:.0f}", reached(each.well))
        for each in results
    ]  # fmt: skip
    return plain_table(headings, rows, left=1)
