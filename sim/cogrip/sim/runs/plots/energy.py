"""Energy over time: ledgers of the hands, and reserves of the lines, which below 0 would have created some."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.figure import Figure

from cogrip.sim.runs.plots.curves import FORBIDDEN, Line, extent, forbid, reserve, shown
from cogrip.sim.runs.plots.style import DASHED, DOTTED, FAINT, NotDrawnError, Sheet, Style, colour, draw, label, title
from cogrip.sim.runs.summary_values import lent_j
from cogrip.sim.runs.traces import Run

_LARGE_J = 5.0
_LEDGERS = {
    "work_j": ("work by the hand", "-"),
    "port_j": ("energy into the line", DASHED),
    "leak_j": ("device leak", DOTTED),
}
_RESERVES = {
    "up_reserve_j": ("reserve, line up", "-"),
    "down_reserve_j": ("reserve, line down", DASHED),
    "line_reserve_j": ("reserve, whole line", DOTTED),
}


def energies(run: Run) -> Figure:
    """Draw a row for each person: ledgers left; right the lines' energy reserves, where recorded [J or mJ]."""
    people = [(number, name) for number, name in shown(run) if name in run.clients or run.room]
    if not people:
        raise NotDrawnError("no trace is here")
    ledgers = {number: dict(_ledgers(run, name)) for number, name in people}
    reserves = {
        number: {key: line for key in _RESERVES if (line := reserve(run, name, key)) is not None}
        for number, name in people
    }
    told = any(reserves.values())
    sheet = Sheet(len(people), 1 + told, row_in=1.9, widths=(1.7, 1.0) if told else (1.0,))
    unit, scale = _unit(ledgers)
    for (number, name), panels in zip(people, sheet.panels, strict=True):
        tint = colour(number)
        for key, line in ledgers[number].items():
            draw(panels[0], line.time, line.values * scale, color=tint, lw=1.6, ls=_LEDGERS[key][1])
        title(panels[0], label(name), tint)
    reserve_unit, reserve_scale = _unit(reserves)
    for (number, _), panels in zip(people, sheet.panels, strict=True):
        if told:
            tint, right, lines = colour(number), panels[1], reserves[number]
            for key, line in lines.items():
                draw(right, line.time, line.values * reserve_scale, color=tint, lw=1.6, ls=_RESERVES[key][1])
            forbid(right, lines.values(), lent_j(run.settings), reserve_scale)
            title(right, f"energy reserve [{reserve_unit}]", tint)
    for panel in sheet.panels[0]:
        panel.set_xlim(*extent(run))
    styles = [*_LEDGERS.values(), *(_RESERVES.values() if told else ())]
    legend: list[tuple[str, Style]] = [(text, {"color": FAINT, "lw": 2, "ls": dashes}) for text, dashes in styles]
    if told:
        legend.append(FORBIDDEN)
    return sheet.finish("time [s]", [f"energy [{unit}]"] * len(people), legend, 4)


def _unit(lines: Mapping[int, Mapping[str, Line]]) -> tuple[str, float]:
    """The unit for a column of panels, and how many of it make a joule."""
    sizes = (np.fmax.reduce(np.abs(line.values), initial=0.0) for each in lines.values() for line in each.values())
    return ("J", 1.0) if max(sizes, default=0.0) >= _LARGE_J else ("mJ", 1e3)


def _ledgers(run: Run, name: str) -> Iterator[tuple[str, Line]]:
    """(name, curve [J]) of one person's books."""
    trace = run.clients.get(name)
    if trace is None:
        return
    work_j, port_j = trace.columns["work_j"], trace.columns["port_j"]
    for key, values in zip(_LEDGERS, (work_j, port_j, work_j - port_j), strict=True):
        yield key, Line(trace.time_s, values, {})
