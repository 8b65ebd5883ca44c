"""`dev.py bench capacity`: what a core is measured to take, and what cores, hosts and clusters carry by that."""

import math
import pickle
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import NamedTuple

import msgspec

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import within
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.settings.room import resolve
from cogrip.server.hosting.cluster.directory import LOST_S, Directory, Host, Report

from tests.bench.loads.process_memory import family_of
from tests.bench.loads.server import NETWORK_HZ, SETTLE_S, Job, Process, make_load
from tests.bench.network import warn_if_busy
from tests.bench.processors import two_processors

FEW, MANY = 100, 200  # people, of whom a frame's fixed part and a person's are computed
PER_ROOM = 2
BUSY = 0.5  # of a frame that a core may step: who is last in a frame has their answer half a frame after the step
DIRECTORY_BUSY = 0.5  # of a processor
REPORTS_HZ, FRONTS_HZ = 4.0, 5.0  # calls of the directory by each host and each front
ROOMS = 2000  # of the directory that is timed
HOST_CORES = 16
HOSTS = (1, 10, 100)
MOST = 1_000_000  # people


class Parts(msgspec.Struct, frozen=True):
    """Measurements, in us unless it says otherwise; see NAMES."""

    frame: float
    person: float
    recorder_person: float
    join: float
    room_frame: float
    recorded_bytes_per_s: float
    report_room: float
    look_room: float
    front_room: float


NAMES = {
    "frame": "server, a frame without anybody, µs",
    "person": "server, a person and frame, µs",
    "recorder_person": "its recorder's process, a person and frame, µs",
    "join": "a join: handshake, hello, seat, µs",
    "room_frame": "both processes of one room alone, a frame, µs",
    "recorded_bytes_per_s": "recording, bytes of a person and second",
    "report_room": "directory, a room in a report of its host, µs",
    "look_room": "directory, a room in a look at all, µs",
    "front_room": "directory, a room in a call of a front, µs",
}


class Row(msgspec.Struct, frozen=True):
    what: str
    people: int
    directory: float  # processors that it would take; one process has one


def bench_capacity(*, seconds: float = 3.0, rounds: int = 3, json: Json = None) -> int:
    """Measure what people cost a core, a join and the directory of a cluster; compute what more of them carry.

    The model stands in docs/scaling.md. Encrypted and recorded, rooms of 2, 3 axes, 128 Hz. Exit code 0: nothing is judged.

    Parameters
    ----------
    seconds
        How long people are measured.
    rounds
        How often; medians count.
    """
    within("--seconds", seconds, 1, 600)
    within("--rounds", rounds, 1, 100)
    console = make_console(stderr=json == "-")
    before = warn_if_busy(console)
    counts = (FEW, MANY, PER_ROOM)
    with two_processors(console) as cores:
        found = [[_served(people, seconds, cores[1]) for people in counts] for _ in range(rounds)]
    few, many, room = (Served(*map(median, zip(*each, strict=True))) for each in zip(*found, strict=True))
    person = (many.server_us - few.server_us) / (MANY - FEW)
    parts = Parts(
        few.server_us - FEW * person, person, many.recorder_us / MANY, many.join_us, room.server_us + room.recorder_us,
        many.file_bytes_per_s, *_directory(),
    )  # fmt: skip
    measured, rows = msgspec.to_builtins(parts), model(parts)
    console.print(plain_table(("measured", ""), [(NAMES[name], f"{value:.4g}") for name, value in measured.items()]))
    headings = (f"carries (hosts have {HOST_CORES} cores)", "people", "directory\n[processors]")
    console.print(plain_table(headings, [(row.what, f"{row.people:,}", _shown(row.directory)) for row in rows]))
    if json is not None:
        write_json({"measured": measured, "computed": msgspec.to_builtins(rows), "load_before": before}, json)
    return 0


def _shown(processors: float) -> str:
    return f"{processors:.2f}" if processors else "-"


