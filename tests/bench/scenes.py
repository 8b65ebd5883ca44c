"""`dev.py bench scenes`: time of a frame of each scene, ledger and limiter included."""

import time
from pathlib import Path

import numpy as np

from cogrip.cli.session.settings_file import load
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.settings import seat_settings
from cogrip.server.schemes import make_scene_world

from tests.bench.targets import reached

MOST_US = {
    "wall": (200.0, 500.0), "lift": (200.0, 500.0), "pile": (400.0, 1500.0), "peg": (400.0, 1500.0),
    "table": (1000.0, 2000.0), "valve": (400.0, 1500.0), "wheel": (400.0, 1500.0),
}  # fmt: skip
"""Settings of scenes: most of the median and of the 99th percentile that is asked for."""


def bench_scenes(*, frames: int = 10_000, substeps: int = 4) -> int:
    """The people of each scene push and pull about the object; the time is the processor's, of this thread alone.

    Parameters
    ----------
    frames
        How many are timed of each scene.
    substeps
        Steps a frame.
    """
    console = make_console()
    rows, well = [], True
    for name, most in MOST_US.items():
        halves = np.percentile(_frame_times_us(name, frames, substeps), (50, 99))
        fits = bool(np.all(halves <= most))
        well = well and fits
        rows.append([name, *(f"{value:.0f}" for value in halves), f"{most[0]:g} / {most[1]:g}", reached(fits)])
    headings = ("scene", "p50 us", "p99 us", "asked for", "")
    console.print(plain_table(headings, rows, gap=2, title=f"a frame of {substeps} steps, {frames} frames"))
    return 0 if well else 1


def _frame_times_us(name: str, frames: int, substeps: int) -> list[float]:
    """Return the time of each frame while the hands are drawn to places at random beside the object."""
    settings = load(Path(name), [f"object.substeps={substeps}"])
    people = range(len(settings.users))
    world = make_scene_world(settings, [seat_settings(settings, seat) for seat in people])
    random = np.random.default_rng(1)
    goal = np.zeros((len(people), world.axes))
    times_us = []
    for user in people:
        world.join(user, np.zeros(world.axes))
    for frame in range(frames):
        if frame % 60 == 0:
            goal = random.uniform(-0.12, 0.12, goal.shape)
        place = np.array([world.proxy(user) for user in people])
        waves = np.clip(30.0 * (goal - place), -1.0, 1.0).tolist()
        start_ns = time.thread_time_ns()
        world.advance(waves)
        times_us.append((time.thread_time_ns() - start_ns) * 1e-3)
    return times_us
