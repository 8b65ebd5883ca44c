"""`dev.py bench killed`: a worker of a server is killed with -9, again and again, while a person holds in each room."""

import re
import secrets
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Annotated

import msgspec
from cyclopts import Parameter

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within

from tests.bench.losses import QUIET_S, Loss, Result, commands, let_go, lose, result_of, table_of
from tests.free_ports import free_port
from tests.live.held_arms import DEMO, Spoken
from tests.live.raylets import kill
from tests.live.test_unauthenticated_peers import PULL

BACK_S = 1.0  # within which everybody is asked to have resumed


def bench_killed(
    *,
    workers: int = 2,
    rooms: int = 4,
    rounds: int = 3,
    quiet: Annotated[float, Parameter(name="--seconds")] = QUIET_S,
    insecure: Annotated[bool, Parameter(negative="")] = False,
    json: Json = None,
) -> int:
    """Kill a worker with -9, while a recorded client of 1024 Hz holds in each room; as often as asked, in one session.

    Exit code 0 if, by medians, everybody is back in 1 s, no force steps by more than 0.5 N, and the other rooms' p99 is
    unchanged.

    Parameters
    ----------
    workers
        How many processes have the rooms.
    rooms
        How many, with a person each.
    rounds
        How often a worker is killed.
    quiet
        How long the rooms are measured before and after each kill [s].
    insecure
        Without encryption.
    """
    within("--workers", workers, 2, 8)
    within("--rooms", rooms, workers, 16)
    within("--rounds", rounds, 1, 20)
    within("--seconds", quiet, 2, 60)
    if sys.platform != "linux":
        raise Problem("several workers need Linux")
    console = make_console(stderr=json == "-")
    with commands() as (start, base):
        try:
            losses, people = _kill_workers(start, base, workers, rooms, rounds, quiet, insecure)
            results = [result_of(loss, people, base / "rooms", quiet) for loss in losses]
        except AssertionError as error:
            raise Problem(f"the session did not come to its end: {error}") from None
    middle = _middle(results)
    console.print(table_of("worker", [*results, middle] if rounds > 1 else results))
    if json is not None:
        write_json({"losses": msgspec.to_builtins(results), "reached": middle.well}, json)
    return 0 if middle.well else 1


def _kill_workers(
    start: Callable[..., Spoken], base: Path, workers: int, rooms: int, rounds: int, quiet_s: float, insecure: bool
) -> tuple[list[Loss], dict[str, Spoken]]:
    """Kill the worker that was started last, `rounds` times; then everybody leaves."""
    port, configs = free_port(), []
    for number in range(rooms):
        configs.append(base / f"room{number}.toml")
        configs[-1].write_text(DEMO.read_text("utf-8").replace('name = "demo"', f'name = "room{number}"'), "utf-8")
    server = start(
        "serve", *configs, "--workers", workers, "--port", port, "--state", base / "state", "--seconds", "3600",
        "--no-report", "--set", "link.delay_ms=0", "--runs", base / "rooms", "--insecure" if insecure else "--encrypted",
    )  # fmt: skip
    server.hear("listening on")
    people = {}
    for number in range(rooms):
        name = f"room{number}"
        link = re.search(rf"join {name} as player: .*'(cogrip:\S+)'", server.said)
        where = (link[1],) if link else (f"127.0.0.1:{port}", "--room", name)
        people[name] = person = start(
            "join", *where, "--no-report", "--runs", runs := base / secrets.token_hex(4), *PULL
        )
        person.runs = runs
        person.hear(f"holds cube in room {name}")

    def kill_newest() -> None:
        newest = re.findall(r"worker \d+ \(process (\d+)\) serves", server.said)[-1]
        kill([int(newest)])

    losses = [lose(f"kill -9, {number + 1}", kill_newest, people, quiet_s, BACK_S) for number in range(rounds)]
    let_go(people)
    server.popen.send_signal(signal.SIGINT)
    server.end()
    return losses, people


def _middle(results: list[Result]) -> Result:
    """Return the medians."""
    return Result(
        "median", BACK_S, round(median(each.moved for each in results)), median(each.back_s for each in results),
        median(each.step_n for each in results),
        (median(each.late_us[0] for each in results), median(each.late_us[1] for each in results)),
    )  # fmt: skip
