"""`dev.py bench recording`: what recording costs a live session, and what its files cost to keep and to read."""

import json
import math
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
from rich.console import Console

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import SERVER_RECORDING, SETTINGS, client_recording, read_accounts, write_settings
from cogrip.results.reading.records import End
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.bench import machine
from tests.bench.children import output_at_end, start_cogrip, wait_for_line, with_tests_on_path
from tests.bench.loads.hours_written import HoursWritten, write_hours
from tests.bench.targets import judge

LONG_S = 1800.0
WRITTEN_S = 2 * 3600.0
COLUMNS = ("position_m", "velocity_mps", "force_n", "wave_up", "wave_down", "work_j", "port_j")
_MOST_RATIO, _MOST_BYTES, _MOST_MB = 1.1, 200.0, 300.0
_MOST_MB_PER_H = 1.0
_LEAST_SAMPLES_PER_S, _LEAST_SPEED = 50_000.0, 10.0
_SHORT_US = 1.0  # where the loop spins into its deadline: a ratio of less says nothing
_END_LIMIT_S = 30.0
_CHILD = "import sys; from tests.bench.recording import measure; measure(*sys.argv[1:])"
_HOURS_CHILD = "import sys; from tests.bench.recording import measure_hours; measure_hours(sys.argv[1])"


class Measured(msgspec.Struct, frozen=True):
    """Result of a task in a process of its own: messages or samples, recorded seconds, the seconds it took, its peak memory."""

    count: int
    recorded_s: float
    took_s: float
    peak_mb: float

    @property
    def speed(self) -> float:
        """Over real time."""
        return self.recorded_s / self.took_s


def bench_recording(*, blocks: int = 16, seconds: float = 5.0, people: int = 2, long: bool = False) -> int:
    """Live sessions in three axes over loopback, recorded and not, in turns: on, off, off, on. Then their files are read.

    Exit code 0 if everything that is asked for is reached.

    Parameters
    ----------
    blocks
        How many sessions in all.
    seconds
        How long each is.
    people
        How many take part, 1 to 3.
    long
        Also make a recording of half an hour and three people, in virtual time, and measure the memory of reading it; and
        write two hours of a client's messages as fast as it goes, and measure the memory of writing them.
    """
    if blocks < 4 or blocks % 4 or seconds < 1.0 or not 1 <= people <= 3:
        raise BadInput("bench recording needs 4, 8, 12 ... blocks of at least 1 s, and 1 to 3 people")
    console = make_console()
    settings = load(shipped("three-users"))
    console.print(f"{blocks} sessions of {seconds:g} s, {people} of {len(settings.users)} seats, 3 axes")
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        folder = Path(base)
        names = [user.name for user in settings.users[:people]]
        reached = [_lateness(settings, names, folder, blocks, seconds, console)]
        reached += _files(folder, names, console)
        if long:
            reached.append(_hours(folder, names[0], console))
            reached += _long(folder, console)
    return 0 if all(reached) else 1


def _lateness(
    settings: Settings, names: Sequence[str], base: Path, blocks: int, seconds: float, console: Console
) -> bool:
    """p99 lateness of the clients' loops with recording over without: geometric means over all blocks and people."""
    late_us: dict[bool, list[float]] = {True: [], False: []}
    work_us: dict[bool, list[float]] = {True: [], False: []}
    for number in range(blocks):
        recorded = number % 4 in (0, 3)
        folder = base / f"{number}-{'on' if recorded else 'off'}"
        write_settings(folder, settings)
        _session(folder, names, seconds, recorded)
        found = []
        for name, account in read_accounts(folder, names).items():
            ticks = account.ticks if account else TickCount()
            if ticks.late_us.p99 is None or ticks.work_us.p50 is None:
                raise Problem(f"the client of {name} left no account in {folder}")
            found.append(ticks.late_us.p99)
            work_us[recorded].append(ticks.work_us.p50)
        late_us[recorded] += found
        console.print(
            f"recording {'on ' if recorded else 'off'}: p99 lateness {', '.join(f'{each:.0f}' for each in found)} µs"
        )
    for recorded, found in late_us.items():
        console.print(
            f"recording {'on' if recorded else 'off'}: p99 lateness {statistics.median(found):.1f} µs, "
            f"{min(found):.0f} to {max(found):.0f} µs; work of a tick {statistics.median(work_us[recorded]):.0f} µs"
        )
    load = machine.load()
    if load > len(names) + 1:
        console.print(f"the machine is busy (load {load:.1f}): measure the lateness again when it is quiet")
    logs = {recorded: [math.log(max(each, _SHORT_US)) for each in found] for recorded, found in late_us.items()}
    error = math.sqrt(sum(statistics.variance(found) / len(found) for found in logs.values()))
    console.print(f"their ratio is uncertain by a factor of {math.exp(error):.2f}, as the blocks scatter")
    ratio = math.exp(statistics.mean(logs[True]) - statistics.mean(logs[False]))
    return judge(console, "lateness, on over off", ratio, _MOST_RATIO, most=True)


def _session(folder: Path, names: Sequence[str], seconds: float, recorded: bool) -> None:
    """A server and its clients as processes. Raises Problem where one of them fails."""
    common = ["--into", str(folder), *([] if recorded else ["--no-record"])]
    file = str(folder / SETTINGS)
    with start_cogrip("serve", file, "--port", "0", "--seconds", str(seconds + 60.0), *common) as server:
        found = wait_for_line(server, r"listening on \S+:(\d+)")
        join = ["join", f"127.0.0.1:{found[1]}", "--config", file, "--seconds", str(seconds), *common]
        clients = [start_cogrip(*join, "--name", name) for name in names]
        try:
            ended = [output_at_end(client, seconds + _END_LIMIT_S) for client in clients]
        finally:
            server.send_signal(signal.SIGTERM)
        ended.append(output_at_end(server, _END_LIMIT_S))
    if failed := [printed for printed, well in ended if not well]:
        raise Problem("a session failed:\n" + "\n".join(failed))


