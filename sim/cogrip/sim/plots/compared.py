"""Curves of several runs over each other: a row a person, in that person's colour.

The first run is the broad pale line, the last the fine dark one, those between are dashed.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from cogrip.sim.plots.curves import Line, Window, extent, object_lines, seat_columns
from cogrip.sim.plots.style import (
    ALARM,
    AXIS_NAMES,
    DASHED,
    INK,
    LINES,
    Array,
    Legend,
    NotDrawnError,
    Sheet,
    Style,
    colour,
    draw,
    label,
    shade,
    title,
)  # fmt: skip
from cogrip.sim.summary_values import dig, is_number
from cogrip.sim.traces import Run

MOST_ROWS = 6  # people that are drawn
_LONG_RUN_S = 30.0  # of a longer one a detail is drawn as well
_DETAIL_S = 5.0
_BROADEST, _FINEST = 3.0, 1.0  # line widths of the first run and of the last
_PALEST = 0.45  # share of the colour in the first run's line
_LEAST_MARGIN_J = 1e-5  # least height of the margins' axis: below it lies rounding
_LARGE_J = 5.0
_FORBIDDEN: Style = {"color": ALARM, "alpha": 0.13, "lw": 0}
_LONGEST_NAME = 40


class Plot(NamedTuple):
    """Heading, what to look for, and what draws it; NotDrawnError says why there is nothing."""

    heading: str
    caption: str
    draw: Callable[[], Figure]


class Side(NamedTuple):
    """One run, with what to call it and its lines' looks; `share` of a person's colour is in them."""

    run: Run
    label: str
    style: Style
    share: float = 1.0
    dashes: Any = "-"

    def tinted(self, tint: Any) -> Style:
        return {**self.style, "color": shade(tint, self.share), "ls": self.dashes}


def compared_plots(runs: Sequence[Run], labels: Sequence[str], names: Sequence[str]) -> Iterator[Plot]:
    """Positions, forces and energy of the people who are named, of whom the first few are drawn."""
    widths = np.linspace(_BROADEST, _FINEST, len(runs)).tolist()
    sides = [
        Side(run, name, {"color": tint, "lw": width}, share, LINES[max(0, number - 1) % len(LINES)])
        for number, (run, name, width, share, tint) in enumerate(
            zip(runs, labels, widths, shares(len(runs)), tints(len(runs)), strict=True)
        )
    ]
    names = names[:MOST_ROWS]
    window = _detail(sides)
    motions = {
        "Positions": (positions, "Each hand and the object"),
        "Forces": (forces, "The force on each hand"),
    }
    for heading, (of, what) in motions.items():
        caption = f"{what}, in every run: where only the last run's line is seen inside the first's, they are the same."
        yield Plot(heading, caption, partial(of, sides, names))
        if window:
            yield Plot(
                f"{heading}, in detail", f"{_DETAIL_S:g} s of the middle.", partial(of, sides, names, window=window)
            )
    yield Plot(
        "Energy",
        "Left, solid the work of each hand, dashed what of it went into the line; right, the least that any of the "
        "person's lines has had in hand so far: a curve that enters the red has given out energy that nobody put in.",
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
    """Hands, then the object, a row each, a column an axis [mm]."""
    rows = [(name, [_hand(side, name, "position_m", 1e3) for side in sides]) for name in names]
    rows.append(("object", [_object(side) for side in sides]))
    return _against_time(sides, rows, "position [mm]", window)


def forces(sides: Sequence[Side], names: Sequence[str], window: Window | None = None) -> Figure:
    """Force on each hand, a row a person, a column an axis [N]."""
    return _against_time(
        sides, [(name, [_hand(side, name, "force_n", 1.0) for side in sides]) for name in names], "force [N]", window
    )


def energies(sides: Sequence[Side], names: Sequence[str]) -> Figure:
    """A row a person: ledgers left, least margin of any line so far right [J or mJ]."""
    books = [(name, [_book(side.run, name) for side in sides]) for name in names]
    margins = [(name, [least_margin(side.run, name) for side in sides]) for name in names]
    if not any(lines for _, each in books for lines in each):
        raise NotDrawnError("no client's recording is here")
    tanks = [dig(side.run.settings, "playout", "tank_mj") for side in sides]
    least_j = -1e-3 * max((tank for tank in tanks if is_number(tank)), default=0.0)
    unit, scale = _unit(line.values for _, each in books for lines in each for line in lines)
    margin_unit, margin_scale = _unit(line.values for _, each in margins for line in each if line)
    sheet = Sheet(len(names), 2, row_in=1.9, widths=(1.7, 1.0))
    for (name, ledgers), (_, least), (left, right) in zip(books, margins, sheet.panels, strict=True):
        for side, lines in zip(sides, ledgers, strict=True):
            for line in lines:
                draw(left, line.time, line.values * scale, **side.style, **line.style)
        lowest = 1.25 * min(
            -_LEAST_MARGIN_J, least_j, *(float(np.fmin.reduce(line.values)) for line in least if line is not None)
        )
        for side, margin in zip(sides, least, strict=True):
            if margin is not None:
                draw(right, margin.time, margin.values * margin_scale, **side.style)
        right.axhspan(lowest * margin_scale, least_j * margin_scale, **_FORBIDDEN)
        right.set_ylim(lowest * margin_scale, -0.2 * lowest * margin_scale)
        right.locator_params(axis="y", nbins=4)
        title(left, label(name))
        title(right, f"least margin so far [{margin_unit}]")
    for panel in sheet.panels[0]:
        panel.set_xlim(*_extent(sides))
    return sheet.finish("time [s]", [f"energy [{unit}]"] * len(names), _legend(sides))


def _hand(side: Side, name: str, column: str, scale: float) -> list[tuple[int, Line]]:
    trace = side.run.clients.get(name)
    if trace is None:
        return []
    return [(axis, Line(trace.time_s, values * scale, {})) for axis, values in enumerate(trace.vector(column).T)]


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
    seats = {name: number for number, name in enumerate(sides[0].run.names)}
    for (name, each), panels in zip(rows, sheet.panels, strict=True):
        tint = colour(seats[name]) if name in seats else INK
        for side, lines in zip(sides, each, strict=True):
            for axis, line in lines:
                draw(panels[axis], line.time, line.values, window=window, **side.tinted(tint))
    for panel, name in zip(sheet.panels[0], AXIS_NAMES, strict=False):
        panel.set_xlim(*(window or _extent(sides)))
        title(panel, name if axes > 1 else "")
    legend = [(_escaped(side.label), {**side.tinted(INK), "lw": 1.0 + side.style["lw"]}) for side in sides]
    return sheet.finish("time [s]", [f"{label(name)}: {quantity}" for name, _ in rows], legend)


def _book(run: Run, name: str) -> list[Line]:
    """The hand's work, and what of it went into the line [J]."""
    trace = run.clients.get(name)
    if trace is None:
        return []
    return [
        Line(trace.time_s, trace.columns["work_j"], {}),
        Line(trace.time_s, trace.columns["port_j"], {"ls": DASHED}),
    ]


