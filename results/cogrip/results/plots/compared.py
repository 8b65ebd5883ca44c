"""Curves of several runs over each other: a row a person, in that person's colour.

The first run is the broad pale line, the last the fine dark one, those between are dashed.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from cogrip.results.plots.curves import DETAIL_S, Line, Window, detail, extent, object_lines, reserve
from cogrip.results.plots.energy import EnergyRow, energy_sheet
from cogrip.results.plots.style import (
    AXIS_NAMES,
    DASHED,
    INK,
    LINES,
    NotDrawnError,
    Sheet,
    Style,
    colour,
    draw,
    label,
    shade,
    title,
)  # fmt: skip
from cogrip.results.reading.summary_values import lent_j
from cogrip.results.reading.traces import TracedRun

MOST_ROWS = 6  # most people that are drawn
_BROADEST, _FINEST = 3.0, 1.0  # line widths of the first run and of the last
_PALEST = 0.45  # share of the colour in the first run's line
_LONGEST_NAME = 40


class ComparedPlot(NamedTuple):
    """Heading, what to look for, and what draws it; NotDrawnError says why there is nothing."""

    heading: str
    caption: str
    draw: Callable[[], Figure]


class Side(NamedTuple):
    """One run, with what to call it and its lines' looks; `share` of a person's colour is in them."""

    run: TracedRun
    label: str
    style: Style
    share: float = 1.0
    dashes: Any = "-"

    def tinted(self, tint: Any) -> Style:
        return {**self.style, "color": shade(tint, self.share), "ls": self.dashes}


def compared_plots(runs: Sequence[TracedRun], labels: Sequence[str], names: Sequence[str]) -> Iterator[ComparedPlot]:
    """Yield positions, forces and energy of the people who are named, of whom the first few are drawn."""
    widths = np.linspace(_BROADEST, _FINEST, len(runs)).tolist()
    sides = [
        Side(run, name, {"color": tint, "lw": width}, share, LINES[max(0, number - 1) % len(LINES)])
        for number, (run, name, width, share, tint) in enumerate(
            zip(runs, labels, widths, shares(len(runs)), tints(len(runs)), strict=True)
        )
    ]
    names = names[:MOST_ROWS]
    window = _detail(sides)
    motions = {"Positions": (positions, "Each hand and the object"), "Forces": (forces, "The force on each hand")}
    for heading, (of, what) in motions.items():
        caption = f"{what}, in every run: where only the last run's line is seen inside the first's, they are the same."
        yield ComparedPlot(heading, caption, partial(of, sides, names))
        if window:
            yield ComparedPlot(
                f"{heading}, in detail", f"{DETAIL_S:g} s of the middle.", partial(of, sides, names, window=window)
            )
    yield ComparedPlot(
        "Energy",
        "Left, solid the work of each hand, dashed what of it went into the line; right, the energy "
        "that the person's line holds, put in less taken out: a curve that enters the red has given out what nobody put in.",
        partial(energies, sides, names),
    )


def shares(runs: int) -> list[float]:
    """Return how much of a person's colour the lines of each run have."""
    found: list[float] = np.linspace(_PALEST, 1.0, runs).tolist()
    return found


def tints(runs: int) -> list[tuple[float, float, float]]:
    """Return what stands for each run in legends: a grey, as colours are of people."""
    return [shade(INK, share) for share in shares(runs)]


def positions(sides: Sequence[Side], names: Sequence[str], window: Window | None = None) -> Figure:
    """Draw hands, then the object, a row each, a column for each axis [mm]."""
    rows = [(name, [_hand(side, name, "position_m", 1e3) for side in sides]) for name in names]
    rows.append(("object", [_object(side) for side in sides]))
    return _against_time(sides, rows, "position [mm]", window)


def forces(sides: Sequence[Side], names: Sequence[str], window: Window | None = None) -> Figure:
    """Draw the force on each hand, a row for each person, a column for each axis [N]."""
    return _against_time(
        sides, [(name, [_hand(side, name, "force_n", 1.0) for side in sides]) for name in names], "force [N]", window
    )


