"""`dev.py bench pauses`: what a processor forgets between two ticks, and how often something takes it away."""

import subprocess
from statistics import median

import msgspec

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import within
from cogrip.cli.terminal.tables import plain_table

from tests.bench.loads.compiled import compiled

PAUSES_US = (0, 100, 1000, 8000)  # back to back; a tick at 8192 Hz; at 1024 Hz; a frame at 128 Hz
ROUNDS = 200
KINDS = {
    "line": "data, the next line of 64 bytes",
    "page": "data, a line of another page",
    "call": "code, a call of another line",
    "pointer": "code, a call by a pointer",
}


class Answer(msgspec.Struct, frozen=True):
    """Answer of `pauses.c`. lost: share of the time in interruptions of more than 1 us; access_ns: at each pause."""

    interruptions_per_s: float
    lost: float
    access_ns: dict[str, list[float]]


def bench_pauses(*, seconds: float = 2.0, rounds: int = 3, json: Json = None) -> int:
    """Measure what one access takes after a pause in which this processor only reads the clock.

    Nothing else happens in the pause: what takes longer after it was forgotten for the sake of somebody else, another
    program or another machine on the same hardware. On a quiet machine rows are the same from end to end.

    Parameters
    ----------
    seconds
        For how long interruptions are counted, in each round.
    rounds
        How often everything is measured; medians count.
    """
    within("--seconds", seconds, 0.1, 60)
    within("--rounds", rounds, 1, 100)
    console = make_console(stderr=json == "-")
    command = [str(compiled("pauses.c")), str(seconds), str(ROUNDS), *map(str, PAUSES_US)]
    answers = [
        msgspec.json.decode(subprocess.run(command, capture_output=True, check=True).stdout, type=Answer)
        for _ in range(rounds)
    ]
    access_ns = {
        kind: [median(times) for times in zip(*[answer.access_ns[kind] for answer in answers], strict=True)]
        for kind in KINDS
    }
    rows = [(KINDS[kind], *(f"{ns:.1f}" for ns in times)) for kind, times in access_ns.items()]
    console.print(plain_table(("one access [ns], after a pause of", *(f"{us} µs" for us in PAUSES_US)), rows))
    interrupted = ("interruptions_per_s", "lost")
    times_per_s, lost = [median([getattr(each, name) for each in answers]) for name in interrupted]
    console.print(
        f"interrupted for more than 1 µs {times_per_s:.0f} times a second, for {100 * lost:.1f} % of the time"
    )
    if json is not None:
        write_json(
            {"pauses_us": PAUSES_US, "access_ns": access_ns, "interruptions_per_s": times_per_s, "lost": lost}, json
        )
    return 0
