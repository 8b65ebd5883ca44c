"""`dev.py bench view`: what tabs cost a 1 kHz client and the page's process, how soon a state of the server is drawn, and how
soon the server feels a pointer.

A tab is a client of the page's socket, but where pictures are measured: there it is a browser that draws in software. The five
people of its room are light ones, who send waves and compute nothing: they would hold their devices on machines of their own.
"""

import asyncio
import json
import math
import os
import random
import signal
import statistics
import subprocess
import tempfile
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import Problem, at_least_one
from cogrip.cli.terminal.tables import plain_table
from cogrip.devices.web.messages import Pointer, encode_pointer
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.secure.channel import UnencryptedChannel
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import SERVER_RECORDING, SETTINGS, client_recording, write_settings
from cogrip.results.reading.records import End

from tests.bench import machine
from tests.bench.children import ROOT, output_at_end, start_cogrip, start_python, wait_for_line
from tests.bench.loads.people import Load, make_people, room_name
from tests.bench.loads.process_memory import memory_kb
from tests.bench.loads.tabs import opened
from tests.bench.targets import reached

PLAYOUT_FRAMES = 1
CHANGES = ("link.delay_ms=0", f"playout.frames={PLAYOUT_FRAMES}")
MOST_RATIO, MOST_GROWTH_MB, LEAST_HZ, MOST_P50_MS, MOST_DRAWN_MS = 1.1, 5.0, 30.0, 25.0, 50.0
PEOPLE = 5  # whom the browser draws
PICTURES = 3  # sessions in which it does
STALLS = (
    4  # sessions that are measured anew, as the machine took the processor away from one for a whole watchdog's time
)
TABS, WATCHING = 50, 2
JUMP_M, REST_S = 0.01, 0.6
REPEAT_S = 0.05  # as often a page says that its pointer holds
NOISE_N, SPREADS = 0.005, 5.0  # a force that changes by more than both is of the pointer
END_S = 30.0
DRAWS = 200  # of sessions, for the uncertainty of a ratio
Row = tuple[str, str, str, str]


def bench_view(*, blocks: int = 24, seconds: float = 60.0, jumps: int = 60) -> int:
    """Measure a 1024 Hz client beside tabs, a tab that is stopped, 50 tabs, and pointer to server.

    Parameters
    ----------
    blocks
        Sessions of the client, with two tabs and without in turns.
    seconds
        Time for which a tab is stopped; a tenth of it, at least 5 s, is every other part.
    jumps
        Jumps of the pointer.
    """
    at_least_one("--blocks", blocks)
    console = make_console(soft_wrap=True)
    settings = load(shipped("demo"), CHANGES)
    short_s = max(5.0, 0.1 * seconds)
    rows: list[Row] = []
    well = True

    def judge(what: str, value: float, asked: float, unit: str, *, most: bool) -> None:
        nonlocal well
        fine = value <= asked if most else value >= asked
        well = well and fine
        rows.append((what, f"{value:.2f} {unit}", f"{'at most' if most else 'at least'} {asked:g}", reached(fine)))

    before = machine.load()
    with tempfile.TemporaryDirectory(prefix="cogrip-view-") as name:
        base = Path(name)
        ratio, error = _lateness(settings, base, blocks, short_s, console)
        judge("p99 lateness of a 1024 Hz client, 2 tabs/none", ratio, MOST_RATIO, "", most=True)
        rows.append(("  uncertain by a factor of", f"{error:.2f}", "", ""))
        grown_mb, rates = _tabs(settings, base / "tabs", seconds, short_s)
        judge(f"page's memory, a tab stopped for {seconds:g} s", grown_mb, MOST_GROWTH_MB, "MB", most=True)
        judge(f"{TABS} tabs: frames a second, least", min(rates), LEAST_HZ, "Hz", most=False)
        rows.append((f"{TABS} tabs: frames a second, median", f"{statistics.median(rates):.2f} Hz", "", ""))
        drawn = [_pictures(base / f"pictures {number}", short_s, console) for number in range(PICTURES)]
        if all(pictures for pictures, _ in drawn):
            least = min(min(pictures) for pictures, _ in drawn)
            p50_ms, p95_ms = np.median([np.percentile(late_ms, (50, 95)) for _, late_ms in drawn], axis=0)
            judge(f"{PEOPLE} people in a browser: pictures a second, least", least, LEAST_HZ, "Hz", most=False)
            judge(
                f"  state to picture, p95, median of {PICTURES} sessions", float(p95_ms), MOST_DRAWN_MS, "ms", most=True
            )
            rows.append((f"  p50, of {sum(len(late_ms) for _, late_ms in drawn)} pictures", f"{p50_ms:.2f} ms", "", ""))
        delays_ms = _pointer(settings, base / "pointer", jumps)
        p50, p95 = np.percentile(delays_ms, (50, 95))
        judge("pointer to wave applied, less playout, p50", float(p50), MOST_P50_MS, "ms", most=True)
        rows.append((f"  p95, of {len(delays_ms)} jumps", f"{p95:.2f} ms", "", ""))
    console.print(plain_table(("view", "measured", "asked", ""), rows))
    console.print(f"load of this machine: {before:.1f} before, {machine.load():.1f} after; {os.cpu_count()} processors")
    return 0 if well else 1


