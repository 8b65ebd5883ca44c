"""Histograms of lateness and of work per tick, of every loop."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cogrip.sim.runs.plots.style import INK, LINES, Array, NotDrawnError, Sheet, Style, colour, label
from cogrip.sim.runs.traces import MOST_PEOPLE, Run, Trace

_PER_DECADE = 12
_FLOOR_US = 0.1  # a tick that is no later than this stands in the first bin


def loops(run: Run) -> Figure:
    """Draw the share of ticks by lateness and by work [us], clients and server, logarithmic both ways."""
    traces: list[tuple[str, Style, Trace]] = [
        (name, {"color": colour(number), "ls": LINES[number % len(LINES)], "lw": 1.5}, run.clients[name])
        for number, name in enumerate(run.names[:MOST_PEOPLE])
        if name in run.clients
    ]
    if run.room:
        traces.append(("server", {"color": INK, "lw": 1.5}, run.room))
    late = [trace.columns["late_us"] for *_, trace in traces]
    work = [trace.columns["work_us"] for *_, trace in traces]
    work = [values[values > 0.0] for values in work]  # the first row knows of no work yet
    if not any(np.any(values) for values in late + work):
        raise NotDrawnError("in virtual time no tick is late" if traces else "no trace is here")
    sheet = Sheet(1, 2, row_in=2.9)
    styles = [style for _, style, _ in traces]
    for panel, columns in zip(sheet.panels[0], (late, work), strict=True):
        _histogram(panel, columns, styles)
    rates = [trace.rate_hz for *_, trace in traces]
    for _, style, trace in traces:
        tint = style["color"] if rates.count(trace.rate_hz) == 1 else INK
        sheet.panels[0, 0].axvline(1e6 / trace.rate_hz, color=tint, lw=1.2, ls=":")
    legend = [(f"{label(name)}: {_skipped(trace)}", {**style, "lw": 2.0}) for name, style, trace in traces]
    legend.append(("one period of the loop", {"color": INK, "lw": 1.2, "ls": ":"}))
    return sheet.finish(["lateness of a tick [µs]", "work of a tick [µs]"], ["share of ticks [%]"], legend)


def _histogram(panel: Axes, columns: Sequence[Array], styles: Sequence[Style]) -> None:
    values = [np.maximum(column[np.isfinite(column)], _FLOOR_US) for column in columns]
    longest = max((float(value.max()) for value in values if value.size), default=_FLOOR_US)
    first, last = np.floor(np.log10(_FLOOR_US)), np.ceil(np.log10(max(longest, 10.0)) + 1e-9)
    edges = np.logspace(first, last, int(last - first) * _PER_DECADE + 1)
    for value, style in zip(values, styles, strict=True):
        if value.size:
            counts = np.histogram(value, edges)[0]
            panel.stairs(np.where(counts, counts, np.nan) * 100.0 / value.size, edges, baseline=None, **style)
    panel.set_xscale("log")
    panel.set_yscale("log")
    used = min((float(value.min()) for value in values if value.size), default=_FLOOR_US)
    panel.set_xlim(0.7 * used, 1.5 * longest)


def _skipped(trace: Trace) -> str:
    """Count the ticks left out, as the pacer does."""
    count = int(trace.columns["skipped"][-1])
    return f"{count} of {count + trace.rows} ticks skipped"