def energies(sides: Sequence[Side], names: Sequence[str]) -> Figure:
    """Draw a row for each person: ledgers left; right the whole line's energy reserve, where recorded [J or mJ]."""
    rows = []
    for name in names:
        tint = _tint(sides, name)
        reserves = [
            line._replace(style=side.tinted(tint)) for side in sides if (line := whole_line(side.run, name)) is not None
        ]
        rows.append(
            EnergyRow(label(name), INK, [line for side in sides for line in _ledgers(side, name, tint)], reserves)
        )
    if not any(row.ledgers for row in rows):
        raise NotDrawnError("no client's recording is here")
    lent = max((lent_j(side.run.settings) or 0.0 for side in sides), default=0.0)
    legend = [(_escaped(side.label), {"color": side.style["color"], "lw": 2.5}) for side in sides]
    return energy_sheet(rows, _extent(sides), lent, "reserve of the whole line", legend)


def whole_line(run: TracedRun, name: str) -> Line | None:
    """Return the energy that a person's line holds: put in at the client, not taken out at the object [J]."""
    return reserve(run, name, "line_reserve_j") if name in run.names else None


def _hand(side: Side, name: str, column: str, scale: float) -> list[tuple[int, Line]]:
    trace = side.run.clients.get(name)
    if trace is None:
        return []
    return [(axis, Line(trace.time_s, values * scale, {})) for axis, values in enumerate(trace.columns[column].T)]


def _object(side: Side) -> list[tuple[int, Line]]:
    run = side.run
    return list(object_lines(run, 1e3, {})) if run.room or run.clients else []


def _against_time(
    sides: Sequence[Side],
    rows: Sequence[tuple[str, list[list[tuple[int, Line]]]]],
    quantity: str,
    window: Window | None,
) -> Figure:
    axes = 1 + max((axis for _, each in rows for lines in each for axis, _ in lines), default=-1)
    if not axes:
        raise NotDrawnError("no recording is here")
    sheet = Sheet(len(rows), axes, row_in=3.0 if len(rows) == 1 else 1.9)
    for (name, each), panels in zip(rows, sheet.panels, strict=True):
        tint = _tint(sides, name)
        for side, lines in zip(sides, each, strict=True):
            for axis, line in lines:
                draw(panels[axis], line.time, line.values, window=window, **side.tinted(tint))
    for panel, name in zip(sheet.panels[0], AXIS_NAMES, strict=False):
        panel.set_xlim(*(window or _extent(sides)))
        title(panel, name if axes > 1 else "")
    legend = [(_escaped(side.label), {**side.tinted(INK), "lw": 1.0 + side.style["lw"]}) for side in sides]
    return sheet.finish("time [s]", [f"{label(name)}: {quantity}" for name, _ in rows], legend)


def _tint(sides: Sequence[Side], name: str) -> Any:
    """Return the colour of a person's seat in the first run; the object's where it has none of that name."""
    names = sides[0].run.names
    return colour(names.index(name)) if name in names else INK


def _ledgers(side: Side, name: str, tint: Any) -> list[Line]:
    """Return the hand's work, and what of it went into the line [J]; dashes tell the two apart, widths and paleness runs."""
    trace = side.run.clients.get(name)
    if trace is None:
        return []
    style = {**side.style, "color": shade(tint, side.share)}
    return [
        Line(trace.time_s, trace.columns["work_j"], style),
        Line(trace.time_s, trace.columns["port_j"], {**style, "ls": DASHED}),
    ]


def _extent(sides: Sequence[Side]) -> Window:
    """Return the time from the start of the first run to the end of the last one."""
    spans = [extent(side.run) for side in sides if side.run.clients or side.run.room]
    if not spans:
        raise NotDrawnError("no recording is here")
    return min(start for start, _ in spans), max(end for _, end in spans)


def _detail(sides: Sequence[Side]) -> Window | None:
    """Return the middle of the time that all runs have in common, where that is long."""
    spans = [extent(side.run) for side in sides if side.run.clients or side.run.room]
    return detail((max((start for start, _ in spans), default=0.0), min((end for _, end in spans), default=0.0)))


def _escaped(text: str) -> str:
    """Return `label` of a folder's name, which is longer: the end of one tells it from others."""
    return text[-_LONGEST_NAME:].replace("$", r"\$").lstrip("_") or "nameless"
