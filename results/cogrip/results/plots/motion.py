"""Positions, forces and waves against time, a row of panels for each axis."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cogrip.results.plots.curves import (
    DETAIL_S,
    Line,
    Window,
    detail,
    extent,
    hands,
    object_lines,
    people_legend,
    seats,
    shown,
)
from cogrip.results.plots.style import (
    DASHED,
    FAINT,
    INK,
    Legend,
    NotDrawnError,
    Sheet,
    Style,
    colour,
    draw,
    title,
)  # fmt: skip
from cogrip.results.reading.columns import axes_named
from cogrip.results.reading.summary_values import traits_of
from cogrip.results.reading.traces import EndTrace, TracedRun

_TURNING = {"mm": "mrad", "N": "N m"}
_GROUPS = 1500  # most groups of frames for the pale band behind the waves
_SOLID: Style = {"color": FAINT}
_DASHED: Style = {"color": FAINT, "ls": DASHED}
_OBJECT: Style = {"color": INK, "lw": 2.2, "alpha": 0.75}


def positions(run: TracedRun) -> Figure:
    """Draw hands, proxies and object, a row for each axis [mm]."""
    lines = [*object_lines(run, 1e3, _OBJECT), *hands(run, "position_m", 1e3), *seats(run, "proxy_m", 1e3)]
    legend = people_legend(run, ("hand", _SOLID), ("proxy", _DASHED), ("object", _OBJECT))
    return _against_time(run, lines, "position", "mm", legend)


def forces(run: TracedRun) -> Figure:
    """Draw the force on each hand and on each proxy, a row for each axis [N]."""
    lines = [*hands(run, "force_n", 1.0), *seats(run, "force_n", 1.0)]
    return _against_time(
        run, lines, "force", "N", people_legend(run, ("at the hand", _SOLID), ("at the object", _DASHED))
    )


def waves(run: TracedRun) -> Figure:
    """Draw the waves up and down at each client's port, a row for each axis [sqrt(W)]."""
    up, down = list(hands(run, "wave_up", 1.0, lw=1.1)), list(hands(run, "wave_down", 1.0, lw=1.1))
    if not up:
        raise NotDrawnError("no client's trace is here")
    if not any(np.any(line.values) for _, line in up + down):
        traits = traits_of(run.settings)
        waves = traits is None or traits.waves
        raise NotDrawnError("every wave was 0" if waves else "this coupling sends no waves")
    rows = 1 + max(axis for axis, _ in up)
    sheet = Sheet(rows, 2, row_in=2.7 if rows == 1 else 1.8)
    for column, lines in enumerate((up, down)):
        for axis, line in lines:
            draw(sheet.panels[axis, column], line.time, line.values, **line.style)
    for panel, heading in zip(sheet.panels[0], ("up, as sent", "down, as played"), strict=True):
        title(panel, heading)
        panel.set_xlim(*extent(run))
    return sheet.finish("time [s]", _labels(rows, "wave", "√W"), people_legend(run))


def _against_time(run: TracedRun, lines: list[tuple[int, Line]], quantity: str, unit: str, legend: Legend) -> Figure:
    """Draw a row of panels for each axis; a long run has its middle seconds beside it."""
    if not lines:
        raise NotDrawnError("no trace is here")
    whole = extent(run)
    windows: dict[str, Window] = {"": whole}
    if middle := detail(whole):
        windows = {"the whole run": whole, f"{DETAIL_S:g} s in its middle": middle}
    rows = 1 + max(axis for axis, _ in lines)
    sheet = Sheet(rows, len(windows), row_in=3.0 if rows == 1 else 1.9)
    for axis, line in lines:
        for panel, window in zip(sheet.panels[axis], windows.values(), strict=True):
            draw(panel, line.time, line.values, window=window, **line.style)
    barred = [_bar_not_live(run, panel) for panel in sheet.panels[:, 0]]
    if any(barred):
        legend = [*legend, ("bar at the foot: force held back", {"facecolor": FAINT, "lw": 0})]
    pressed = [_bar_buttons(run, panel) for panel in sheet.panels.flat]
    if any(pressed):
        legend = [*legend, ("bar at the head: a button is down", {"facecolor": FAINT, "lw": 0})]
    for panel, (heading, window) in zip(sheet.panels[0], windows.items(), strict=True):
        panel.set_xlim(*window)
        title(panel, heading)
    return sheet.finish("time [s]", _labels(rows, quantity, unit), legend)


def _labels(rows: int, quantity: str, unit: str) -> list[str]:
    named = [f"{quantity} {name} [{unit}]" for name, unit in zip(*axes_named(rows, unit, _TURNING), strict=False)]
    return named if rows > 1 else [f"{quantity} [{unit}]"]


def _bar_not_live(run: TracedRun, panel: Axes) -> bool:
    """Draw at the foot, in the person's colour, while their force was not let through. Return whether there is any."""
    found = False
    for number, name in shown(run):
        trace = run.clients.get(name)
        if trace is None:
            continue
        found |= _bar(panel, number, trace, trace.columns["live"] == 0.0, 0.03 * number)
    return found


def _bar_buttons(run: TracedRun, panel: Axes) -> bool:
    """Draw at the head, in the person's colour, while a button of theirs was down. Return whether there is any."""
    found = False
    for number, name in shown(run):
        trace, field = run.clients.get(name), "buttons"
        if trace is None:
            trace, field = run.room, f"{number}.buttons"
        if trace is not None and field in trace.columns:
            found |= _bar(panel, number, trace, trace.columns[field] > 0.0, 0.976 - 0.03 * number)
    return found


def _bar(panel: Axes, number: int, trace: EndTrace, on: NDArray[np.bool_], foot: float) -> bool:
    """Draw a bar while something is so; foot: of the panel's height. Return whether it ever is."""
    borders = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0, append=0)).clip(max=trace.rows - 1)
    spans = [(trace.time_s[first], trace.time_s[last] - trace.time_s[first]) for first, last in borders.reshape(-1, 2)]
    if spans:
        panel.broken_barh(
            spans, (foot, 0.024), transform=panel.get_xaxis_transform(), facecolor=colour(number), edgecolor="none"
        )
    return bool(spans)
