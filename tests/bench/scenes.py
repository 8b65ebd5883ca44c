"""`dev.py bench scenes`: time of a frame of each scene, ledger and limiter included."""

import time
from math import inf, isinf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cogrip.cli.session.shipped_settings import shipped_scene
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.settings import resolve, seat_settings
from cogrip.server.schemes import make_scene_world

from tests.bench.targets import reached

FOUR = "four people, ten boxes"
MOST_US = {"wall": (200.0, 500.0), "lift": (200.0, 500.0), "pile": (400.0, 1500.0), FOUR: (inf, 2000.0)}
"""Most of the median and of the 99th percentile that is asked for."""
TEN = """<mujoco>
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
"""Ten boxes, two on each other, five side by side, with balls in their corners like those of the pile."""


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
            file, people = (ten, 4) if name == FOUR else (shipped_scene(f"{name}.xml"), 2)
            halves = np.percentile(_frame_times_us(file, people, frames, substeps), (50, 99))
            fits = bool(np.all(halves <= most))
            well = well and fits
            asked = " / ".join("-" if isinf(value) else f"{value:g}" for value in most)
            rows.append([name, *(f"{value:.0f}" for value in halves), asked, reached(fits)])
    headings = ("scene", "p50 us", "p99 us", "asked for", "")
    title = f"a frame of {substeps} steps, two people where no number is given, {frames} frames"
    console.print(plain_table(headings, rows, gap=2, title=title))
    return 0 if well else 1


def _frame_times_us(file: Path, people: int, frames: int, substeps: int) -> list[float]:
    """Return the time of each frame while the hands are drawn to places at random beside the object."""
    thing = {"kind": "scene", "file": str(file), "axes": 3, "substeps": substeps}
    settings = resolve({"object": thing, "users": [{"side": ("left", "right")[seat % 2]} for seat in range(people)]})
    world = make_scene_world(settings, [seat_settings(settings, seat) for seat in range(people)])
    random = np.random.default_rng(1)
    goal = np.zeros((people, 3))
    times_us = []
    for user in range(people):
        world.join(user, np.zeros(3))
    for frame in range(frames):
        if frame % 60 == 0:
            goal = random.uniform(-0.12, 0.12, (people, 3))
        place = np.array([world.proxy(user) for user in range(people)])
        waves = np.clip(30.0 * (goal - place), -1.0, 1.0).tolist()
        start_ns = time.thread_time_ns()
        world.advance(waves)
        times_us.append((time.thread_time_ns() - start_ns) * 1e-3)
    return times_us
