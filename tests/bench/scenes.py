"""`dev.py bench scenes`: time of a frame of each scene, ledger and limiter included; and of a laboratory's session with one."""

import time
from math import inf, isinf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console

from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.schemes import make_scene_world

from tests.bench.targets import judge, reached

FOUR = "four people, ten boxes"
LIFT_S, LEAST_SPEED = 20.0, 8.0
MOST_US = {
    "wall": (200.0, 500.0), "lift": (200.0, 500.0), "pile": (400.0, 1500.0), "peg": (400.0, 1500.0),
    "table": (inf, 2000.0), "valve": (400.0, 1500.0), "wheel": (400.0, 1500.0), FOUR: (inf, 2000.0),
}  # fmt: skip
"""Most of the median and of the 99th percentile that is asked for."""
TEN = """<mujoco>
  <default><geom margin=".0015"/></default>
  <worldbody>
    <geom type="plane" size="1 1 .1" contype="0" conaffinity="3"/>
    <replicate count="5" offset="0 .045 0"><replicate count="2" offset="0 0 .041">
      <body pos="0 -.09 .0205">
        <freejoint/>
        <geom type="box" size=".02 .02 .02" mass=".1" contype="0" conaffinity="3"/>
        <replicate count="2" offset=".024 0 0"><replicate count="2" offset="0 .024 0"><replicate count="2" offset="0 0 .024">
          <geom size=".008" pos="-.012 -.012 -.012" mass="0" contype="2" conaffinity="0" group="3"/>
        </replicate></replicate></replicate>
      </body>
    </replicate></replicate>
  </worldbody>
</mujoco>"""
"""Ten boxes, two on each other, five side by side, with balls in their corners like those of the pile. Their neighbours 5 mm
away are no contacts, as docs/worlds.md has it for crowded scenes; tools have the margin that they come with."""


def bench_scenes(*, frames: int = 10_000, substeps: int = 4) -> int:
    """People push and pull about the object; the time is the processor's, of this thread alone.

    Parameters
    ----------
    frames
        How many are timed of each scene.
    substeps
        Steps a frame.
    """
    console = make_console()
    rows, well = [], True
    with TemporaryDirectory() as folder:
        ten = Path(folder) / "ten.xml"
        ten.write_text(TEN)
        for name, most in MOST_US.items():
            settings = _four(ten, substeps) if name == FOUR else load(Path(name), [f"object.substeps={substeps}"])
            halves = np.percentile(_frame_times_us(settings, frames), (50, 99))
            fits = bool(np.all(halves <= most))
            well = well and fits
            asked = " / ".join("-" if isinf(value) else f"{value:g}" for value in most)
            rows.append([name, *(f"{value:.0f}" for value in halves), asked, reached(fits)])
    headings = ("scene", "p50 us", "p99 us", "asked for", "")
    console.print(plain_table(headings, rows, gap=2, title=f"a frame of {substeps} steps, {frames} frames"))
    return 0 if _laboratory(console) and well else 1


def _laboratory(console: Console) -> bool:
    """Return whether two people lift in virtual time as fast as asked for, recorded. Without recordings, to compare with."""
    settings = load(Path("lift"), [f"seconds={LIFT_S}"])
    speeds = {}
    for recorded in (False, True):
        with TemporaryDirectory() as folder:
            start_ns = time.process_time_ns()
            run_laboratory(settings, Path(folder) if recorded else None)
            speeds[recorded] = LIFT_S / ((time.process_time_ns() - start_ns) * 1e-9)
    console.print(f"a laboratory's lift without recordings, over real time: {speeds[False]:.1f}")
    return judge(console, "with recordings", speeds[True], LEAST_SPEED)


def _four(file: Path, substeps: int) -> Settings:
    """Return the settings of four people at a scene, a pad each."""
    thing = {"kind": "scene", "file": str(file), "axes": 3, "substeps": substeps}
    return resolve({"object": thing, "users": [{"side": ("left", "right")[seat % 2]} for seat in range(4)]})


def _frame_times_us(settings: Settings, frames: int) -> list[float]:
    """Return the time of each frame while the hands are drawn to places at random beside the object."""
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
