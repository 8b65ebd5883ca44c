"""`dev.py bench cost`: what a person and frame cost the server, from prepared messages in one process to a recorded server."""

from collections.abc import Sequence
from statistics import median

import msgspec
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import within
from cogrip.cli.terminal.tables import plain_table

from tests.bench.loads.in_process import spent
from tests.bench.loads.server import NETWORK_HZ, Job, Kind
from tests.bench.network import counts_of, measure, warn_if_busy
from tests.bench.processors import two_processors

PACES = {
    "none": "in process, back to back",
    "spin": "at 128 Hz, awake in between",
    "sleep": "at 128 Hz, asleep in between",
}
LIVE: tuple[tuple[str, Kind, bool], ...] = (
    ("with socket, housekeeping, checkpoints", "unencrypted", False),
    ("and encryption", "encrypted", False),
    ("and recording", "encrypted", True),
)


class Row(msgspec.Struct, frozen=True):
    """One way of running the server: medians over rounds, in us of processor time a person and frame."""

    step: str
    us: dict[int, float]  # by the number of people


def bench_cost(
    *, users: str = "2,20,100", frames: int = 512, rounds: int = 3, per_room: int = 2, axes: int = 3, json: Json = None
) -> int:
    """Measure what a person and frame cost the server, one ingredient after the other: pace, socket, encryption, recording.

    Parameters
    ----------
    users
        How many people: numbers with commas between them.
    frames
        For how many frames each is measured.
    rounds
        How often, in turns; medians count.
    per_room
        People in a room.
    axes
        Of the object.
    """
    counts = counts_of(users)
    within("--frames", frames, 16, 10_000)
    within("--rounds", rounds, 1, 100)
    within("--per-room", per_room, 1, 256)
    within("--axes", axes, 1, 3)
    console = make_console(stderr=json == "-")
    before = warn_if_busy(console)
    found: dict[tuple[str, int], list[float]] = {}
    with two_processors(console) as cores:
        for _ in range(rounds):
            for people in counts:
                for pace, step in PACES.items():
                    took = spent(people, per_room, axes, frames, pace)
                    found.setdefault((step, people), []).append(took.all_us)
                    console.print(f"{people} people, {step}: receive {took.receive_us:.1f}, tick {took.tick_us:.1f} µs")
                for step, kind, recorded in LIVE:
                    live = measure(Job(kind, people, per_room, axes, cores[1]), frames / NETWORK_HZ, recorded=recorded)
                    found.setdefault((step, people), []).append(live.cpu_us / NETWORK_HZ)
                    console.print(f"{people} people, {step}: {live.cpu_us / NETWORK_HZ:.1f} µs")
    steps = [*PACES.values(), *(step for step, _, _ in LIVE)]
    rows = [Row(step, {people: median(found[step, people]) for people in counts}) for step in steps]
    console.print(_table(rows, counts, per_room, axes))
    if json is not None:
        write_json({"steps": msgspec.to_builtins(rows), "load_before": before}, json)
    return 0


def _table(rows: Sequence[Row], counts: Sequence[int], per_room: int, axes: int) -> Table:
    headings = ("µs a person and frame", *(f"{people} people" for people in counts))
    body = [[row.step, *(f"{row.us[people]:.1f}" for people in counts)] for row in rows]
    return plain_table(headings, body, title=f"rooms of {per_room}, {axes} axes, {NETWORK_HZ} Hz")
