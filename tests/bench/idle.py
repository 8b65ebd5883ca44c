"""`dev.py bench idle`: what rooms without people cost a server, beside those in use."""

from collections.abc import Sequence
from statistics import median

import msgspec

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, within
from cogrip.cli.terminal.tables import plain_table

from tests.bench.loads.server import NETWORK_HZ, Job
from tests.bench.network import MOST_LATE_US, Measured, measure, warn_if_busy
from tests.bench.processors import two_processors
from tests.bench.targets import judge

PER_ROOM = 2
MOST_OVER = 1.05  # times what the rooms in use cost alone


class Cost(msgspec.Struct, frozen=True):
    """Medians over rounds. over: how many times what the rooms in use took alone in the same round."""

    rooms: int
    frame_us: float  # processor time of the server's process, a frame
    over: float
    late_p99_us: float
    memory_kb: float


def bench_idle(*, rooms: int = 1000, used: int = 10, seconds: float = 5.0, rounds: int = 3, json: Json = None) -> int:
    """Measure a server of many rooms of which some are used, and one of the used rooms alone, in turns.

    Encrypted and recorded, rooms of 2, 3 axes, 128 Hz. Exit code 0 if processor time is at most 1.05 times that of the
    used rooms alone, and the 99th percentile of the lateness below 2 ms.

    Parameters
    ----------
    rooms
        Rooms of the server.
    used
        Those with people in them.
    seconds
        How long each server is measured.
    rounds
        How often; medians count.
    """
    within("--used", used, 1, 400)
    within("--rooms", rooms, 2, 10_000)
    if rooms <= used:
        raise BadInput(f"--rooms {rooms}: more than the {used} that are used")
    within("--seconds", seconds, 1, 600)
    within("--rounds", rounds, 1, 100)
    console = make_console(stderr=json == "-")
    before = warn_if_busy(console)
    found: dict[int, list[Measured]] = {used: [], rooms: []}
    with two_processors(console) as cores:
        for _ in range(rounds):
            for count, servers in found.items():
                job = Job("encrypted", used * PER_ROOM, PER_ROOM, core=cores[1], rooms=count)
                servers.append(measure(job, seconds, recorded=True))
    alone, all_rooms = (_cost(count, servers, found[used]) for count, servers in found.items())
    headings = ("rooms", "in use", "µs a frame", "over those\nin use", "late p99\nµs", "memory\nMB")
    rows = [
        [f"{each.rooms}", f"{used}", f"{each.frame_us:.0f}", f"{each.over:.2f}", f"{each.late_p99_us:.0f}",
         f"{each.memory_kb / 1024:.0f}"]
        for each in (alone, all_rooms)
    ]  # fmt: skip
    console.print(plain_table(headings, rows, title=f"encrypted, recorded, rooms of {PER_ROOM}, {NETWORK_HZ} Hz"))
    room_kb = (all_rooms.memory_kb - alone.memory_kb) / (rooms - used)
    console.print(
        f"a room without people: {(all_rooms.frame_us - alone.frame_us) / (rooms - used):.3f} µs a frame, {room_kb:.0f} KB"
    )
    well = judge(
        console, f"{rooms} rooms over {used}, processor time", all_rooms.over, MOST_OVER, most=True, form=".3f"
    )
    late = judge(
        console, f"{rooms} rooms, p99 lateness [µs]", all_rooms.late_p99_us, MOST_LATE_US, most=True, form=".0f"
    )
    if json is not None:
        costs = msgspec.to_builtins((alone, all_rooms))
        write_json({"costs": costs, "load_before": before, "reached": well and late}, json)
    return 0 if well and late else 1


def _cost(rooms: int, servers: Sequence[Measured], alone: Sequence[Measured]) -> Cost:
    return Cost(
        rooms,
        median(each.cpu_us * each.people / NETWORK_HZ for each in servers),
        median(each.cpu_us / other.cpu_us for each, other in zip(servers, alone, strict=True)),
        median(each.late_us["p99"] for each in servers),
        median(each.used_kb for each in servers),
    )
