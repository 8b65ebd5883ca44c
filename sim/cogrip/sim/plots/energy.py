"""Where the energy goes, and how far the lines were from creating any."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.figure import Figure

from cogrip.sim.plots.curves import Line, extent, seat_columns, shown
from cogrip.sim.plots.style import ALARM, DASHED, DOTTED, FAINT, NotDrawnError, Sheet, Style, colour, draw, label, title
from cogrip.sim.summary_values import dig, is_number
from cogrip.sim.traces import Run

_LEAST_MARGIN_J = 1e-5  # least height of the margins' axis: below it lies rounding
_LARGE_J = 5.0
_LEDGERS = {
    "work_j": ("work by the hand", "-"),
    "port_j": ("energy into the line", DASHED),
    "leak_j": ("device leak", DOTTED),
}
_MARGINS = {
    "up_margin_j": ("up margin", "-"),
    "down_margin_j": ("down margin", DASHED),
    "line_margin_j": ("line margin", DOTTED),
}
_FORBIDDEN: Style = {"color": ALARM, "alpha": 0.13, "lw": 0}


def energies(run: Run) -> Figure:
    """A row a person: ledgers left, least margins so far right [J or mJ]."""
    people = [(number, name) for number, name in shown(run) if name in run.clients or run.room]
    if not people:
        raise NotDrawnError("no trace is here")
    tank_mj = dig(run.settings, "playout", "tank_mj")
    least_j = -1e-3 * tank_mj if is_number(tank_mj) else 0.0
    sheet = Sheet(len(people), 2, row_in=1.9, widths=(1.7, 1.0))
    ledgers = {number: dict(_ledgers(run, name)) for number, name in people}
    margins = {number: dict(_margins(run, number, name)) for number, name in people}
    unit, scale = _unit(ledgers)
    margin_unit, margin_scale = _unit(margins)
    for (number, name), (left, right) in zip(people, sheet.panels, strict=True):
        tint = colour(number)
        for key, line in ledgers[number].items():
            draw(left, line.time, line.values * scale, color=tint, lw=1.6, ls=_LEDGERS[key][1])
        lowest = min(-_LEAST_MARGIN_J, least_j, *(np.fmin.reduce(line.values) for line in margins[number].values()))
        for key, line in margins[number].items():
            draw(right, line.time, line.values * margin_scale, color=tint, lw=2.0, ls=_MARGINS[key][1])
        right.axhspan(1.25 * lowest * margin_scale, least_j * margin_scale, **_FORBIDDEN)
        right.set_ylim(1.25 * lowest * margin_scale, -0.25 * lowest * margin_scale)
        right.locator_params(axis="y", nbins=4)
        title(left, label(name), tint)
        title(right, f"least so far [{margin_unit}]", tint)
    for panel in sheet.panels[0]:
        panel.set_xlim(*extent(run))
    legend: list[tuple[str, Style]] = [
        (text, {"color": FAINT, "lw": 2, "ls": dashes})
        for pair in zip(_LEDGERS.values(), _MARGINS.values(), strict=True)
        for text, dashes in pair
    ]
    legend.append(("energy out of nothing", {**_FORBIDDEN, "lw": 9}))
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
    for key in _LEDGERS:
        yield key, Line(trace.time_s, trace.columns[key], {})


def _margins(run: Run, number: int, name: str) -> Iterator[tuple[str, Line]]:
    """(name, curve [J]) of the margins that some trace tells; without waves there is only the whole line's."""
    waves = dig(run.settings, "coupling", "kind") != "coupling"
    trace = run.clients.get(name)
    if trace is not None and waves:
        yield "down_margin_j", Line(trace.time_s, trace.columns["down_margin_j"], {})
    for key in ("up_margin_j", "line_margin_j") if waves else ("line_margin_j",):
        seat = seat_columns(run, number, key)
        if seat is not None and run.room is not None:
            yield key, Line(run.room.time_s, seat[:, 0], {})
