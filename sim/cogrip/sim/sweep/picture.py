"""A sweep as a picture: a heat map over two varied settings, one panel for each value of a third; a line over one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cogrip.sim.analysis.state_space import Array
from cogrip.sim.plots.style import INK, NotDrawnError, Sheet, title
from cogrip.sim.sweep.cell import Result
from cogrip.sim.sweep.grid import Axis, Grid

MOST_PANELS = 9
_COLUMNS = 3


def draw_measure(grid: Grid, results: Mapping[int, Result], measure: str) -> Figure:
    """One measure over the grid. Raises NotDrawnError where it is no number, or too much is varied."""
    values = np.full(grid.cells, np.nan)
    for cell, result in results.items():
        value = result.measures.get(measure)
        if isinstance(value, bool | int | float):
            values[cell] = float(value)
    if not np.isfinite(values).any():
        raise NotDrawnError(f"{measure} has no number in any cell")
    table = values.reshape([len(axis.values) for axis in grid.axes])
    axes = [axis for axis in grid.axes if len(axis.values) > 1]
    table = table.reshape([len(axis.values) for axis in axes])
    if not axes or len(axes) > 3 or (len(axes) == 3 and min(len(axis.values) for axis in axes) > MOST_PANELS):
        raise NotDrawnError(
            f"{len(axes)} settings vary: a picture takes one to three, the third of at most {MOST_PANELS} values"
        )
    if len(axes) == 1:
        return _line(axes[0], table, measure)
    if len(axes) == 3:  # the one with the fewest values gets the panels
        fewest = min(range(3), key=lambda number: len(axes[number].values))
        panels = axes.pop(fewest)
        table = np.moveaxis(table, fewest, 0)
        names = [f"{panels.key} = {_text(value)}" for value in panels.values]
    else:
        table, names = table[None], [""]
    return _maps(axes[0], axes[1], table, names, measure)


def _line(axis: Axis, values: Array, measure: str) -> Figure:
    sheet = Sheet(1, 1, row_in=4.0)
    panel: Axes = sheet.panels[0, 0]
    places, _ = _places(axis)
    panel.plot(places, values, marker="o", ms=4, lw=1.2)
    _scale(panel, axis, "x")
    return sheet.finish(axis.key, [measure])


def _maps(up: Axis, across: Axis, table: Array, names: Sequence[str], measure: str) -> Figure:
    columns = min(_COLUMNS, len(table))
    rows = -(-len(table) // columns)
    sheet = Sheet(rows, columns, row_in=4.4 if rows == 1 else 3.0)
    (_, x_edges), (_, y_edges) = _places(across), _places(up)
    low, high = float(np.nanmin(table)), float(np.nanmax(table))
    mesh = None
    for panel, values, name in zip(sheet.panels.flat, table, names, strict=False):
        panel.grid(visible=False)
        mesh = panel.pcolormesh(x_edges, y_edges, values, cmap="viridis", vmin=low, vmax=high, rasterized=True)
        _scale(panel, across, "x")
        _scale(panel, up, "y")
        title(panel, name)
    for panel in sheet.panels.flat[len(table) :]:
        panel.set_visible(False)
    figure = sheet.finish(across.key, [up.key] * rows)
    assert mesh is not None
    area = sheet.panels[0, 0].get_position()
    foot = sheet.panels[-1, 0].get_position().y0
    figure.subplots_adjust(right=0.88)
    bar = figure.colorbar(mesh, cax=figure.add_axes((0.9, foot, 0.018, area.y1 - foot)))
    bar.set_label(measure, fontsize=10, color=INK)
    bar.ax.tick_params(labelsize=9, colors=INK)
    return figure


def _places(axis: Axis) -> tuple[Array, Array]:
    """Where the values of an axis stand, and the edges between them; words stand at whole numbers."""
    if not axis.numeric:
        places = np.arange(float(len(axis.values)))
        return places, np.append(places - 0.5, places[-1] + 0.5)
    places = np.array(axis.values, dtype=float)
    between = np.log(places) if axis.log else places
    middle = 0.5 * (between[1:] + between[:-1])
    edges = np.concatenate(([2.0 * between[0] - middle[0]], middle, [2.0 * between[-1] - middle[-1]]))
    return places, np.exp(edges) if axis.log else edges


def _scale(panel: Axes, axis: Axis, which: str) -> None:
    if axis.log:
        (panel.set_xscale if which == "x" else panel.set_yscale)("log")
    if not axis.numeric:
        places = list(range(len(axis.values)))
        names = [_text(value) for value in axis.values]
        (panel.set_xticks if which == "x" else panel.set_yticks)(places, names)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