def _lateness(
    settings: Settings, base: Path, blocks: int, seconds: float, console: Console
) -> tuple[float, float]:  # fmt: skip
    """Return the ratio of the p99 of all ticks with tabs to that of all without, and the factor by which it is uncertain.

    The uncertainty is that of other sessions drawn from these: what disturbs this machine lasts for whole sessions.
    """
    late_us: dict[bool, list[np.ndarray]] = {True: [], False: []}
    stalls = 0
    for number in range(max(4, blocks)):
        watched = number % 4 in (0, 3)
        while (late := _late_us(settings, base / f"{number}-{stalls}", watched, seconds)) is None:
            stalls += 1
            console.print("this machine stood still for as long as a watchdog waits: measured anew")
            if stalls > STALLS:
                raise Problem("this machine stands still too often for a measurement")
        late_us[watched].append(late)
        console.print(f"{'two tabs' if watched else 'no tab  '}: p99 lateness {np.percentile(late, 99):.0f} µs")
    chance = np.random.default_rng(1)

    def ratio(draw: Callable[[list[np.ndarray]], list[np.ndarray]]) -> float:
        with_tabs, without = [float(np.percentile(np.concatenate(draw(late_us[each])), 99)) for each in (True, False)]
        return max(1.0, with_tabs) / max(1.0, without)

    drawn = [ratio(lambda of: [of[each] for each in chance.integers(len(of), size=len(of))]) for _ in range(DRAWS)]
    return ratio(lambda of: of), math.exp(float(np.std(np.log(drawn))))


def _late_us(settings: Settings, folder: Path, watched: bool, seconds: float) -> np.ndarray | None:
    """Return the lateness of each tick of a client's session [us]; None where a stall of the machine ended it."""
    user = settings.users[0].name
    with _served(settings, folder) as place:
        client = start_cogrip(
            "join", place, "--config", str(folder / SETTINGS), "--name", user, "--into", str(folder),
            "--seconds", str(seconds),
        )  # fmt: skip
        if watched:
            with _viewed(place) as (_, url), _reading(url, WATCHING):
                printed, well = output_at_end(client, seconds + END_S)
        else:
            printed, well = output_at_end(client, seconds + END_S)
    if not well and any(stall in printed for stall in ("its read took", "the loop was away")):
        return None
    if not well:
        raise Problem(f"the client failed:\n{printed}")
    ticks = End(open_recording(folder / client_recording(user))).records("tick")
    return np.array([max(0, tick.late_us) for _, tick in ticks])


def _tabs(settings: Settings, folder: Path, stopped_s: float, seconds: float) -> tuple[float, list[float]]:
    """Return what a stopped tab adds to the memory of the page's process [MB], and frames a second of each of many tabs."""
    with _served(settings, folder) as place, _held(place, settings), _viewed(place) as (view, url):
        with _reading(url, WATCHING), _reading(url, 1) as stopped:
            time.sleep(seconds)
            before = memory_kb(view.pid) or 0.0
            machine.stop(stopped)
            try:
                time.sleep(stopped_s)
                after = memory_kb(view.pid) or 0.0
            finally:
                machine.resume(stopped)
        with _reading(url, TABS) as tabs:
            time.sleep(seconds)
            printed, _ = tabs.communicate(b"\n", timeout=END_S)
            rates = json.loads(printed)
    return (after - before) / 1024, rates


def _pictures(folder: Path, seconds: float, console: Console) -> tuple[list[float], list[float]]:
    """Return a browser's pictures in each second, and the time from a step to its picture [ms]; nothing without a browser."""
    users = [{"name": f"p{seat}"} for seat in range(PEOPLE)]
    playout = {"frames": PLAYOUT_FRAMES}
    settings = resolve({"name": room_name(0), "object": {"axes": 3}, "playout": playout, "users": users})
    with _served(settings, folder, record=True) as place, _viewed(place) as (_, url):
        host, _, port = place.rpartition(":")
        load = Load(make_people(PEOPLE, PEOPLE, [(host, int(port))], UnencryptedChannel), seat_settings(settings, 0))
        load.join()
        with _holding(load), start_python("-m", "tests.bench.loads.page", url, str(seconds)) as page:
            printed, _ = page.communicate(timeout=seconds + END_S)
        load.leave()
    found = json.loads(printed.splitlines()[-1])
    if "missing" in found:
        console.print(f"pictures are not measured: {found['missing']}")
        return [], []
    if found["people"] != PEOPLE:
        raise Problem(f"the page drew {found['people']} people, not {PEOPLE}")
    end = End(open_recording(folder / SERVER_RECORDING))
    anchor_s, anchor = next(iter(end.records("clock")))
    stepped_s = {step.step: time_s - anchor_s + anchor.utc_ns / 1e9 for time_s, step in end.records("step")}
    late_ms = [1e3 * (drawn_s - stepped_s[number]) for number, drawn_s in found["drawn"] if number in stepped_s]
    return found["fps"], late_ms


