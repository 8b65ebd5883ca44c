"""`dev.py bench workers`: people at one process and at several workers, quiet and under a flood at the front.

Where people, front and workers share processors, no process can be filled up. So one process gets some people, N workers N
times as many, and the busiest process of each is compared: how many people are there for the same load of it?
"""

import random
import re
import signal
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Annotated

import msgspec
from cyclopts import Parameter
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.secure.channel import UnencryptedChannel
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES
from cogrip.server.io.state_folder import find_folder, read_server
from cogrip.server.io.token_file import TokenFile, draw_token

from tests.bench import machine
from tests.bench.children import output_at_end, start_cogrip, wait_for_line
from tests.bench.loads.flood import SAMPLES, Flood
from tests.bench.loads.flood import Job as FloodJob
from tests.bench.loads.people import Load, LoadError, make_people, room_name
from tests.bench.loads.server import HOST, SETTLE_S, settings_of
from tests.bench.loads.server import Job as PeopleJob
from tests.bench.targets import judge

MARGIN_S = 0.5
WIDTH = 120
END_LIMIT_S = 60.0
ROOM = """name = "{name}"
playout.frames = 2
rates.network_hz = 128
admission.seats_per_token = {people}
object.axes = 3
users = [{users}]
"""


class Case(msgspec.Struct, frozen=True):
    """One server. cpu_us: per person and second, of each process; late_us: worst p99 of its rooms."""

    workers: int
    flooded: bool
    people: int
    cpu_us: dict[str, float]
    late_us: float
    flood_per_s: float = 0.0

    @property
    def busy(self) -> float:
        """Share of a processor that the busiest process computes."""
        return max(self.cpu_us.values()) * self.people * 1e-6


