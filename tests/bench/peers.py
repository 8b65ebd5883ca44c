"""`dev.py bench peers`: what a person costs the server, beside a server in C, VRPN and a bare Python echo, in one run.

Where the machine is busy, the people's frames come late, and a server that fills in for them does more: their share is shown.
"""

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Annotated

import msgspec
import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import within
from cogrip.cli.terminal.tables import plain_table

from tests.bench.loads.server import BARE, NETWORK_HZ, Job, Kind
from tests.bench.loads.twin import VRPN_VARIABLE, check_vrpn
from tests.bench.network import Measured, counts_of, measure, warn_if_busy
from tests.bench.processors import two_processors
from tests.bench.targets import judge

CASES: tuple[tuple[Kind, bool], ...] = (
    ("c", False), ("vrpn", False), ("echo", False), ("unencrypted", False), ("encrypted", False), ("encrypted", True),
)  # fmt: skip
NAMES = {"c": "C twin (recvmmsg)", "vrpn": "VRPN", "echo": "Python echo"}
MOST_OVER_C = {"unencrypted": 4.0, "encrypted": 8.0, "encrypted, recorded": 10.0}
MOST_OFF_LINE = 5.0  # percent
MOST_PERSON_KB = 150.0


class Cost(msgspec.Struct, frozen=True):
    """Medians over rounds, of memory the most. over_c: how many times the C twin of the same round costs.

    used_kb: of the memory, without what the heap keeps free
    """

    name: str
    people: int
    us: float  # processor time of the server's process, a person and frame
    over_c: float
    late_p99_us: float
    memory_kb: int
    used_kb: int
    missed: (
        float  # share of the people's frames that did not come in time; of a bare server, of answers that did not come
    )


def bench_peers(
    *,
    users: str = "20,50",
    seconds: float = 5.0,
    rounds: int = 3,
    per_room: int = 2,
    axes: int = 3,
    vrpn: Annotated[Path | None, Parameter(env_var=VRPN_VARIABLE)] = None,
    json: Json = None,
) -> int:
    """Measure what a person and frame cost a server in C, VRPN, a Python echo and the server here, in turns.

    The C twin takes the same datagrams with recvmmsg and answers each, VRPN with a connection a room and a message to
    everyone in it; both without session, physics, encryption or recording.
    Exit code 0 if the server costs at most 4 times as much, 8 times encrypted, 10 times encrypted and recorded; and, of three
    numbers of people and more, if its cost grows by a straight line within 5 %, its memory by less than 150 KB a person.

    Parameters
    ----------
    users
        How many people: numbers with commas between them.
    seconds
        How long each is measured.
    rounds
        How often; medians count.
    per_room
        People in a room.
    axes
        Of the object.
    vrpn
        Folder with the source of VRPN (git clone https://github.com/vrpn/vrpn); without it VRPN is left out.
    """
    counts = counts_of(users)
    within("--seconds", seconds, 1, 600)
    within("--rounds", rounds, 1, 100)
    within("--per-room", per_room, 1, 256)
    within("--axes", axes, 1, 3)
    console = make_console(stderr=json == "-")
    if vrpn is None:
        console.print("VRPN is left out: name a folder with its source (--vrpn)")
    else:
        check_vrpn(vrpn, counts[-1], per_room)
    cases = [case for case in CASES if case[0] != "vrpn" or vrpn is not None]
    before = warn_if_busy(console)
    found: list[list[Measured]] = []
    with two_processors(console) as cores:
        for number in range(rounds):
            for people in counts:
                found.append([
                    measure(Job(kind, people, per_room, axes, cores[1], vrpn=str(vrpn or "")), seconds, recorded=recorded)
                    for kind, recorded in cases
                ])  # fmt: skip
                costs = "; ".join(f"{_name(each)} {_frame_us(each):.1f}" for each in found[-1])
                console.print(f"round {number + 1}, {people} people, µs a person and frame: {costs}", markup=False)
    table = [_cost(found, people, case) for people in counts for case in range(len(cases))]
    console.print(_table(table, per_room, axes))
    reached = [
        judge(console, f"{each.name}, over the C twin", each.over_c, MOST_OVER_C[each.name], most=True, form=".1f")
        for each in table
        if each.people == counts[-1] and each.name in MOST_OVER_C
    ]
    if len(counts) >= 3:
        for name in MOST_OVER_C:
            reached += _judge_growth(console, name, [each for each in table if each.name == name])
    well = all(reached)
    if json is not None:
        write_json({"costs": msgspec.to_builtins(table), "load_before": before, "reached": well}, json)
    return 0 if well else 1


def _judge_growth(console: Console, name: str, costs: Sequence[Cost]) -> list[bool]:
    """Judge how processor time and memory grow with the people: by a line, of a fixed part and one a person."""
    people = [float(each.people) for each in costs]
    frame_us = np.array([each.people * each.us for each in costs])
    slope_us, fixed_us = np.polyfit(people, frame_us, 1)
    off = 100.0 * float(np.max(np.abs(frame_us / np.polyval((slope_us, fixed_us), people) - 1.0)))
    person_kb = float(np.polyfit(people, [each.used_kb for each in costs], 1)[0])
    console.print(f"{name}: a frame takes {fixed_us:.0f} µs and {slope_us:.2f} µs a person", markup=False)
    return [
        judge(console, f"{name}, off that line [%]", off, MOST_OFF_LINE, most=True, form=".1f"),
        judge(console, f"{name}, memory a person [KB]", person_kb, MOST_PERSON_KB, most=True, form=".0f"),
    ]


def _name(each: Measured) -> str:
    return NAMES.get(each.kind, each.name)


def _frame_us(each: Measured) -> float:
    return each.cpu_us / NETWORK_HZ


def _missed(each: Measured) -> int:
    return each.lost_down if each.kind in BARE else each.frames_lost + each.frames_late


def _cost(found: Sequence[Sequence[Measured]], people: int, case: int) -> Cost:
    rounds = [(cases[0], cases[case]) for cases in found if cases[0].people == people]
    return Cost(
        _name(rounds[0][1]),
        people,
        median(_frame_us(each) for _, each in rounds),
        median(each.cpu_us / twin.cpu_us for twin, each in rounds),
        median(each.late_us["p99"] for _, each in rounds),
        max(each.memory_kb for _, each in rounds),
        max(each.used_kb for _, each in rounds),
        median(_missed(each) / max(1, each.ticks * people) for _, each in rounds),
    )


def _table(costs: Sequence[Cost], per_room: int, axes: int) -> Table:
    headings = (
        "server",
        "people",
        "µs a person\nand frame",
        "over\nC twin",
        "late p99\nµs",
        "memory\nMB",
        "frames\nmissed %",
    )
    rows = [
        [each.name, f"{each.people}", f"{each.us:.1f}", f"{each.over_c:.1f}", f"{each.late_p99_us:.0f}",
         f"{each.memory_kb / 1024:.0f}", f"{100.0 * each.missed:.1f}"]
        for each in costs
    ]  # fmt: skip
    return plain_table(headings, rows, title=f"rooms of {per_room}, {axes} axes, {NETWORK_HZ} Hz")
