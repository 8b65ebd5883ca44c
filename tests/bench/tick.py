"""`dev.py bench tick`: processor time of a client's tick with each coupling, over that of the session with plain wave lines."""

import gc
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import within
from cogrip.cli.terminal.tables import plain_table
from cogrip.sim.laboratory import Laboratory

from tests.bench.targets import reached

MOST = 1.3
PRESS = "waypoints&times_s=1,1.5,4,4.5,5&x_m=0,0.09,0.09,0,0&rz_rad=0,0.3,-0.3,0,0.3"
TUNED = ("coupling.impedance_nspm=auto", "coupling.wave_filter_hz=auto")
LOCAL = ("coupling.kind=local",)
POSES = ("object.axes=6", "users.0.tool=ball", "users.0.device=sim:freeflyer", "users.0.hand=" + PRESS)
SESSIONS: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("cube, tuned", "demo", (), TUNED),
    ("cube, virtual coupling", "demo", (), ("coupling.kind=coupling",)),
    ("cube, tdpa", "demo", (), ("coupling.kind=tdpa",)),
    ("wall, local", "demo", ("object.kind=wall", "coupling.stiffness_npm=500"), LOCAL),
    ("faces, local", "demo", ("object.kind=faces",), LOCAL),
    ("scene wall, local", "wall", (), LOCAL),
    ("scene lift, local", "lift", (), LOCAL),
    ("scene table, local", "table", (), LOCAL),
    ("scene wall of six axes, local", "wall", POSES, LOCAL),
)
"""Name, settings, what both sessions of a pair have, and what the second one has besides."""
BLOCK = 16  # frames


class TimedSession:
    """A laboratory whose clients' ticks are timed: `sense` and `act`, nothing else."""

    def __init__(self, name: str, overrides: tuple[str, ...], seconds: float) -> None:
        self.laboratory = Laboratory(load(Path(name), [*overrides, f"seconds={seconds}"]))
        self._spent_ns = self._ticks = 0
        for person in self.laboratory.people:
            core = person.core
            core.sense, core.act = self._timed(core.sense), self._timed(core.act)  # type: ignore[method-assign]

    def _timed(self, half: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any) -> Any:
            start_ns = time.thread_time_ns()
            result = half(*args)
            self._spent_ns += time.thread_time_ns() - start_ns
            self._ticks += 1
            return result

        return run

    def take_us(self) -> float:
        """Return the mean time of a tick [us] since the last call."""
        took_us = self._spent_ns * 1e-3 / (self._ticks / 2)
        self._spent_ns = self._ticks = 0
        return took_us


def bench_tick(*, seconds: float = 10.0) -> int:
    """Run two sessions in turns, frame by frame: one with wave lines, one with another coupling. Ratios are of whole sessions.

    Parameters
    ----------
    seconds
        Of each session, in its own time.
    """
    within("--seconds", seconds, 1.0, 600.0)
    console = make_console()
    rows, well = [], True
    for name, file, both, more in SESSIONS:
        blocks = blocks_us(file, both, more, seconds)
        ratio = float(blocks[:, 1].sum() / blocks[:, 0].sum())
        well = well and ratio <= MOST
        waves_us, other_us = np.median(blocks, axis=0)
        spread = np.percentile(blocks[:, 1] / blocks[:, 0], (5, 95))
        body = (f"{waves_us:.1f}", f"{other_us:.1f}", f"{ratio:.2f}", f"{spread[0]:.2f} to {spread[1]:.2f}")
        rows.append([name, *body, reached(ratio <= MOST)])
    headings = ("session", "waves us", "this us", "ratio", "of blocks", f"<= {MOST:g}")
    console.print(plain_table(headings, rows, gap=2, title=f"a client's tick, sessions of {seconds:g} s"))
    return 0 if well else 1


def blocks_us(file: str, both: tuple[str, ...], more: tuple[str, ...], seconds: float) -> np.ndarray:
    """Return the mean tick of each block of frames, shape (blocks, 2) [us]. A session that ends early ends both."""
    pair = TimedSession(file, both, seconds), TimedSession(file, both + more, seconds)
    took = []
    gc.collect()
    gc.disable()
    try:
        for frame in range(pair[0].laboratory.frames):
            for session in pair:
                session.laboratory.frame()
            if frame % BLOCK == BLOCK - 1:
                took.append([session.take_us() for session in pair])
            if any(session.laboratory.incident for session in pair):
                break
    finally:
        gc.enable()
    return np.array(took)