def _files(base: Path, names: Sequence[str], console: Console) -> list[bool]:
    """Size of the recordings that the sessions left, and how fast they are read and verified."""
    runs = sorted(base.glob("*-on"))
    own = [run / client_recording(name) for run in runs for name in names]
    servers = [run / SERVER_RECORDING for run in runs]
    columns = [_in_child("columns", path) for path in own]
    samples = sum(each.count for each in columns)
    size, shared = (sum(path.stat().st_size for path in paths) for paths in (own, servers))
    console.print(
        f"{samples} samples; the server's files beside them: {shared / samples:.0f} bytes a sample; "
        f"{len(COLUMNS)} columns read in {1e3 * sum(each.took_s for each in columns) / len(columns):.0f} ms a file"
    )
    verdicts = {
        kind: [_in_child("verify", path) for path in paths] for kind, paths in (("client", own), ("server", servers))
    }
    return [
        judge(console, "bytes on disk a sample", size / samples, _MOST_BYTES, most=True),
        judge(console, "samples a second into numpy", samples / sum(each.took_s for each in columns), _LEAST_SAMPLES_PER_S),
        *(
            judge(console, f"verifying a {kind}, over real time", min(each.speed for each in found), _LEAST_SPEED)
            for kind, found in verdicts.items()
        ),
    ]  # fmt: skip


def _hours(base: Path, name: str, console: Console) -> bool:
    """Measure the growth of a client's writer, and what its end costs."""
    path = min(base.glob("*-on")) / client_recording(name)
    found = msgspec.json.decode(_child(_HOURS_CHILD, str(path)), type=HoursWritten)
    console.print(
        f"{found.messages} messages of {WRITTEN_S / 3600:g} hours written in {found.work_s:.1f} s; the end took "
        f"{found.end_s:.3f} s and {max(0.0, found.end_mb - found.last_mb):.1f} MB"
    )
    grown = (found.last_mb - found.settled_mb) / (WRITTEN_S / 3600)
    return judge(console, "growth of a writer [MB/h]", grown, _MOST_MB_PER_H, most=True)


def _long(base: Path, console: Console) -> list[bool]:
    """Half an hour of three people: made by the laboratory, then read by several tasks, each in a process of its own."""
    folder = base / "long"
    write_settings(folder, msgspec.structs.replace(load(shipped("three-users")), seconds=LONG_S))
    made = _in_child("record", folder)
    paths = sorted(folder.glob("*.mcap"))
    size = sum(path.stat().st_size for path in paths)
    made_at = f"half an hour, three people, made at {made.speed:.1f} times real time with {made.peak_mb:.0f} MB"
    console.print(f"{made_at}: {size / 1e6:.0f} MB")
    peaks = []
    for path in paths:
        for task in ("records", "verify"):
            done = _in_child(task, path)
            peaks.append(done.peak_mb)
            times = f"{done.speed:.0f} times real time"
            console.print(f"{path.name}: {task} of {done.count} at {times}, peak {done.peak_mb:.0f} MB")
    return [judge(console, "peak memory [MB]", max(peaks), _MOST_MB, most=True)]


def _in_child(task: str, path: Path) -> Measured:
    return msgspec.json.decode(_child(_CHILD, task, str(path)), type=Measured)


def _child(code: str, *arguments: str) -> str:
    """Return what a process of its own prints. Raises Problem where it fails."""
    command, path = [sys.executable, "-P", "-c", code, *arguments], with_tests_on_path()
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=path)
    if done.returncode:
        raise Problem(f"{' '.join(arguments)}: failed:\n{done.stderr.strip()}")
    return done.stdout


def measure(task: str, path: str) -> None:
    """Do one task and print what it took; of a process of its own, so that its peak memory is the task's."""
    start = time.perf_counter()
    count, recorded_s = TASKS[task](Path(path))
    took_s = time.perf_counter() - start
    peak_mb = machine.peak_memory_kb() / 1024
    print(json.dumps({"count": count, "recorded_s": recorded_s, "took_s": took_s, "peak_mb": peak_mb}))


def measure_hours(path: str) -> None:
    """Write for hours and print what it took; of a process of its own."""
    print(msgspec.json.encode(write_hours(Path(path), WRITTEN_S)).decode())


def _columns(path: Path) -> tuple[int, float]:
    times = End(open_recording(path)).columns("tick", *COLUMNS)["time_s"]
    return len(times), float(times[-1] - times[0])


def _records(path: Path) -> tuple[int, float]:
    """Typed, one by one."""
    end = End(open_recording(path))
    count, last_s, first_s = 0, 0.0, None
    for time_s, _ in end.records("tick" if end.recording.header.role == "client" else "step"):
        first_s = time_s if first_s is None else first_s
        count, last_s = count + 1, time_s
    return count, last_s - (first_s or 0.0)


def _verify(path: Path) -> tuple[int, float]:
    verdict = verify(open_recording(path))
    if not verdict.exact:
        raise Problem(f"{path} does not play again exactly: {verdict.difference or verdict.hole}")
    return verdict.messages, verdict.seconds


def _record(folder: Path) -> tuple[int, float]:
    settings = load(folder / SETTINGS)
    run_laboratory(settings, folder)
    return 0, settings.seconds


Task = Callable[[Path], tuple[int, float]]
TASKS: dict[str, Task] = {"columns": _columns, "records": _records, "verify": _verify, "record": _record}