def model(parts: Parts) -> list[Row]:
    """Compute what one core, hosts and clusters carry (docs/scaling.md, Computed)."""
    frame_us = 1e6 / NETWORK_HZ
    core = math.floor((BUSY * frame_us - max(0.0, parts.frame)) / parts.person)
    recorders = core * parts.recorder_person / frame_us  # cores that the recorder of one worker takes
    workers = core * math.floor((HOST_CORES - 1) / (1.0 + recorders))  # one core for the front and the system
    host = PER_ROOM * math.floor((HOST_CORES - 1) * BUSY * frame_us / parts.room_frame)  # each room has its process
    rows = [Row("one core", core, 0.0), Row(f"{HOST_CORES} cores, --workers", workers, 0.0)]
    rows += [Row(f"cluster of {hosts}", hosts * host, directory_load(parts, hosts, host)) for hosts in HOSTS]
    most = max(hosts for hosts in range(1, 1000) if directory_load(parts, hosts, host) <= DIRECTORY_BUSY or hosts == 1)
    rows.append(Row(f"cluster of {most}, the most", most * host, directory_load(parts, most, host)))
    clusters = math.ceil(MOST / (most * host))
    rows.append(Row(f"{clusters} of these", MOST, directory_load(parts, most, host)))
    return rows


def directory_load(parts: Parts, hosts: int, people: int) -> float:
    """Return the processors that a directory takes for so many hosts, each with a front and so many people in rooms of two."""
    rooms = hosts * people / PER_ROOM
    every_call = parts.look_room * hosts * (REPORTS_HZ + FRONTS_HZ)  # it looks at all rooms in each call
    return rooms * (parts.report_room * REPORTS_HZ + every_call + parts.front_room * hosts * FRONTS_HZ) * 1e-6


class Served(NamedTuple):
    """us a frame of the server's process and of its recorder's; us of a join; recorded for a person."""

    server_us: float
    recorder_us: float
    join_us: float
    file_bytes_per_s: float


def _served(people: int, seconds: float, core: int | None) -> Served:
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        file = Path(base) / "server.mcap"
        job = Job("encrypted", people, PER_ROOM, 3, core, str(Path(base) / "state"), str(file))
        server = Process(job)
        try:
            load = make_load(job, server)
            try:
                spans = [
                    _took(server.pid, file, meanwhile)
                    for meanwhile in (
                        lambda: time.sleep(SETTLE_S), load.join, lambda: load.run(SETTLE_S), lambda: load.run(seconds),
                    )
                ]  # fmt: skip
                load.leave()
            finally:
                load.close()
        finally:
            server.end()
    rest, join, _, run = spans
    frames = run.seconds * NETWORK_HZ
    return Served(
        run.server_us / frames,
        run.recorder_us / frames,
        (join.server_us - rest.server_us * join.seconds / rest.seconds) / people,
        run.file_bytes / run.seconds / people,
    )


class Span(NamedTuple):
    """Time, processor time of the server and of its recorder, and what the recording grew by."""

    seconds: float
    server_us: float
    recorder_us: float
    file_bytes: int


def _took(server: int, file: Path, meanwhile: Callable[[], object]) -> Span:
    def look() -> tuple[float, ...]:
        spent = {True: 0.0, False: 0.0}  # of the server; of its children
        for pid, role in family_of(server):
            tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
            spent[not role] += sum(int(task.read_text().split()[0]) for task in tasks) * 1e-3
        return time.monotonic(), spent[True], spent[False], file.stat().st_size if file.exists() else 0

    before = look()
    meanwhile()
    return Span(*(after - begun for begun, after in zip(before, look(), strict=True)))  # type: ignore[arg-type]


def _directory() -> tuple[float, float, float]:
    """Return what a room takes of the directory: a report, a look at all, a front's call with jobs and homes. In us."""
    directory = Directory()
    job = msgspec.msgpack.encode(resolve({}))
    host = Host("host", "192.0.2.1", HOST_CORES)
    reports = [
        Report("host host", f"room {n}", 1, "host", job, "192.0.2.1:40000", ("anna", "ben"), bytes(400))
        for n in range(ROOMS)
    ]
    jobs = {report.room: job for report in reports}
    now_s = 100.0

    def report() -> None:
        for each in pickle.loads(pickle.dumps([tuple(each) for each in reports])):
            directory.report(Report._make(each), now_s)

    def front() -> None:
        directory.offer(pickle.loads(pickle.dumps(jobs)))
        pickle.dumps(directory.homes())

    report_us = _us(report)
    now_s += LOST_S  # a directory that has just begun does not look yet
    return report_us, _us(lambda: directory.look([host], now_s)), _us(front)


def _us(call: Callable[[], object]) -> float:
    times = []
    for _ in range(9):
        begin_ns = time.perf_counter_ns()
        call()
        times.append((time.perf_counter_ns() - begin_ns) * 1e-3 / ROOMS)
    return median(times)
