"""Draw how far two hands are from feeling each other without a network: docs/pictures/partner.png, the numbers in partner.csv.

Root mean square difference of the force on both hands to the cube directly in the hands, as a share of the force itself: 1 is
what a hand has that feels nothing. Tasks of `cogrip compare --task`, links without jitter or loss.

usage: python docs/figures/partner.py [FOLDER]
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cogrip.analysis.feel.trace import Array
from cogrip.analysis.figures.page import FigurePage, FigureTable, save_page
from cogrip.experiments.methods.case import run_session
from cogrip.experiments.methods.looks import style_of
from cogrip.experiments.methods.method import METHODS, ideal_settings, session_settings
from cogrip.experiments.methods.tasks import TASKS
from cogrip.results.plots.style import INK, LINES, Sheet, title

FOLDER = Path(__file__).parent.parent / "pictures"
SHOWN = ("wave", "tuned", "partner")
DRAWN = ("pull", "rest", "opposed", "together")
DEVICE = "sim:ideal?mass_kg=0.1&damping_nspm=0.5"
DELAYS_MS = (0.0, 25.0, 50.0, 100.0, 150.0, 200.0)  # each way
FIRST_S, SECONDS = 1.25, 5.0  # of the task the first quarter of a second is left out: it begins at rest


class Point(NamedTuple):
    """One method at one task and delay. error_n: nan where the session diverged; felt_n: of the force without a network."""

    task: str
    method: str
    delay_ms: float
    error_n: float
    felt_n: float


def settings_of(task: str, delay_ms: float) -> dict[str, Any]:
    """Return two hands of a task at a cube of 0.2 kg, by springs of 1000 N/m."""
    return {
        "seconds": SECONDS, "coupling": {"stiffness_npm": 1000.0, "damping_nspm": 10.0, "impedance_nspm": 20.0},
        "object": {"axes": 1, "mass_kg": 0.2}, "link": {"delay_ms": delay_ms},
        "users": [
            {"name": name, "device": DEVICE, "hand": hand, "side": side}
            for name, hand, side in zip(("anna", "ben"), TASKS[task].hands, ("left", "right"), strict=True)
        ],
    }  # fmt: skip


def size_n(force_n: Array) -> float:
    """Return the root mean square of forces, shape (ticks, people, axes), of the task."""
    return float(np.sqrt((force_n[round(FIRST_S * 1024) :] ** 2).mean()))


@lru_cache
def ideal_n(task: str) -> Array:
    """Return the forces of the cube directly in the hands."""
    return run_session(ideal_settings(settings_of(task, 0.0), 1), SECONDS).trace.force_n


def measure(task: str, method: str, delay_ms: float) -> Point:
    """Run a session."""
    wanted_n = ideal_n(task)
    found = run_session(session_settings(settings_of(task, delay_ms), method, "own", 1), SECONDS)
    force_n = found.trace.force_n
    error_n = nan if found.diverged else size_n(force_n - wanted_n[: len(force_n)])
    return Point(task, method, delay_ms, error_n, size_n(wanted_n))


def draw(points: list[Point]) -> FigurePage:
    """Draw the error as a share of the force, a panel a task."""
    sheet = Sheet(1, len(DRAWN), row_in=2.8, widths=(1.0,) * len(DRAWN))
    legend = [(METHODS[method].title, look(method)) for method in SHOWN]
    nothing = {"color": INK, "lw": 1.0, "linestyle": (0, (1, 2))}
    legend.append(("no force felt", nothing))
    for panel, task in zip(sheet.panels[0], DRAWN, strict=True):
        panel.plot([DELAYS_MS[0], DELAYS_MS[-1]], [1.0, 1.0], **nothing)
        for method in SHOWN:
            mine = [point for point in points if (point.task, point.method) == (task, method)]
            panel.plot([each.delay_ms for each in mine], [each.error_n / each.felt_n for each in mine], **look(method))
        felt_n = next(point.felt_n for point in points if point.task == task)
        title(panel, f"{task} ({felt_n:.1f} N)")
        shares = [point.error_n / point.felt_n for point in points if point.task == task and not isnan(point.error_n)]
        panel.set_ylim(0.0, max(1.2, 1.05 * max(shares)))
    figure = sheet.finish("delay each way [ms]", [""] * len(DRAWN), legend)
    caption = "Error of the force on two hands that hold one cube, as a share of the force without a network."
    return FigurePage("partner", "What delay leaves of a partner", caption, figure, FigureTable(Point._fields, points))


def look(method: str) -> dict[str, Any]:
    """Return how a method is drawn."""
    heavy = 2.2 if method == "partner" else 1.5
    return {**style_of(method), "linestyle": LINES[SHOWN.index(method)], "lw": heavy, "ms": 4}


def main(folder: Path) -> None:
    """Measure and write all."""
    cases = [(task, method, delay) for task in TASKS for method in SHOWN for delay in DELAYS_MS]
    with ProcessPoolExecutor() as pool:
        points = list(pool.map(measure, *zip(*cases, strict=True)))
    for point in points:
        print(*point, flush=True)
    for path in save_page(folder, draw(points)):
        if path.suffix == ".svg":
            path.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else FOLDER)