@contextmanager
def _holding(load: Load) -> Iterator[None]:
    """Let the people of `load` hold the object meanwhile."""
    over = threading.Event()

    def hold() -> None:
        while not over.is_set():
            load.run(0.2)

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _pointer(settings: Settings, folder: Path, jumps: int) -> list[float]:
    """Return the time from a pointer's jump to the first step of the server that shows it, without the playout delay [ms]."""
    with _served(settings, folder, record=True) as place:
        client = start_cogrip("join", place, "--device", "web", "--no-record", "--into", str(folder), "--name", "anna")
        try:
            url = wait_for_line(client, r"view: (http://\S+)")[1]
            sent_ns = asyncio.run(_jump(url, jumps))
        finally:
            client.send_signal(signal.SIGTERM)
            output_at_end(client, END_S)
    end = End(open_recording(folder / SERVER_RECORDING))
    anchor_s, anchor = next(iter(end.records("clock")))
    times_s, forces_n = [], []
    for time_s, step in end.records("step"):
        if (seat := step.seats[0]).seated:
            times_s.append(time_s - anchor_s + anchor.monotonic_ns / 1e9)
            forces_n.append(seat.force_n[0])
    playout_s = PLAYOUT_FRAMES / settings.rates.network_hz
    found = [_first(times_s, forces_n, each / 1e9) for each in sent_ns]
    return [1e3 * (delay_s - playout_s) for delay_s in found if delay_s is not None]


def _first(times_s: Sequence[float], forces_n: Sequence[float], sent_s: float) -> float | None:
    """Return the time from `sent_s` to the first force that is another than at rest before; None where there was no rest."""
    at = bisect_right(times_s, sent_s)
    rest = forces_n[max(0, at - 8) : at]
    if len(rest) < 8:
        return None
    bound = max(NOISE_N, SPREADS * (max(rest) - min(rest)))
    later = range(at, min(len(times_s), at + 32))
    return next((times_s[each] - sent_s for each in later if abs(forces_n[each] - rest[-1]) > bound), None)


async def _jump(url: str, jumps: int) -> list[int]:
    """Let the pointer jump to and fro at times that fit to no tick; return when [ns]."""
    chance, number = random.Random(1), 0
    sent_ns: list[int] = []
    tab = await opened(url, hand=True)

    async def drain() -> None:
        async for _ in tab:
            pass

    reading = asyncio.create_task(drain())
    for jump in range(jumps + 1):
        place = JUMP_M * (jump % 2)
        until_s = time.monotonic() + REST_S + chance.uniform(0.0, 0.05)
        while True:
            number += 1
            message = encode_pointer(Pointer(number, True, (place, 0.0, 0.0)))
            if time.monotonic() >= until_s:
                break
            if len(sent_ns) <= jump:
                sent_ns.append(time.monotonic_ns())
            await tab.send(message)
            await asyncio.sleep(max(0.0, min(REPEAT_S, until_s - time.monotonic())))
    reading.cancel()
    await tab.close()
    return sent_ns[1:]  # the first one takes hold


@contextmanager
def _served(settings: Settings, folder: Path, *, record: bool = False) -> Iterator[str]:
    """Serve on loopback; yields HOST:PORT."""
    write_settings(folder, settings)
    options = ["--into", str(folder), "--no-report", *([] if record else ["--no-record"])]
    with start_cogrip("serve", str(folder / SETTINGS), "--port", "0", *options) as server:
        try:
            found = wait_for_line(server, r"listening on \S+:(\d+)")
            yield f"127.0.0.1:{found[1]}"
        finally:
            server.send_signal(signal.SIGTERM)
            output_at_end(server, END_S)


@contextmanager
def _held(place: str, settings: Settings) -> Iterator[None]:
    """Let every seat be held: a frame has all people in it."""
    with tempfile.TemporaryDirectory(prefix="cogrip-view-") as folder:
        people = [
            start_cogrip("join", place, "--name", user.name, "--into", folder, "--no-record", "--no-report")
            for user in settings.users
        ]
        try:
            yield
        finally:
            for person in people:
                person.send_signal(signal.SIGTERM)
                output_at_end(person, END_S)


@contextmanager
def _viewed(place: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """View a session without a browser; yields the process and the page's address."""
    with start_cogrip("view", place, "--no-browser") as view:
        try:
            yield view, wait_for_line(view, r"view: (http://\S+)")[1]
        finally:
            view.send_signal(signal.SIGTERM)
            output_at_end(view, END_S)


@contextmanager
def _reading(url: str, count: int) -> Iterator[subprocess.Popen[bytes]]:
    """Let tabs read from a process of their own."""
    with start_python(str(ROOT / "tests" / "bench" / "loads" / "tabs.py"), url, str(count)) as tabs:
        assert tabs.stdout is not None
        try:
            if tabs.stdout.readline().strip() != b"reading":
                raise Problem("the tabs get no frames")
            yield tabs
        finally:
            tabs.kill()
            tabs.wait()
