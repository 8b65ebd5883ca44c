"""`dev.py bench network`: people whom one core serves, encrypted and not, and a bare socket echo in the same run."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.cli.terminal.tables import plain_table

from tests.bench import machine
from tests.bench.flood import bench_flood
from tests.bench.loads.people import Load, LoadError
from tests.bench.loads.server import ASK_S, BARE, SETTLE_S, Job, Kind, Process, Reading, make_load
from tests.bench.processors import two_processors
from tests.bench.targets import reached

MOST_LATE_US = 2000.0  # p99
LEAST_ENCRYPTED = 100
CASES: tuple[tuple[Kind, bool], ...] = (
    ("echo", False), ("unencrypted", False), ("unencrypted", True), ("encrypted", False), ("encrypted", True),
)  # fmt: skip
WIDTH = 120
QUIET_LOAD = 0.5
LEAST_ANSWERED = 0.5  # of what a bare server is sent
APART = 4  # ticks, by which the server's count and the people's may have been read at different times


class Measured(msgspec.Struct, frozen=True):
    """One server, with so many people, for so long. Datagrams are those of that time."""

    kind: Kind
    recorded: bool
    people: int
    cpu_us: float  # of the server's process, per person and second
    late_us: dict[str, float]
    work_us: dict[str, float]
    ticks: int
    skipped: int
    sent: int  # by the people
    received: int
    lost_up: int  # where the server's socket had no room
    lost_down: int  # of one per person and tick that was run
    frames_lost: int
    frames_late: int
    not_recorded: int
    memory_kb: int
    used_kb: int
    load_late_us: float  # p99 of the people's own loop
    left_out: int  # datagrams that the people were too late to send

    @property
    def name(self) -> str:
        return f"{self.kind}, recorded" if self.recorded else self.kind

    @property
    def punctual(self) -> bool:
        return self.late_us["p99"] < MOST_LATE_US


def bench_network(
    *,
    users: str = "20,50,100,150",
    seconds: float = 10.0,
    per_room: int = 2,
    axes: int = 3,
    flood: Annotated[bool, Parameter(negative="")] = False,
    json: Json = None,
) -> int:
    """Measure a bare UDP echo, an unencrypted and an encrypted server, with and without recording, one by one.

    The server's loop stays on one processor, the people and whoever records on another. Exit code 0 if at least 100
    people are served with a p99 lateness below 2 ms; with --flood, if nobody loses a seat and ticks stay punctual.

    Parameters
    ----------
    users
        How many people: numbers with commas between them.
    seconds
        How long each is measured.
    per_room
        People in a room.
    axes
        Of the object.
    flood
        Measure an encrypted server with two people under a flood of unauthenticated peers instead.
    """
    counts = counts_of(users)
    within("--seconds", seconds, 1, 600)
    if not 1 <= per_room <= 256 or not 1 <= axes <= 3:
        raise BadInput("bench network needs 1 to 256 people a room, and 1 to 3 axes")
    console = make_console(stderr=json == "-")
    console.width = max(console.width, WIDTH)
    before = warn_if_busy(console)
    if flood:
        return bench_flood(seconds, console, json)
    found = []
    with two_processors(console) as cores:
        for people in counts:
            for kind, recorded in CASES:
                found.append(measure(Job(kind, people, per_room, axes, cores[1]), seconds, recorded=recorded))
                console.print(_said(found[-1]))
    console.print(_table(found, per_room, axes))
    well = _judge(found, console)
    if json is not None:
        answer = {"measured": msgspec.to_builtins(found), "people": _served(found), "load_before": before}
        write_json({**answer, "reached": well}, json)
    return 0 if well else 1


def warn_if_busy(console: Console) -> float:
    """Return the load average of the last minute; say where it is too much for a measurement."""
    before = machine.load()
    if before > QUIET_LOAD:
        console.print(f"the machine is busy (load {before:.1f}): measure again when it is quiet")
    return before


def counts_of(users: str) -> list[int]:
    """Return the numbers of people in `users`, in rising order. Raises BadInput."""
    try:
        counts = sorted({int(text) for text in users.split(",")})
    except ValueError:
        raise BadInput(f"--users {users}: write whole numbers with commas between them, such as 20,50,100") from None
    if not counts or counts[0] < 1 or counts[-1] > 1000:
        raise BadInput(f"--users {users}: each must be from 1 to 1000")
    return counts


def measure(job: Job, seconds: float, *, recorded: bool = False) -> Measured:
    """Measure one server, start to end. Raises Problem where somebody gets no seat, or loses it."""
    kind, people = job.kind, job.people
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        record_at = str(Path(base) / "server.mcap") if recorded else ""
        job = msgspec.structs.replace(job, state=str(Path(base) / "state"), record_at=record_at)
        server = Process(job)
        try:
            load = make_load(job, server)
            try:
                load.join()
                load.run(SETTLE_S)
                first, sent, received, left_out = _look(load, server)
                assert load.pacer is not None
                load.pacer.lateness.clear()
                load.run(seconds)
                load_late_us = load.pacer.lateness.percentile(99) / 1e3
                last, *now = _look(load, server)
                load.leave()
            finally:
                load.close()
        except LoadError as error:
            raise Problem(f"{kind} server, {people} people: {error}") from None
        finally:
            server.end()
    if kind not in BARE and last.seated != people:
        raise Problem(f"{kind} server: {people - last.seated} of {people} people lost their seat: {last.drops}")
    cpu_us = (last.cpu_ns - first.cpu_ns) / (last.time_ns - first.time_ns) / people * 1e6
    sent, received = now[0] - sent, now[1] - received
    if kind in BARE and received < LEAST_ANSWERED * sent:
        raise Problem(
            f"{kind} server, {people} people: {received} answers to {sent} datagrams came, which measures nothing"
        )
    return Measured(
        kind, recorded, people, cpu_us, last.late_us, last.work_us, last.ticks, last.skipped - first.skipped, sent, received,
        _more(first, last, "socket: receive buffer full"), max(0, (last.ticks - APART) * people - received),
        last.frames_lost - first.frames_lost, last.frames_late - first.frames_late, _more(first, last, "not recorded"),
        last.memory_kb, last.used_kb, load_late_us, now[2] - left_out,
    )  # fmt: skip


def _look(load: Load, server: Process) -> tuple[Reading, int, int, int]:
    """A reading, taken while the people go on, and their own tally."""
    tally = load.tally()
    server.ask()
    load.run(ASK_S)
    return server.answer(), *tally


def _more(first: Reading, last: Reading, drop: str) -> int:
    return last.drops.get(drop, 0) - first.drops.get(drop, 0)


def _said(each: Measured) -> str:
    return (
        f"{each.people} people, {each.name}: {each.cpu_us:.0f} µs per person and second, "
        f"p99 lateness {each.late_us['p99']:.0f} µs"
    )


def _table(found: Sequence[Measured], per_room: int, axes: int) -> Table:
    headings = (
        "server", "people", "cpu a\nperson, s\nµs", "over\necho", "late\np50/p99\nµs", "work\np50/p99\nµs",
        "ticks\nskipped", "datagrams\nlost\nup/down", "frames\nlost/late", "not\nrecorded", "memory\nMB",
        "people\nlate p99\nµs",
    )  # fmt: skip
    bare = {each.people: each.cpu_us for each in found if each.kind == "echo"}
    rows = [
        [
            each.name, f"{each.people}", f"{each.cpu_us:.0f}", f"{each.cpu_us / bare[each.people]:.1f}",
            f"{each.late_us['p50']:.0f}/{each.late_us['p99']:.0f}", f"{each.work_us['p50']:.0f}/{each.work_us['p99']:.0f}",
            f"{each.skipped}", f"{each.lost_up}/{each.lost_down}",
            f"{each.frames_lost}/{each.frames_late}" if each.kind != "echo" else "-",
            f"{each.not_recorded}" if each.recorded else "-", f"{each.memory_kb / 1024:.0f}", f"{each.load_late_us:.0f}",
        ]
        for each in found
    ]  # fmt: skip
    return plain_table(headings, rows, title=f"rooms of {per_room}, {axes} axes, 128 Hz")


def _served(found: Sequence[Measured]) -> dict[str, int]:
    """Return, for each kind of server, the largest number of people tried up to which it stayed punctual."""
    served: dict[str, int] = {}
    broken: set[str] = set()
    for each in sorted(found, key=lambda each: each.people):
        served.setdefault(each.name, 0)
        if not each.punctual:
            broken.add(each.name)
        if each.name not in broken:
            served[each.name] = each.people
    return served


def _judge(found: Sequence[Measured], console: Console) -> bool:
    served = _served(found)
    for name, people in served.items():
        console.print(f"{name}: {people} people on one core with a p99 lateness below {MOST_LATE_US / 1e3:g} ms")
    late = max(each.load_late_us for each in found)
    if late > MOST_LATE_US:
        console.print(f"the people themselves were late (p99 {late / 1e3:.1f} ms): this machine is too small, or busy")
    well = served["encrypted, recorded"] >= LEAST_ENCRYPTED
    console.print(f"at least {LEAST_ENCRYPTED} encrypted and recorded are asked for: {reached(well)}")
    return well
