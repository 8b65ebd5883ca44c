"""`dev.py bench partner-live`: two people hold a cube through a relay, live, by waves and by models of each other."""

import re
import signal
import tempfile
from contextlib import ExitStack
from pathlib import Path
from subprocess import Popen
from typing import NamedTuple

import msgspec
import numpy as np

from cogrip.analysis.feel.trace import Array
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import plain_table
from cogrip.experiments.methods.case import run_session
from cogrip.experiments.methods.method import METHODS, ideal_settings
from cogrip.experiments.methods.tasks import TASKS
from cogrip.results.reading.records import open_run

from tests.bench.children import output_at_end, start_cogrip, wait_for_line

NAMES = ("anna", "ben")
DEVICE = "sim:ideal?mass_kg=0.1&damping_nspm=0.5"
SECONDS = 5.0  # time that is compared, from when both people are there
LOOSE_S, END_S = 60.0, 60.0
WAIT_S = 6.0  # time after which a hand begins, so that both people are there
COUPLING = {"stiffness_npm": 1000.0, "damping_nspm": 10.0, "impedance_nspm": 20.0}


class LiveRow(msgspec.Struct, frozen=True):
    """Rms of the force's difference to no network [N], live; the force's own; largest step of a tick; ticks that ran, of 1."""

    task: str
    method: str
    delay_ms: float
    error_n: float
    felt_n: float
    step_n: float
    ran: float


class Hand(NamedTuple):
    """Forces [N] of one hand, a row a tick, and when its first tick was [s]; ran: part of the ticks that ran."""

    force_n: Array
    begun_s: float = 0.0
    ran: float = 1.0


def later(hand: str, seconds: float) -> str:
    """Return the address of a hand that begins its course later."""
    shifted = re.sub(r"delay_s=([\d.]+)", lambda found: f"delay_s={float(found[1]) + seconds}", hand)
    return re.sub(
        r"times_s=([\d.,]+)",
        lambda found: "times_s=" + ",".join(str(float(each) + seconds) for each in found[1].split(",")),
        shifted,
    )


def ideal(task: str, late_s: float) -> Array:
    """Return the forces with the cube directly in the hands, in virtual time, where ben begins that much later than anna."""
    hands = TASKS[task].hands[0], later(TASKS[task].hands[1], late_s)
    users = [{"name": name, "device": DEVICE, "hand": hand} for name, hand in zip(NAMES, hands, strict=True)]
    table = {"seconds": SECONDS + 1.0, "coupling": COUPLING, "object": {"axes": 1, "mass_kg": 0.2}, "users": users}
    return run_session(ideal_settings(table, 1), SECONDS + 1.0).trace.force_n[:, :, 0]


def error_of(task: str, found: list[Hand]) -> tuple[float, float]:
    """Return the rms difference of the forces of both hands to the ideal's [N], from its beginning on, and the ideal's own."""
    late_s = found[1].begun_s - found[0].begun_s
    wanted = ideal(task, late_s)
    off = []
    for number, hand in enumerate(found):
        first = round((WAIT_S - number * late_s) * 1024)  # of this hand, where the ideal has its first tick
        off.append(hand.force_n[first : first + len(wanted)][1024:] - wanted[1024:, number])
    return float(np.sqrt(np.mean(np.square(off)))), float(np.sqrt(np.mean(np.square(wanted[1024:]))))


