"""Curves of a run against its time: who is drawn, from which trace, in what style."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from cogrip.sim.plots.style import DASHED, Array, Legend, NotDrawnError, Style, label, person_style
from cogrip.sim.traces import MOST_PEOPLE, Run

Window = tuple[float, float]
PROXY: Style = {"lw": 1.2, "ls": DASHED, "mfc": "white"}  # the object's end
_SHORTEST_S = 1e-3  # an axis needs some length


class Line(NamedTuple):
    """One curve against the run's time."""

    time: Array
    values: Array
    style: Style


def shown(run: Run) -> list[tuple[int, str]]:
    """(seat number, name) of the people who are drawn."""
    return list(enumerate(run.names[:MOST_PEOPLE]))


def seat_columns(run: Run, number: int, name: str) -> Array | None:
    """A seat's column or vector as columns, shape (rows, n); not a number while nobody sits there."""
    if run.room is None or f"{number}.seated" not in run.room.columns:
        return None
    columns, key = run.room.columns, f"{number}.{name}"
    values = columns[key][:, None] if key in columns else run.room.vector(key)
    values[columns[f"{number}.seated"] == 0.0] = np.nan
    return values


def extent(run: Run) -> Window:
    """When anybody was there: from the first client's first tick to the last one's last."""
    traces = list(run.clients.values()) or ([run.room] if run.room else [])
    if not traces:
        raise NotDrawnError("no trace is here")
    start, end = min(float(trace.time_s[0]) for trace in traces), max(float(trace.time_s[-1]) for trace in traces)
    return (0.0 if 0.0 <= start < 0.1 * end else start), max(end, start + _SHORTEST_S)


def hands(run: Run, name: str, scale: float, **style: Any) -> Iterator[tuple[int, Line]]:
    """(axis, curve) of a vector of everybody's client trace."""
    for number, person in shown(run):
        trace = run.clients.get(person)
        if trace is None:
            continue
        for axis, values in enumerate(trace.vector(name).T):
            yield axis, Line(trace.time_s, values * scale, {**person_style(number), "lw": 1.2, **style})


def seats(run: Run, name: str, scale: float) -> Iterator[tuple[int, Line]]:
    """(axis, curve) of a vector of every seat of the room."""
    for number, _ in shown(run):
        vectors = seat_columns(run, number, name)
        if vectors is None or run.room is None:
            continue
        for axis, values in enumerate(vectors.T):
            yield axis, Line(run.room.time_s, values * scale, {**person_style(number), **PROXY})


def object_lines(run: Run, scale: float, style: Style) -> Iterator[tuple[int, Line]]:
    """(axis, curve) of the object: the room's own, or else what the first client heard of it."""
    source = run.room or next(iter(run.clients.values()), None)
    if source is None:
        raise NotDrawnError("no trace is here")
    for axis, values in enumerate(source.vector("object_m").T):
        yield axis, Line(source.time_s, values * scale, style)


def people_legend(run: Run, *others: tuple[str, Style]) -> Legend:
    return [*((label(name), {**person_style(number), "lw": 2.0}) for number, name in shown(run)), *others]
