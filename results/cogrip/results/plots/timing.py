"""Times of a run: round trips and lost frames of the link, lateness and work of the loops."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cogrip.results.plots.curves import PROXY, extent, people_legend, seat_columns, shown
from cogrip.results.plots.style import (
    DASHED,
    FAINT,
    INK,
    LINES,
    Array,
    NotDrawnError,
    Sheet,
    Style,
    colour,
    draw,
    draw_spread,
    label,
    person_style,
)
from cogrip.results.reading.traces import MOST_PEOPLE, EndTrace, TracedRun

_PER_DECADE = 12
_FLOOR_US = 0.1  # lateness of the first bin: a tick that is no later than this stands in it


def link(run: TracedRun) -> Figure:
    """Draw the round-trip time [ms], and the frames lost so far, in each direction: late ones are not."""
    if not shown(run):
        raise NotDrawnError("nobody is named")
    sheet = Sheet(2, row_in=1.9)
    times, lost = sheet.panels[:, 0]
    for number, name in shown(run):
        style, trace, up = person_style(number), run.clients.get(name), seat_columns(run, number, "lost")
        if trace is not None:
            draw_spread(times, trace.time_s, trace.columns["rtt_ms"], style)
            draw(lost, trace.time_s, trace.columns["lost"], **style, lw=1.6)
        if up is not None and run.room is not None:
            draw(lost, run.room.time_s, up[:, 0], **{**style, **PROXY, "lw": 1.6})
    times.set_xlim(*extent(run))
    times.set_ylim(0.0, 1.05 * times.get_ylim()[1])
    lost.set_ylim(-0.03 * max(1.0, lost.get_ylim()[1]), 1.05 * max(1.0, lost.get_ylim()[1]))
    lost.yaxis.get_major_locator().set_params(integer=True)
    legend = people_legend(
        run,
        ("down: to the hand", {"color": FAINT}),
        ("up: to the object", {"color": FAINT, "ls": DASHED}),
        ("band: from the least to the largest", {"facecolor": FAINT, "alpha": 0.35, "lw": 0}),
    )
    return sheet.finish("time [s]", ["round trip [ms]", "lost [frames]"], legend)


def loops(run: TracedRun) -> Figure:
    """Draw the share of ticks by lateness and by work [us], clients and server, logarithmic both ways."""
    traces: list[tuple[str, Style, EndTrace]] = [
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


def _skipped(trace: EndTrace) -> str:
    """Count the ticks left out, as the pacer does."""
    count = int(trace.columns["skipped"][-1])
    return f"{count} of {count + trace.rows} ticks skipped"
