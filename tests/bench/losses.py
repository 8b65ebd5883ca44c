"""Loss of a process while people hold in rooms: when all are back, how their forces step, how late the other rooms are."""

import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from rich.table import Table

from cogrip.cli.terminal.problem import Problem
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.recording.reader import open_recording
from cogrip.results.reading.records import End
from cogrip.server.recorder import step_topic

from tests.bench.targets import reached
from tests.live.held_arms import Spoken
from tests.live.test_unauthenticated_peers import MOST_STEP_N, recording_of

MOST_RATIO = 1.5  # of the p99 after to the one before, within what two spans of a shared machine differ
FEW_US = 100.0  # a p99 below which no ratio is asked for
QUIET_S = 8.0
LOOK_S = 0.02
RESUMED = "the server answers again"


class Result(msgspec.Struct, frozen=True):
    """Result of one loss. most_back_s: asked for; late_us: worst p99 of the rooms that stayed, before and after."""

    what: str
    most_back_s: float
    moved: int
    back_s: float
    step_n: float
    late_us: tuple[float, float]

    @property
    def well(self) -> bool:
        before_us, after_us = self.late_us
        unchanged = after_us <= max(MOST_RATIO * before_us, FEW_US)
        return self.back_s <= self.most_back_s and self.step_n <= MOST_STEP_N and unchanged


class Loss(NamedTuple):
    """One loss. at_ns: Unix time; back_s: until force ramped in again, of each room that moved."""

    what: str
    most_back_s: float
    at_ns: int
    back_s: dict[str, float]


def lose(
    what: str, act: Callable[[], object], people: Mapping[str, Spoken], quiet_s: float, most_back_s: float
) -> Loss:
    """Act after a quiet span, and follow who resumes until nobody can any more."""
    time.sleep(quiet_s)
    before = {name: person.said.count(RESUMED) for name, person in people.items()}
    at_ns, begun_s, back_s = time.time_ns(), time.monotonic(), {}
    act()
    while (passed_s := time.monotonic() - begun_s) < most_back_s + quiet_s:
        for name, person in people.items():
            if name not in back_s and person.said.count(RESUMED) > before[name]:
                back_s[name] = passed_s
        time.sleep(LOOK_S)
    ended = [name for name, person in people.items() if person.popen.poll() is not None]
    if ended or not back_s:
        words = [f"{name} ended: {people[name].said.strip().rpartition(chr(10))[2]}" for name in ended]
        raise Problem(f"{what}: " + ("; ".join(words) or "nobody had to move"))
    return Loss(what, most_back_s, at_ns, back_s)


def result_of(loss: Loss, people: Mapping[str, Spoken], runs: Path, quiet_s: float) -> Result:
    """Read the steps of the forces and the lateness of the rooms that stayed from the recordings."""
    end_ns = loss.at_ns + int((loss.most_back_s + quiet_s) * 1e9)
    step_n = 0.0
    for name in loss.back_s:
        end = recording_of(people[name])
        begin_s, end_s = ((at - end.recording.header.epoch_ns) * 1e-9 for at in (loss.at_ns, end_ns))
        columns = end.columns("tick", "tick", "force_n")
        here = (columns["time_s"] >= begin_s - 1) & (columns["time_s"] < end_s)
        ticks, forces_n = columns["tick"][here], columns["force_n"][here]
        steps_n = np.linalg.norm(np.diff(forces_n, axis=0), axis=1)[np.diff(ticks) == 1]
        step_n = max(step_n, float(np.max(steps_n)))
    late_us: tuple[list[float], list[float]] = ([], [])
    for path in runs.glob("**/server.mcap"):
        end = End(open_recording(path))
        for name in people.keys() - loss.back_s.keys():
            if step_topic(name) in end.recording.topics:
                columns = end.columns(step_topic(name), "late_us")
                since_s = columns["time_s"] - (loss.at_ns - end.recording.header.epoch_ns) * 1e-9
                for spans, here in zip(
                    late_us, ((-quiet_s < since_s) & (since_s < 0), (since_s >= 0) & (since_s < quiet_s)), strict=True
                ):
                    if here.any():
                        spans.append(float(np.percentile(columns["late_us"][here], 99)))
    if not all(late_us):
        raise Problem(f"{loss.what}: no room stayed where it was; give more --rooms")
    late = max(late_us[0]), max(late_us[1])
    return Result(loss.what, loss.most_back_s, len(loss.back_s), max(loss.back_s.values()), step_n, late)


def let_go(people: Mapping[str, Spoken]) -> None:
    """Let everybody leave."""
    for person in people.values():
        person.popen.send_signal(signal.SIGINT)
    for person in people.values():
        person.end()


@contextmanager
def commands() -> Iterator[tuple[Callable[..., Spoken], Path]]:
    """Give a function that starts commands of `cogrip`, and a folder; end what is left of them, the newest first."""
    started: list[Spoken] = []

    def start(*arguments: object) -> Spoken:
        started.append(Spoken(*map(str, arguments)))
        return started[-1]

    with tempfile.TemporaryDirectory(prefix="cogrip-bench-", ignore_cleanup_errors=True) as base:
        try:
            yield start, Path(base)
        finally:
            for process in reversed(started):
                process.stop()


def table_of(heading: str, results: Sequence[Result]) -> Table:
    """Return the table of some losses of one kind. heading: of what was lost."""
    headings = (
        heading,
        "rooms\nmoved",
        f"all back [s],\nasked {results[0].most_back_s:g}",
        f"largest step [N],\nasked {MOST_STEP_N:g}",
        "others' p99 late\n[us], before, after",
        "",
    )
    rows = [
        (each.what, f"{each.moved}", f"{each.back_s:.2f}", f"{each.step_n:.3f}",
         f"{each.late_us[0]:.0f}, {each.late_us[1]:.0f}", reached(each.well))
        for each in results
    ]  # fmt: skip
    return plain_table(headings, rows, left=1)