def live(task: str, method: str, delay_ms: float) -> list[Hand]:
    """Run server, relay and two clients. Raises Problem where one of them ends before it should."""
    settings = {
        "object.axes": 1, "object.mass_kg": 0.2, **{f"coupling.{key}": value for key, value in COUPLING.items()},
        **METHODS[method].overrides,
    }  # fmt: skip
    words = [f"{key}={str(value).lower() if isinstance(value, bool) else value}" for key, value in settings.items()]
    flags = [part for word in words for part in ("--set", word)]
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        users = "".join(
            f'[[users]]\nname = "{name}"\ndevice = "{DEVICE}"\nhand = "{hand}"\n'
            for name, hand in zip(NAMES, (later(hand, WAIT_S) for hand in TASKS[task].hands), strict=True)
        )
        config = folder / "pair.toml"
        config.write_text(f'name = "pair"\n{users}', encoding="utf-8")

        def start(*arguments: str, heard: str) -> tuple[Popen[str], re.Match[str]]:
            process = start_cogrip(*arguments)
            stack.callback(process.kill)
            return process, wait_for_line(process, heard)

        quiet = ("--no-report", "--runs")
        server, found = start(
            "serve", str(config), *flags, "--port", "0", "--no-record", *quiet, str(folder / "server"),
            heard=r"listening on \S+:(\d+)",
        )  # fmt: skip
        relay, found = start(
            "relay", "--to", f"127.0.0.1:{found[1]}", "--listen", "127.0.0.1:0", "--set", f"link.delay_ms={delay_ms}",
            heard=r"relaying from \S+:(\d+) ",
        )  # fmt: skip
        people = [
            start_cogrip(
                "join", f"127.0.0.1:{found[1]}", "--config", str(config), *flags, "--name", name, "--seconds",
                str(2.0 * WAIT_S + SECONDS), *quiet, str(folder / name),
            )
            for name in NAMES
        ]  # fmt: skip
        for person in people:
            stack.callback(person.kill)
        for person in people:
            printed, ended = output_at_end(person, LOOSE_S)
            if not ended:
                raise BadInput(f"a client ended badly: {printed}")
        for process in (relay, server):
            process.send_signal(signal.SIGINT)
            output_at_end(process, END_S)
        return [recorded(folder / name, name) for name in NAMES]


def recorded(runs: Path, name: str) -> Hand:
    """Return the hand of a recording, its ticks that were skipped filled with those before."""
    end = open_run(next(runs.iterdir())).clients[name]
    columns = end.columns("tick", "tick", "force_n")
    ticks = columns["tick"].astype(int)
    at = np.searchsorted(ticks, np.arange(ticks[-1] + 1), side="right") - 1
    force = np.nan_to_num(columns["force_n"].astype(float).reshape(len(ticks), -1)[np.maximum(at, 0), 0])
    begun_s = float(columns["time_s"][0]) - end.offset_s - ticks[0] / 1024  # by the clock of this machine
    return Hand(force, begun_s, len(ticks) / len(at))


def bench_partner_live(
    *, tasks: str = "pull,rest", methods: str = "wave,partner", delays_ms: str = "20,100", json: Json = None
) -> int:
    """Measure the error of the force on two hands, live through a relay, beside the cube directly in the hands.

    Parameters
    ----------
    tasks
        Of `cogrip compare --task`, with commas between.
    methods
        Of `cogrip compare`, with commas between.
    delays_ms
        Each way.
    """
    names = tasks.split(",")
    for name in names:
        if name not in TASKS:
            raise BadInput(f"--tasks {name}: there are {', '.join(TASKS)}")
    console = make_console(stderr=json == "-")
    rows = []
    for task in names:
        for delay_ms in map(float, delays_ms.split(",")):
            for method in methods.split(","):
                found = live(task, method, delay_ms)
                step_n = max(float(np.abs(np.diff(hand.force_n)).max()) for hand in found)
                error_n, felt_n = error_of(task, found)
                rows.append(LiveRow(task, method, delay_ms, error_n, felt_n, step_n, min(hand.ran for hand in found)))
                console.print(rows[-1])
    cells = [
        (
            row.task, row.method, f"{row.delay_ms:g}", f"{row.error_n:.2f}", f"{row.felt_n:.2f}", f"{row.step_n:.2f}",
            f"{row.ran:.4f}",
        )
        for row in rows
    ]  # fmt: skip
    table = plain_table(
        ("task", "method", "ms each way", "error N", "of N", "largest step N", "ticks run"), cells, left=2
    )
    console.print(table)
    if json is not None:
        write_json({"rows": msgspec.to_builtins(rows)}, json)
    return 0
