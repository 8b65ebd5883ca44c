"""The picture of a sweep: a heat map over two varied settings, one panel for each value of a third; a line over one.

A map ends at the first and last value of each setting; a case without a number is hatched; a map of one number says so in
place of a colour bar.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os.path import commonprefix
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from cogrip.analysis.linear.state_space import Array
from cogrip.experiments.experiment import Result
from cogrip.experiments.sweep.grid import Axis, Grid
from cogrip.experiments.sweep.measures import PREFIX
from cogrip.machine.addition import add_integers
from cogrip.results.plots.style import FAINT, INK, Legend, NotDrawnError, Sheet, Style, label, title

MOST_PANELS = 9
MOST_TICKS = 8
_COLUMNS = 3
_SAME = 1e-9  # relative difference below which two values are one number
_EMPTY: Style = {"facecolor": "#e5e7eb", "hatch": "////", "edgecolor": FAINT, "lw": 0}
_FLAT = "#c6d4e1"
_BORDER: Style = {"color": INK, "lw": 1.4, "ls": "--"}  # style of the border of stability, where a spectral radius is 1
_UNITS = {
    "_s": "s", "_ms": "ms", "_us": "µs", "_hz": "Hz", "_m": "m", "_mm": "mm", "_mps": "m/s", "_n": "N", "_npm": "N/m",
    "_nspm": "N s/m", "_kg": "kg", "_j": "J", "_mj": "mJ", "_w": "W", "_kbps": "kbit/s", "_rad_s": "rad/s",
    "_frames": "frames",
}  # fmt: skip


def draw_measure(grid: Grid, results: Mapping[int, Result], measure: str) -> Figure:
    """Draw one measure over the grid. Raises NotDrawnError where it is no number, or too much is varied."""
    values = np.full(grid.cases, np.nan)
    truth = False
    for case, result in results.items():
        value = result.measures.get(measure)
        if isinstance(value, bool | int | float):
            values[case] = float(value)
            truth = isinstance(value, bool)
    if not np.isfinite(values).any():
        raise NotDrawnError(f"{measure} has no number in any cell")
    table = values.reshape([len(axis.values) for axis in grid.axes])
    axes = [axis for axis in grid.axes if len(axis.values) > 1]
    table = table.reshape([len(axis.values) for axis in axes])
    for number, axis in enumerate(axes):
        if axis.numeric:  # they may have been asked for in any order
            order = sorted(range(len(axis.values)), key=axis.values.__getitem__)
            table = table.take(order, axis=number)
            axes[number] = replace(axis, values=tuple(axis.values[index] for index in order))
    if not axes or len(axes) > 3 or (len(axes) == 3 and min(len(axis.values) for axis in axes) > MOST_PANELS):
        raise NotDrawnError(
            f"{len(axes)} settings vary: a picture takes one to three, the third of at most {MOST_PANELS} values"
        )
    legend = _legend(values, results, truth)
    name = "yes or no" if truth else None
    names = {key: labelled(grid, key, name if key == measure else None) for key in (*grid.keys, measure)}
    if len(axes) == 1:
        return _line(axes[0], table, names, measure, legend)
    panels = [""]
    if len(axes) == 3:  # the one with the fewest values gets the panels
        fewest = min(range(3), key=lambda number: len(axes[number].values))
        third = axes.pop(fewest)
        table = np.moveaxis(table, fewest, 0)
        panels = [f"{third.key} = {_text(value)}" for value in third.values]
    else:
        table = table[None]
    return _maps(axes[0], axes[1], table, panels, names, measure, legend, truth)


def labelled(grid: Grid, key: str, unit: str | None = None) -> str:
    """Return a setting's or measure's name as on an axis: `anna: stiffness [N/m]` of `users.0.stiffness_npm`."""
    if unit is None:
        unit = "1"
        for ending in sorted(_UNITS, key=len, reverse=True):
            if key.endswith(ending):
                key, unit = key.removesuffix(ending), _UNITS[ending]
                break
    parts = key.removeprefix(PREFIX).split(".")
    users = grid.base.get("users") or ()
    if parts[0] == "users" and len(parts) > 2 and parts[1].isdigit() and int(parts[1]) < len(users):
        parts = [f"{label(str(users[int(parts[1])]['name']))}:", *parts[2:]]
    return f"{' '.join(parts).replace('_', ' ').replace('structural', 'structural eigenvalues')} [{unit}]"


def _legend(values: Array, results: Mapping[int, Result], truth: bool) -> list[tuple[str, Style]]:
    """Return entries on cases without a number and why, and on the number where there is only one."""
    failed = add_integers(bool(result.error) for result in results.values())
    counts = {
        "not computed": len(values) - len(results),
        "failed": failed,
        "without a number": int(np.isnan(values).sum()) - failed - (len(values) - len(results)),
    }
    missing = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    legend: list[tuple[str, Style]] = [(f"of {len(values)} cells: {missing}", _EMPTY)] if missing else []
    if _flat(values):
        value = float(np.nanmean(values))
        text = ("no", "yes")[round(value)] if truth else f"{value:.6g}"
        words = f"constant: {text} in all {np.isfinite(values).sum()} cells computed"
        legend.insert(0, (words, {"facecolor": _FLAT, "lw": 0}))
    return legend


def _flat(values: Array) -> bool:
    low, high = np.nanmin(values), np.nanmax(values)
    return bool(high - low <= _SAME * max(abs(low), abs(high)))


def _line(axis: Axis, values: Array, names: Mapping[str, str], measure: str, legend: Legend) -> Figure:
    sheet = Sheet(1, 1, row_in=4.0)
    panel: Axes = sheet.panels[0, 0]
    places, _ = _places(axis)
    panel.plot(places, values, marker="o", ms=4, lw=1.2)
    empty: Style = {"color": FAINT, "lw": 1.0, "ls": ":"}
    for place in places[np.isnan(values)]:
        panel.axvline(place, **empty)
    _scale(panel, axis, "x")
    lines = [(text, empty if style is _EMPTY else {"lw": 0}) for text, style in legend]
    return sheet.finish(names[axis.key], [names[measure]], lines)


def _maps(
    up: Axis, across: Axis, table: Array, panels: Sequence[str], names: Mapping[str, str], measure: str, legend: Legend,
    truth: bool,
) -> Figure:  # fmt: skip
    columns = min(_COLUMNS, len(table))
    rows = -(-len(table) // columns)
    sheet = Sheet(rows, columns, row_in=4.4 if rows == 1 else 3.0)
    (x_places, x_edges), (y_places, y_edges) = _places(across), _places(up)
    border = measure.endswith(("_radius", "radius_without_structural"))
    border = border and across.numeric and up.numeric and bool(np.nanmin(table) < 1.0 < np.nanmax(table))
    flat = _flat(table)
    low, high = (0.0, 1.0) if truth else (float(np.nanmin(table)), float(np.nanmax(table)))
    mesh = None
    for panel, values, name in zip(sheet.panels.flat, table, panels, strict=False):
        panel.grid(visible=False)
        if np.isnan(values).any():
            panel.patch.set(facecolor=_EMPTY["facecolor"], hatch=_EMPTY["hatch"], edgecolor=_EMPTY["edgecolor"])
        shown = np.ma.masked_invalid(values)
        colours: Style = {"cmap": "viridis", "vmin": low, "vmax": high}
        if flat:
            colours = {"cmap": ListedColormap([_FLAT]), "vmin": low - 1.0, "vmax": low + 1.0}
        mesh = panel.pcolormesh(x_edges, y_edges, shown, rasterized=True, **colours)
        if border and min(shown.shape) > 1:
            panel.contour(
                x_places, y_places, shown, levels=[1.0], colors=[_BORDER["color"]], linewidths=_BORDER["lw"],
                linestyles=_BORDER["ls"],
            )  # fmt: skip
        _scale(panel, across, "x")
        _scale(panel, up, "y")
        panel.set_xlim(x_edges[0], x_edges[-1])
        panel.set_ylim(y_edges[0], y_edges[-1])
        title(panel, name)
    for panel in sheet.panels.flat[len(table) :]:
        panel.set_visible(False)
    if flat:
        legend = [(f"{names[measure]}, {legend[0][0]}", legend[0][1]), *legend[1:]]
    if border:
        legend = [*legend, ("limit of stability: radius 1", _BORDER)]
    figure = sheet.finish(names[across.key], [names[up.key]] * rows, legend)
    assert mesh is not None
    if flat:
        return figure
    area = sheet.panels[0, 0].get_position()
    foot = sheet.panels[-1, 0].get_position().y0
    figure.subplots_adjust(right=0.88)
    bar = figure.colorbar(mesh, cax=figure.add_axes((0.9, foot, 0.018, area.y1 - foot)))
    bar.set_label(names[measure], fontsize=10, color=INK)
    bar.ax.tick_params(labelsize=9, colors=INK)
    if truth:
        bar.set_ticks([0.0, 1.0], labels=["no", "yes"])
    return figure


def _places(axis: Axis) -> tuple[Array, Array]:
    """Return the places of an axis' values, and the edges between them; the outermost edges are the outermost values.

    Words stand at whole numbers, in the middle of a cell each.
    """
    if not axis.numeric:
        places = np.arange(float(len(axis.values)))
        return places, np.append(places - 0.5, places[-1] + 0.5)
    places = np.array(axis.values, dtype=float)
    between = np.log(places) if axis.log else places
    middle = 0.5 * (between[1:] + between[:-1])
    if axis.log:
        middle = np.exp(middle)
    return places, np.concatenate((places[:1], middle, places[-1:]))


def _scale(panel: Axes, axis: Axis, which: str) -> None:
    if axis.log:
        panel.set(**{f"{which}scale": "log"})
    places, _ = _places(axis)
    if not axis.numeric or len(places) <= MOST_TICKS:  # the values computed, and no others
        (panel.set_xticks if which == "x" else panel.set_yticks)(places, _tick_labels(axis))
        (panel.xaxis if which == "x" else panel.yaxis).minorticks_off()


def _tick_labels(axis: Axis) -> list[str]:
    """Return what tells the values apart: of the addresses sim:ideal?mass_kg=1 and sim:ideal?mass_kg=2 the numbers."""
    texts = [_text(value) for value in axis.values]
    same = commonprefix(texts).rfind("=") + 1  # noqa: RUF071 (of characters, not of folders)
    return [f"…{text[same:]}" if same else text for text in texts]


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
