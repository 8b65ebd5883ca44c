"""Bodies of a scene, and contact forces and slip of its tools, against time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cogrip.results.plots.curves import extent, people_legend, seat_columns, shown
from cogrip.results.plots.style import (
    INK,
    LINES,
    Array,
    NotDrawnError,
    Sheet,
    Style,
    colour,
    draw,
    person_style,
)  # fmt: skip
from cogrip.results.reading.traces import TracedRun

MOST_BODIES = 8  # most bodies that are drawn: more are not told apart
_LEAST_MM, _LEAST_DEG, _LEAST_N, _LEAST_SLIP_MM = 1.0, 1.0, 0.1, 0.001  # least heights of panels: below lies rounding
_AXES = 3
_POSE = 7


def bodies(run: TracedRun) -> Figure:
    """Draw place [mm], a row for each axis, and turn [degrees] of each body that is no tool, from where it began."""
    if run.bodies is None:
        raise NotDrawnError("the recording holds no poses of bodies")
    time, poses = run.bodies.time_s, run.bodies.columns["poses"].reshape(run.bodies.rows, -1, _POSE)
    tools = {shape.body for shape in run.shapes if shape.seat is not None}
    objects = {shape.body for shape in run.shapes if shape.object}
    moving = [body for body in range(poses.shape[1]) if body not in tools]
    moving.sort(key=lambda body: body not in objects)
    if not moving:
        raise NotDrawnError("no body but the tools moves in this scene")
    sheet = Sheet(_AXES + 1, 1, row_in=1.7)
    legend: list[tuple[str, Style]] = []
    others = 0
    for body in moving[:MOST_BODIES]:
        style: Style = {"color": INK, "lw": 2.0}
        if body not in objects:
            style = {"color": colour(others), "lw": 1.2, "ls": LINES[1 + others % (len(LINES) - 1)]}
            others += 1
        for axis in range(_AXES):
            draw(sheet.panels[axis, 0], time, 1e3 * (poses[:, body, axis] - poses[0, body, axis]), **style)
        draw(sheet.panels[_AXES, 0], time, turned_deg(poses[:, body, _AXES:]), **style)
        legend.append(("object" if body in objects else f"body {body}", style))
    if len(moving) > MOST_BODIES:
        legend.append((f"{len(moving) - MOST_BODIES} more bodies are not drawn", {"lw": 0}))
    for panel in sheet.panels[:, 0]:
        _widen(panel, _LEAST_DEG if panel is sheet.panels[_AXES, 0] else _LEAST_MM)
    sheet.panels[0, 0].set_xlim(*extent(run))
    return sheet.finish("time [s]", [*(f"place {axis} [mm]" for axis in "xyz"), "turned by [°]"], legend)


def turned_deg(quaternions: Array) -> Array:
    """Return the angle from the first rotation to each [degrees]; shape (rows, 4)."""
    cosines = np.abs(quaternions @ quaternions[0])
    angles: Array = np.degrees(2.0 * np.arccos(np.minimum(1.0, cosines)))
    return angles


def contacts(run: TracedRun) -> Figure:
    """Draw normal force and friction [N] and slip [mm] of each tool."""
    rows = ("normal_n", 1.0, "normal force [N]"), ("friction_n", 1.0, "friction [N]"), ("slip_m", 1e3, "slip [mm]")
    if run.room is None or "0.normal_n" not in run.room.columns:
        raise NotDrawnError("the recording holds no contact forces")
    sheet = Sheet(len(rows), 1, row_in=1.9)
    drawn = False
    for number, _ in shown(run):
        for (name, scale, _), panel in zip(rows, sheet.panels[:, 0], strict=True):
            values = seat_columns(run, number, name)
            if values is not None and np.isfinite(values).any():
                drawn = True
                draw(panel, run.room.time_s, values[:, 0] * scale, **{**person_style(number), "lw": 1.2})
    if not drawn:
        raise NotDrawnError("nobody held a tool, or the recording holds no contact forces")
    for panel, least in zip(sheet.panels[:, 0], (_LEAST_N, _LEAST_N, _LEAST_SLIP_MM), strict=True):
        _widen(panel, least)
    sheet.panels[0, 0].set_xlim(*extent(run))
    return sheet.finish("time [s]", [text for *_, text in rows], people_legend(run))


def _widen(panel: Axes, least: float) -> None:
    low, high = panel.get_ylim()
    if high - low < least:
        panel.set_ylim(0.5 * (low + high - least), 0.5 * (low + high + least))
