"""Round-trip times and lost frames."""

from matplotlib.figure import Figure

from cogrip.sim.runs.plots.curves import PROXY, extent, people_legend, seat_columns, shown
from cogrip.sim.runs.plots.style import DASHED, FAINT, NotDrawnError, Sheet, draw, draw_spread, person_style
from cogrip.sim.runs.traces import Run


def link(run: Run) -> Figure:
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
