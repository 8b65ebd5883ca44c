"""Draw what delay does to each method: docs/pictures/delay.png, and the numbers beside it in delay.csv.

Felt stiffness: one hand presses on a wall of 1000 N/m with 1 N, at rest. Force error: two hands move one cube to and fro
(configs/compare.toml); root mean square difference to the cube directly in the hands. Links without jitter or loss.

usage: python docs/figures/delay.py [FOLDER]
"""

import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from cogrip.analysis.feel.felt_probe import measure_felt
from cogrip.analysis.figures.page import FigurePage, FigureTable, save_page
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.experiments.methods.case import run_session
from cogrip.experiments.methods.looks import style_of
from cogrip.experiments.methods.measures import read, state_of
from cogrip.experiments.methods.method import METHODS, ideal_settings, methods_of, session_settings
from cogrip.protocol.settings.room import resolve
from cogrip.results.plots.style import INK, LINES, Sheet, title

FOLDER = Path(__file__).parent.parent / "pictures"
SHOWN = ("wave", "tuned", "local", "tdpa", "coupling")
ROUND_TRIPS_MS = (0, 20, 50, 100, 200, 300, 400, 500, 600)
K, REST_S = 1000.0, 7.0
WALL = {
    "object": {"kind": "wall"},
    "coupling": {"stiffness_npm": K, "impedance_nspm": 20.0},
    "users": [{"name": "anna", "hand": "reach"}],
}
CUBE = tomllib.loads(shipped("compare").read_text())


class Point(NamedTuple):
    """One method at one delay; None where a session diverged, oscillated or never came to rest."""

    method: str
    round_trip_ms: float
    felt_npm: float | None
    error_n: float | None


def over(base: dict[str, Any], round_trip_ms: float) -> dict[str, Any]:
    """Return all settings, over a link of this round trip."""
    table: dict[str, Any] = msgspec.to_builtins(resolve(base))
    return {**table, "link": {"delay_ms": 0.5 * round_trip_ms}}


def measure(method: str, round_trip_ms: float) -> Point:
    """Run both sessions of a point."""
    pressed = session_settings(over(WALL, round_trip_ms), method, "own", 1)
    felt = measure_felt(pressed)
    error = None
    if method in methods_of(load(shipped("compare"))):
        moved = run_session(session_settings(over(CUBE, round_trip_ms), method, "own", 1), REST_S)
        ideal_n = run_session(ideal_settings(over(CUBE, 0.0), 1), REST_S).trace.force_n
        found = read(moved.trace, moved.summary, moved.diverged, ideal_n, ideal_n)
        error = None if state_of(found) in ("diverged", "oscillates") else found["error_ideal_n"]
    return Point(method, round_trip_ms, felt[0].felt_npm if felt else None, error)


def draw(points: list[Point]) -> FigurePage:
    """Draw felt stiffness and force error over the round trip."""
    sheet = Sheet(1, 2, row_in=3.4, widths=(1.0, 1.0))
    left, right = sheet.panels[0]
    legend = []
    for number, method in enumerate(SHOWN):
        style = {
            **style_of(method),
            "linestyle": LINES[number],
            "lw": 2.0 if method in ("tuned", "local") else 1.5,
            "ms": 4,
        }
        mine = [point for point in points if point.method == method]
        for panel, key in ((left, "felt_npm"), (right, "error_n")):
            values = [nan if (value := getattr(point, key)) is None else value for point in mine]
            delays = [point.round_trip_ms for point in mine]
            panel.plot(delays, values, **style)
            if not all(map(isnan, values)):
                failed = [each for each, value in zip(delays, values, strict=True) if isnan(value)]
                height = {"transform": panel.get_xaxis_transform(), "clip_on": False}
                panel.plot(
                    failed, [1.0 - 0.03 * number] * len(failed), "x", ms=8, mew=2, color=style["color"], **height
                )
        legend.append((METHODS[method].title, style))
    legend.append(("unstable, or never at rest", {"color": INK, "marker": "x", "lw": 0, "ms": 8, "mew": 2}))
    left.set_ylim(0.0, 1.3 * K)
    right.set_ylim(0.0, 1.3 * max(point.error_n or 0.0 for point in points))
    title(left, "felt stiffness of a wall of 1000 N/m [N/m]")
    title(right, "force error, two hands move a cube [N]")
    figure = sheet.finish("round trip of the link [ms]", ["", ""], legend)
    caption = "The stiffness felt at rest on a wall, and the error of the force on two hands that move one cube."
    return FigurePage("delay", "What delay does", caption, figure, FigureTable(Point._fields, points))


def main(folder: Path) -> None:
    """Measure and write all."""
    cases = [(method, float(each)) for method in SHOWN for each in ROUND_TRIPS_MS]
    with ProcessPoolExecutor() as pool:
        points = list(pool.map(measure, *zip(*cases, strict=True)))
    for point in points:
        print(*point)
    for path in save_page(folder, draw(points)):
        if path.suffix == ".svg":
            path.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else FOLDER)
