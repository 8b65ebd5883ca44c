"""Curves of a run against its time, from its traces, in the style of each person."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from cogrip.results.plots.style import ALARM, DASHED, Array, Legend, NotDrawnError, Style, label, person_style
from cogrip.results.reading.traces import MOST_PEOPLE, TracedRun

Window = tuple[float, float]
PROXY: Style = {"lw": 1.2, "ls": DASHED, "mfc": "white"}  # style of the proxy, the object's end
DETAIL_S = 5.0
_LONG_RUN_S = 30.0  # length above which a run shows its shape only, so that a detail stands beside it
_SHORTEST_S = 1e-3  # shortest time axis: an axis needs some length
_LEAST_SPAN_J = 1e-5  # least height of an energy axis: below it lies rounding


class Line(NamedTuple):
    """One curve against the run's time."""

    time: Array
    values: Array
    style: Style


def shown(run: TracedRun) -> list[tuple[int, str]]:
    """Return (seat number, name) of the people who are drawn."""
    return list(enumerate(run.names[:MOST_PEOPLE]))


def seat_columns(run: TracedRun, number: int, name: str) -> Array | None:
    """Return a seat's column or vector, shape (rows, n); nan while nobody has the seat."""
    if run.room is None or f"{number}.seated" not in run.room.columns:
        return None
    values = run.room.columns[f"{number}.{name}"].reshape(run.room.rows, -1)
    values[run.room.columns[f"{number}.seated"] == 0.0] = np.nan
    return values


RESERVES = ("up_reserve_j", "down_reserve_j", "line_reserve_j")


def reserve(run: TracedRun, name: str, key: str) -> Line | None:
    """Return one of RESERVES over time [J]; None where it is not recorded."""
    if key == "down_reserve_j":
        trace = run.clients.get(name)
        values = trace.columns["reserve_j"] if trace else None
    else:
        trace, seat = run.room, seat_columns(run, run.names.index(name), key)
        values = seat[:, 0] if seat is not None else None
    if trace is None or values is None or not np.isfinite(values).any():
        return None
    return Line(trace.time_s, values, {})


FORBIDDEN: tuple[str, Style] = ("energy out of nothing", {"color": ALARM, "alpha": 0.13, "lw": 9})


def forbid(panel: Any, lines: Iterable[Line], lent_j: float | None, scale: float) -> None:
    """Fit a panel to reserves, and shade it where none may be: below 0, or what both directions may lend, `lent_j` each."""
    border = -2.0 * (lent_j or 0.0)
    ends = [float(each(line.values)) for line in lines for each in (np.fmin.reduce, np.fmax.reduce)]
    low, high = min([border, *ends]), max([_LEAST_SPAN_J, *ends])
    foot, top = low - 0.12 * (high - low), high + 0.05 * (high - low)
    panel.axhspan(foot * scale, border * scale, **{**FORBIDDEN[1], "lw": 0})
    panel.set_ylim(foot * scale, top * scale)
    panel.locator_params(axis="y", nbins=4)


def extent(run: TracedRun) -> Window:
    """Return the time from the first tick of any client to the last one."""
    traces = list(run.clients.values()) or ([run.room] if run.room else [])
    if not traces:
        raise NotDrawnError("no trace is here")
    start, end = min(float(trace.time_s[0]) for trace in traces), max(float(trace.time_s[-1]) for trace in traces)
    return (0.0 if 0.0 <= start < 0.1 * end else start), max(end, start + _SHORTEST_S)


def detail(window: Window) -> Window | None:
    """Return the middle DETAIL_S of a long time, None of a shorter one."""
    start, end = window
    middle = 0.5 * (start + end)
    return (middle - 0.5 * DETAIL_S, middle + 0.5 * DETAIL_S) if end - start > _LONG_RUN_S else None


def hands(run: TracedRun, name: str, scale: float, **style: Any) -> Iterator[tuple[int, Line]]:
    """Yield (axis, curve) of a vector of everybody's client trace."""
    for number, person in shown(run):
        trace = run.clients.get(person)
        if trace is None:
            continue
        for axis, values in enumerate(trace.columns[name].T):
            yield axis, Line(trace.time_s, values * scale, {**person_style(number), "lw": 1.2, **style})


def seats(run: TracedRun, name: str, scale: float) -> Iterator[tuple[int, Line]]:
    """Yield (axis, curve) of a vector of every seat of the room."""
    for number, _ in shown(run):
        vectors = seat_columns(run, number, name)
        if vectors is None or run.room is None:
            continue
        for axis, values in enumerate(vectors.T):
            yield axis, Line(run.room.time_s, values * scale, {**person_style(number), **PROXY})


def object_lines(run: TracedRun, scale: float, style: Style) -> Iterator[tuple[int, Line]]:
    """Yield (axis, curve) of the object: the room's own, or else as the first client received it."""
    source = run.room or next(iter(run.clients.values()), None)
    if source is None:
        raise NotDrawnError("no trace is here")
    for axis, values in enumerate(source.columns["object_m"].T):
        yield axis, Line(source.time_s, values * scale, style)


def people_legend(run: TracedRun, *others: tuple[str, Style]) -> Legend:
    return [*((label(name), {**person_style(number), "lw": 2.0}) for number, name in shown(run)), *others]
