"""`dev.py bench network --flood`: two people at an encrypted server under 20,000 foreign datagrams a second."""

import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from cogrip.cli.terminal.output import Json, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import plain_table

from tests.bench.loads.flood import Done, Flood, samples_of
from tests.bench.loads.flood import Job as FloodJob
from tests.bench.loads.people import Load, LoadError
from tests.bench.loads.server import ASK_S, HOST, SETTLE_S, Job, Process, Reading, make_load
from tests.bench.processors import two_processors
from tests.bench.targets import reached

MOST_RATIO = 2.0  # of the p99 lateness, over that of the part without a flood
SHORT_US = 100.0  # less than this is the machine's own noise: what a flood makes of it is not judged as a ratio
MOST_GROWTH_KB = 4096
PEOPLE = 2
MARGIN_S = 0.5  # a flood lasts longer than what is measured of it
QUIET = "no flood"


class Span(msgspec.Struct, frozen=True):
    """Measurements during one kind of flood."""

    kind: str
    sent_per_s: float
    late_us: dict[str, float]
    work_us: dict[str, float]
    skipped: int
    seated: int
    frames_lost: int
    frames_late: int
    memory_kb: int
    drops: dict[str, int]


def bench_flood(seconds: float, console: Console, json: Json) -> int:
    """Every kind of flood, then all of them mixed. Exit code 0 if no seat was lost, ticks are punctual and memory is flat."""
    if sys.platform != "linux":
        raise BadInput("--flood needs Linux: elsewhere loopback has one address, and no thousand")
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base, two_processors(console) as cores:
        job = Job("encrypted", PEOPLE, PEOPLE, 3, cores[1], str(Path(base) / "state"), str(Path(base) / "server.mcap"))
        server = Process(job)
        load = make_load(job, server)
        try:
            load.join()
            spans = list(_spans(load, server, seconds, console))
            load.leave()
        except LoadError as error:
            raise Problem(f"encrypted server: {error}") from None
        finally:
            load.close()
            server.end()
    console.print(_table(spans))
    well = judge(spans, console)
    if json is not None:
        write_json({"spans": msgspec.to_builtins(spans), "reached": well}, json)
    return 0 if all(well.values()) else 1


def _spans(load: Load, server: Process, seconds: float, console: Console) -> Sequence[Span]:
    records: list[bytes] = []
    load.run(SETTLE_S, lambda now_ns: records.append(load.people[0].last))
    samples = samples_of((HOST, server.started.port), server.started.fingerprint, records)
    kinds = [QUIET, *samples, QUIET]
    spans = []
    for kind in kinds:
        flood = None
        if kind != QUIET:
            flood = Flood(FloodJob(HOST, server.started.port, seconds + 2 * MARGIN_S + ASK_S, samples[kind]))
        load.run(MARGIN_S)
        first = _look(load, server)
        load.run(seconds)
        last = _look(load, server)
        load.run(MARGIN_S)
        spans.append(_span(kind, first, last, flood.end() if flood else None))
        console.print(f"{kind}: {spans[-1].sent_per_s:.0f} datagrams/s, p99 lateness {spans[-1].late_us['p99']:.0f} µs")
    return spans


def _look(load: Load, server: Process) -> Reading:
    server.ask()
    load.run(ASK_S)
    return server.answer()


def _span(kind: str, first: Reading, last: Reading, done: Done | None) -> Span:
    drops = {
        reason: more for reason, count in sorted(last.drops.items()) if (more := count - first.drops.get(reason, 0))
    }
    return Span(
        kind, done.per_second if done else 0.0, last.late_us, last.work_us, last.skipped - first.skipped, last.seated,
        last.frames_lost - first.frames_lost, last.frames_late - first.frames_late, last.memory_kb, drops,
    )  # fmt: skip


def _table(spans: Sequence[Span]) -> Table:
    headings = (
        "flood", "dropped, by reason", "datagrams\n/s", "late p50/p99\nµs", "over\nquiet", "work p50/p99\nµs",
        "frames\nlost/late", "memory\nMB",
    )  # fmt: skip
    quiet = spans[0].late_us["p99"]
    rows = [
        [
            span.kind, ", ".join(f"{reason} {count}" for reason, count in span.drops.items()) or "nothing",
            f"{span.sent_per_s:.0f}", f"{span.late_us['p50']:.0f}/{span.late_us['p99']:.0f}",
            f"{span.late_us['p99'] / quiet:.2f}", f"{span.work_us['p50']:.0f}/{span.work_us['p99']:.0f}",
            f"{span.frames_lost}/{span.frames_late}", f"{span.memory_kb / 1024:.1f}",
        ]
        for span in spans
    ]  # fmt: skip
    table = plain_table(headings, rows, left=2, gap=2, title="encrypted, two people, one room")
    table.columns[1].no_wrap = False
    return table


def judge(spans: Sequence[Span], console: Console) -> Mapping[str, bool]:
    """The first span has no flood."""
    quiet_us = max(SHORT_US, spans[0].late_us["p99"])
    floods = [span for span in spans if span.sent_per_s]
    worst = max(floods, key=lambda span: span.late_us["p99"])
    ratio = worst.late_us["p99"] / quiet_us
    growth_kb = spans[-1].memory_kb - spans[0].memory_kb
    seated = min(span.seated for span in spans)
    well = {
        "seats": seated == PEOPLE,
        "lateness": ratio <= MOST_RATIO,
        "memory": growth_kb <= MOST_GROWTH_KB,
        "counted": all(span.drops for span in floods),
    }
    console.print(f"seats kept: {seated} of {PEOPLE}: {reached(well['seats'])}")
    console.print(
        f"p99 lateness, at worst ({worst.kind}) over that without a flood (or {SHORT_US:g} µs, if that is more): {ratio:.2f}; "
        f"at most {MOST_RATIO:g} is asked for: {reached(well['lateness'])}"
    )
    grown = f"memory grew by {growth_kb / 1024:.1f} MB; at most {MOST_GROWTH_KB / 1024:g}"
    console.print(f"{grown}: {reached(well['memory'])}")
    console.print(f"what was dropped is counted: {reached(well['counted'])}")
    return well