def bench_workers(
    *,
    people: int = 32,
    workers: int = 2,
    seconds: float = 10.0,
    rounds: int = 3,
    per_room: int = 2,
    insecure: Annotated[bool, Parameter(negative="")] = False,
    json: Json = None,
) -> int:
    """Measure how many more people several workers carry than one process, and what people cost under a flood.

    Exit code 0 if N workers carry at least 0.9 N times the people, by medians.

    Parameters
    ----------
    people
        How many at one process; N workers get N times as many.
    workers
        How many workers.
    seconds
        How long each is measured.
    rounds
        How often each is measured without a flood, in turns.
    per_room
        People in a room.
    insecure
        Without encryption.
    """
    within("--workers", workers, 2, 16)
    within("--people", people, 2, 500 // workers)
    within("--seconds", seconds, 1, 600)
    within("--rounds", rounds, 1, 100)
    within("--per-room", per_room, 1, 16)
    console = make_console(stderr=json == "-")
    console.width = max(console.width, WIDTH)
    cores = len(machine.processors())
    if cores < workers + 2:
        console.print(
            f"{cores} processors for {workers} workers, a front and the people: lateness shows that they share them"
        )
    plan = [(1, people), (1, workers * people), (workers, workers * people)]
    quiet = [measure(*each, False, per_room, seconds, insecure) for _ in range(rounds) for each in plan]
    flooded = [measure(*each, True, per_room, seconds, insecure) for each in (plan[0], plan[2])]
    console.print(_table([*quiet, *flooded]))
    one, all_at_one, divided = [median(case.busy for case in quiet[place :: len(plan)]) for place in range(len(plan))]
    ratio, share = workers * one / divided, all_at_one / divided
    console.print(
        f"{workers * people} people: the busiest of front and {workers} workers computes 1/{share:.2f} of what one process does"
    )
    well = judge(console, f"people at {workers} workers, over those at one process of that load", ratio, 0.9 * workers)
    if json is not None:
        report = {"cases": msgspec.to_builtins([*quiet, *flooded]), "ratio": ratio, "same_people_ratio": share}
        write_json({**report, "processors": cores, "reached": well}, json)
    return 0 if well else 1


def measure(workers: int, people: int, flooded: bool, per_room: int, seconds: float, insecure: bool) -> Case:
    """Return one case. Raises Problem where somebody gets no seat."""
    rooms = -(-people // per_room)
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        configs = []
        for number in range(rooms):
            users = ", ".join(f'{{name = "p{seat}"}}' for seat in range(per_room))
            configs.append(Path(base) / f"{number}.toml")
            configs[-1].write_text(ROOM.format(name=room_name(number), people=people, users=users), "utf-8")
        server = start_cogrip(
            "serve", *map(str, configs), "--port", "0", "--state", str(Path(base) / "state"), "--workers", str(workers),
            "--no-report", "--no-record", "--runs", str(Path(base) / "runs"), *(() if insecure else ("--encrypted",)),
        )  # fmt: skip
        try:
            wait_for_line(server, r"listening on ")
            state = find_folder(Path(base) / "state")
            started = read_server(state)
            if started is None:
                raise Problem("the server left no record of itself")
            token = draw_token()
            if not insecure:
                TokenFile(state).change(lambda book: book.new(token, time.time(), role="player"))
            load = Load(
                make_people(
                    people, per_room, [(HOST, started.port)],
                    UnencryptedChannel if insecure else lambda: DtlsClient(started.fingerprint), "" if insecure else token,
                ),
                seat_settings(settings_of(PeopleJob("encrypted", people, per_room))[0], 0),
            )  # fmt: skip
            processes = {"server" if workers == 1 else "front": server.pid} | _workers_of(server.pid)
            cpu_us, flood_per_s = _hold(load, processes, seconds, people, started.port if flooded else 0)
            server.send_signal(signal.SIGTERM)
            output_at_end(server, END_LIMIT_S)
        except LoadError as error:
            raise Problem(f"{workers} workers: {error}") from None
        finally:
            if server.poll() is None:
                server.kill()
            server.wait()
        late_us = [
            msgspec.json.decode(path.read_bytes())["server"]["ticks"]["late_us"]["p99"]
            for path in (Path(base) / "runs").glob("**/summary.json")
        ]
        return Case(workers, flooded, people, cpu_us, max(late_us), flood_per_s)


def _hold(
    load: Load, processes: dict[str, int], seconds: float, people: int, flood_at: int
) -> tuple[dict[str, float], float]:
    """Let all people hold for so long. Return what each process computed for a person, and the flood's rate."""
    flood = None
    try:
        load.join()
        load.run(SETTLE_S)
        if flood_at:
            chance = random.Random(1)
            samples = tuple(chance.randbytes(chance.randrange(1, MAX_DATAGRAM_BYTES)) for _ in range(SAMPLES))
            flood = Flood(FloodJob(HOST, flood_at, seconds + MARGIN_S, samples))
        before, begun_s = {name: _cpu_ns(pid) for name, pid in processes.items()}, time.monotonic()
        load.run(seconds)
        took_s = time.monotonic() - begun_s
        spent = {name: _cpu_ns(pid) - before[name] for name, pid in processes.items()}
        rate = flood.end().per_second if flood else 0.0
        load.leave()
    finally:
        if flood is not None:
            flood.kill()
        load.close()
    return {name: ns * 1e-3 / took_s / people for name, ns in spent.items()}, rate


def _workers_of(front: int) -> dict[str, int]:
    """Return the processes that the front has started, by name. Recorders are left out: nothing is recorded."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = path.read_bytes().decode().split("\0")
            parent = re.search(r"^PPid:\t(\d+)$", path.with_name("status").read_text(), re.MULTILINE)
            if "cogrip.cli.serving.worker_process" in words and parent and int(parent[1]) == front:
                found[f"worker {words[-2]}"] = int(path.parent.name)
    return dict(sorted(found.items()))


def _cpu_ns(process: int) -> int:
    """Return the processor time of all threads of a process so far."""
    return sum(int(path.read_text().split()[0]) for path in Path(f"/proc/{process}/task").glob("*/schedstat"))


def _table(cases: Sequence[Case]) -> Table:
    headings = ("processes", "us of a person and second", "flood [1/s]", "people", "busiest [%]", "p99 late [us]")
    rows = [
        (
            "1" if case.workers == 1 else f"front + {case.workers}",
            ", ".join(f"{name} {value:.0f}" for name, value in case.cpu_us.items()),
            f"{case.flood_per_s:.0f}", f"{case.people}", f"{100 * case.busy:.1f}", f"{case.late_us:.0f}",
        )
        for case in cases
    ]  # fmt: skip
    return plain_table(headings, rows, left=2)
