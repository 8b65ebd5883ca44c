"""Energy over time: ledgers of the hands, and reserves of the lines, which below 0 would have created some."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from cogrip.results.plots.curves import FORBIDDEN, Line, Window, extent, forbid, reserve, shown
from cogrip.results.plots.style import (
    DASHED,
    DOTTED,
    FAINT,
    Legend,
    NotDrawnError,
    Sheet,
    Style,
    colour,
    draw,
    label,
    title,
)
from cogrip.results.reading.summary_values import lent_j
from cogrip.results.reading.traces import TracedRun

_LARGE_J = 5.0
_LEDGERS = (("work by the hand", "-"), ("energy into the line", DASHED), ("device leak", DOTTED))
_RESERVES = {
    "up_reserve_j": ("reserve, line up", "-"),
    "down_reserve_j": ("reserve, line down", DASHED),
    "line_reserve_j": ("reserve, whole line", DOTTED),
}


class EnergyRow(NamedTuple):
    """One person: title and its colour, ledgers for the left panel, reserves for the right one [J]."""

    heading: str
    tint: Any
    ledgers: list[Line]
    reserves: list[Line]


def energies(run: TracedRun) -> Figure:
    """Draw a row for each person: ledgers left; right the lines' energy reserves, where recorded [J or mJ]."""
    rows = []
    for number, name in shown(run):
        trace, tint = run.clients.get(name), colour(number)
        if trace is None and run.room is None:
            continue
        ledgers: list[Line] = []
        if trace is not None:
            work_j, port_j = trace.columns["work_j"], trace.columns["port_j"]
            ledgers = [
                Line(trace.time_s, values, {"color": tint, "lw": 1.6, "ls": dashes})
                for values, (_, dashes) in zip((work_j, port_j, work_j - port_j), _LEDGERS, strict=True)
            ]
        reserves = [
            line._replace(style={"color": tint, "lw": 1.6, "ls": dashes})
            for key, (_, dashes) in _RESERVES.items()
            if (line := reserve(run, name, key)) is not None
        ]
        rows.append(EnergyRow(label(name), tint, ledgers, reserves))
    if not rows:
        raise NotDrawnError("no trace is here")
    styles = [*_LEDGERS, *(_RESERVES.values() if any(row.reserves for row in rows) else ())]
    legend: list[tuple[str, Style]] = [(text, {"color": FAINT, "lw": 2, "ls": dashes}) for text, dashes in styles]
    return energy_sheet(rows, extent(run), lent_j(run.settings), "energy reserve", legend, 4)


def energy_sheet(
    rows: Sequence[EnergyRow], window: Window, lent_j: float | None, reserves: str, legend: Legend, columns: int = 0
) -> Figure:
    """Draw rows of ledgers and, where any is known, of reserves, which may go down to what lines may lend."""
    reported = any(row.reserves for row in rows)
    sheet = Sheet(len(rows), 1 + reported, row_in=1.9, widths=(1.7, 1.0) if reported else (1.0,))
    unit, scale = _unit(line for row in rows for line in row.ledgers)
    reserve_unit, reserve_scale = _unit(line for row in rows for line in row.reserves)
    for row, panels in zip(rows, sheet.panels, strict=True):
        for line in row.ledgers:
            draw(panels[0], line.time, line.values * scale, **line.style)
        title(panels[0], row.heading, row.tint)
        if reported:
            for line in row.reserves:
                draw(panels[1], line.time, line.values * reserve_scale, **line.style)
            forbid(panels[1], row.reserves, lent_j, reserve_scale)
            title(panels[1], f"{reserves} [{reserve_unit}]", row.tint)
    for panel in sheet.panels[0]:
        panel.set_xlim(*window)
    legend = [*legend, *([FORBIDDEN] if reported else [])]
    return sheet.finish("time [s]", [f"energy [{unit}]"] * len(rows), legend, columns)


def _unit(lines: Iterable[Line]) -> tuple[str, float]:
    """Return the unit for a column of panels, and how many of it make a joule."""
    largest = max((float(np.fmax.reduce(np.abs(line.values), initial=0.0)) for line in lines), default=0.0)
    return ("J", 1.0) if largest >= _LARGE_J else ("mJ", 1e3)
