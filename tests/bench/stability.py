"""`dev.py bench stability`: boundaries traced, against numpy's eigenvalues on a dense grid, at the same delays."""

import time
from typing import Literal

import numpy as np

from cogrip.analysis.linear.boundary import trace
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import form_overrides, linear_session
from cogrip.analysis.linear.region import grid_axes, regions, stiffnesses
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.settings.room import resolve

from tests.bench import machine
from tests.bench.targets import judge

DELAYS_FRAMES = (0.0, 1.0, 2.0, 4.0)
_TOLD = 10.0  # the ratio that is asked for


def bench_stability(*, rounds: int = 5, cells: int = 50) -> int:
    """Two users, 0, 1, 2 and 4 frames each way, the paper's scheme and virtual coupling; medians over rounds, taken in turn.

    Against it stand eigenvalues alone (numpy.linalg.eigvals of all matrices at once), and with making the matrices.

    Parameters
    ----------
    rounds
        How often each is timed.
    cells
        Cells a side of the dense grid.
    """
    console = make_console()
    rows = []
    worst = np.inf
    schemes: tuple[Literal["paper", "coupling"], ...] = ("paper", "coupling")
    for scheme in schemes:
        settings = resolve({"users": [{"name": "a"}, {"name": "b"}]}, form_overrides(scheme))
        found, box = regions(settings, DELAYS_FRAMES)
        models = [LiftedModel(linear_session(settings, delay_frames=frames)) for frames in DELAYS_FRAMES]
        pairs = np.stack(np.meshgrid(*grid_axes(box, cells)), axis=-1).reshape(-1, 2)
        times = np.array([_round(models, box, pairs) for _ in range(rounds)])
        traced, made, solved = np.median(times, axis=0)
        ratio = solved / traced
        worst = min(worst, ratio)
        points = sum(len(region.boundary.points_npm) for region in found)
        rows.append([
            scheme, f"{1e3 * traced:.0f} ms", str(points), f"{1e3 * solved:.0f} ms", f"{1e3 * (made + solved):.0f} ms",
            f"{ratio:.1f}", f"{(made + solved) / traced:.1f}",
        ])  # fmt: skip
    headings = ("scheme", "boundaries", "points", "eigvals\nof the grid", "with\nmatrices", "ratio", "with\nmatrices")
    title = f"boundary against a {cells} x {cells} grid, two users, {len(DELAYS_FRAMES)} delays"
    console.print(plain_table(headings, rows, gap=2, title=title))
    peak_mb = machine.peak_memory_kb() / 1024
    console.print(f"largest memory of this process: {peak_mb:.0f} MB; every boundary point verified on both sides")
    return 0 if judge(console, "the least ratio", worst, _TOLD, form=".1f") else 1


def _round(models: list[LiftedModel], box: tuple[float, float], pairs: np.ndarray) -> tuple[float, float, float]:
    """Seconds for tracing all boundaries, and for making and solving all matrices of the grid."""
    start = time.perf_counter()
    for model in models:
        trace(model, box, lambda K: K)
    traced = time.perf_counter() - start
    made = solved = 0.0
    for model in models:
        K = stiffnesses(model.session, pairs)
        start = time.perf_counter()
        matrices = model.matrix(K)
        middle = time.perf_counter()
        np.linalg.eigvals(matrices)
        made += middle - start
        solved += time.perf_counter() - middle
    return traced, made, solved