def least_margin(run: Run, name: str) -> Line | None:
    """The least of what the person's line up, line down and whole line have had in hand so far [J], as far as known."""
    waves = dig(run.settings, "coupling", "kind") != "coupling"
    trace, room = run.clients.get(name), run.room
    line: Line | None = None
    if trace is not None and waves:
        line = Line(trace.time_s, trace.columns["down_margin_j"], {})
    if room is None:
        return line
    for key in ("up_margin_j", "line_margin_j") if waves else ("line_margin_j",):
        seat = seat_columns(run, run.names.index(name), key)
        if seat is None:
            continue
        if line is None:
            line = Line(room.time_s, seat[:, 0], {})
        else:  # the room's newest step at each tick
            newest = np.searchsorted(room.time_s, line.time, side="right") - 1
            values = np.where(newest < 0, np.nan, seat[newest, 0])
            line = Line(line.time, np.fmin(line.values, values), {})
    return line


def _unit(curves: Iterator[Array]) -> tuple[str, float]:
    """The unit for a column of panels, and how many of it make a joule."""
    largest = max((float(np.fmax.reduce(np.abs(values), initial=0.0)) for values in curves), default=0.0)
    return ("J", 1.0) if largest >= _LARGE_J else ("mJ", 1e3)


def _extent(sides: Sequence[Side]) -> Window:
    """From when the first run begins until the last one ends."""
    spans = [extent(side.run) for side in sides if side.run.clients or side.run.room]
    if not spans:
        raise NotDrawnError("no recording is here")
    return min(start for start, _ in spans), max(end for _, end in spans)


def _detail(sides: Sequence[Side]) -> Window | None:
    """The middle of the time that all runs have in common, where that is long."""
    spans = [extent(side.run) for side in sides if side.run.clients or side.run.room]
    start = max((span[0] for span in spans), default=0.0)
    end = min((span[1] for span in spans), default=0.0)
    if end - start <= _LONG_RUN_S:
        return None
    middle = 0.5 * (start + end)
    return middle - 0.5 * _DETAIL_S, middle + 0.5 * _DETAIL_S


def _legend(sides: Sequence[Side]) -> Legend:
    return [(_escaped(side.label), {"color": side.style["color"], "lw": 2.5}) for side in sides]


def _escaped(text: str) -> str:
    """As `label`, but folder names are longer: the end of one tells it from others."""
    return text[-_LONGEST_NAME:].replace("$", r"\$").lstrip("_") or "nameless"
