"""Plots of a comparison: networks side by side, a colour and marker for each method, a dot a session, a bar at the median."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cogrip.experiments.experiment import Result
from cogrip.experiments.methods.looks import FILLS, MARK_WORDS, WORDS, bar_look, style_of
from cogrip.experiments.methods.measures import MEASURES, Mark, State
from cogrip.experiments.methods.method import named
from cogrip.experiments.methods.query import DRAWN_SEEDS, FELT_SEEDS, ComparisonQuery
from cogrip.experiments.methods.rows import WIDTH, Rows
from cogrip.experiments.methods.table import BOUNDS, credits_of, feels, first_seeds
from cogrip.experiments.methods.table import unstable as unstable_row
from cogrip.experiments.methods.trace_plot import draw_traces
from cogrip.results.plots.style import ALARM, FAINT, INK, NotDrawnError, Sheet, Style

_DOT_SIZE = 5.4
_LOG_FROM, _LOG_SPAN = 1e-3, 30.0
"""Least value on a logarithmic axis, and the ratio of two values above which an axis is logarithmic."""
_MEDIAN: Style = {"color": INK, "lw": 1.6}
_DOT: Style = {"color": FAINT, "marker": "o", "ms": 6, "lw": 0}
_UNSTABLE: Style = {"marker": "x", "color": ALARM, "ms": 6, "lw": 0, "mew": 1.4}
_NOT_MEASURED: Style = {"marker": "_", "color": FAINT, "ms": 8, "lw": 0, "mew": 1.6}
_PARTS: tuple[tuple[State, Mark, str], ...] = (  # parts of a bar, from its foot
    ("diverged", "unstable", f"{WORDS['diverged']}, not passive"),
    ("diverged", "unstable_passive", f"{WORDS['diverged']}, passive"),
    ("oscillates", "unstable", f"{WORDS['oscillates']}, not passive"),
    ("oscillates", "unstable_passive", f"{WORDS['oscillates']}, passive"),
    ("not_passive", "not_passive", WORDS["not_passive"]),
)
_DOT_LEGEND: list[tuple[str, Style]] = [
    *((words, {**_DOT, **FILLS[mark]}) for mark, words in MARK_WORDS.items()),
    ("median", _MEDIAN),
]
_MARKS = (
    "A mark is a session: full if it is passive, in a dark edge if it is unstable as well; half full if it is stable and not "
    "passive; hollow if it is unstable and not passive (one that diverged is measured up to then). A line is the median of a "
    "method; methods stand beside each other in the order of the legend. "
    "On a logarithmic axis what is less than its first number "
    "stands on its edge."
)


class DrawnPlot(NamedTuple):
    """A drawn plot: the name of its files, its heading, and a caption on what to look for."""

    name: str
    heading: str
    caption: str
    figure: Figure


def draw_all(asked: ComparisonQuery, results: Mapping[int, Result], summary: Mapping[str, Any]) -> Iterator[DrawnPlot]:
    """Yield every plot of which there is anything to draw."""
    rows = Rows(asked, results, summary)
    felt_seeds, drawn_seeds = (first_seeds(len(asked.seeds), most) for most in (FELT_SEEDS, DRAWN_SEEDS))

    def drawn(name: str, heading: str, draw: Callable[[], Figure], caption: str) -> Iterator[DrawnPlot]:
        with suppress(NotDrawnError):
            yield DrawnPlot(name, heading, caption, draw())

    yield from drawn(
        "stability", "Stability and energy", partial(_stability, rows),
        "Above, the share of sessions that diverged, oscillate, or are stable and not passive, with their number; what is "
        "unstable and passive is white in a frame. Below, the most energy that the network had given out beyond what the hands "
        f"had put in. {BOUNDS}. {credits_of(summary)} {_MARKS}",
    )  # fmt: skip
    yield from drawn(
        "traces", "Forces over time", partial(draw_traces, rows),
        f"The force on each hand, a row a network, a column a method, each in its median session over seeds{drawn_seeds}, by "
        "its verdict, then its peak force: panels say the seed. A shade and a mark a person, the line the middle of a short "
        "stretch, the band from its least to its largest: a broad band is a force that oscillates. What ends early, at the "
        "dotted line, has diverged. A row is as high as its stable sessions need, so rows differ in scale: others are cut off, "
        "and say how far they go. A panel that says no verdict is stable and passive.",
    )  # fmt: skip
    yield from drawn(
        "forces", "Forces", partial(_dots, rows, ("peak_force_n", "force_step_n")),
        f"The clean link stands first, for comparison with the others. {_MARKS}",
    )  # fmt: skip
    yield from drawn(
        "coherence", "Position coherence",
        partial(_dots, rows, ("coherence_rms_mm", "coherence_max_mm", "hands_rms_mm", "rest_mm")),
        "Distance between the object's positions as reported to two people, between their hands, and between their hands "
        f"once all hold still where they began. {_MARKS}",
    )  # fmt: skip
    yield from drawn(
        "errors", "Force errors", partial(_dots, rows, ("error_clean_n", "error_ideal_n")),
        "Difference of forces from those of the same hands on a clean link, and from those of the object in the hands "
        f"alone. {_MARKS}",
    )  # fmt: skip
    yield from drawn(
        "lift", "Contact, slip and lift", partial(_dots, rows, ("contact_n", "slip_mm", "lifted_mm", "lifted_s")),
        "The largest normal force at a tool, how far a tool slipped while the object was lifted, how far it was lifted, and "
        f"for how long. {_MARKS}",
    )  # fmt: skip
    yield from drawn(
        "felt", "Felt stiffness", partial(_felt, rows),
        "The stiffness that each person feels under a static load, as a share of the K asked for that person, the line: a "
        f"mark a person, in the order of the settings, the median over seeds{felt_seeds}; the number is that of the lowest "
        "mark, in N/m. A red cross: the method is unstable in half of its sessions or more, so nothing is shown. A grey dash: "
        "not measured; in somebody's place: at least half of that person's probes never came to rest.",
    )  # fmt: skip


def _legend(rows: Rows) -> list[tuple[str, Style]]:
    return [(named(name), {**style_of(name), "lw": 0, "ms": 7}) for name in rows.asked.methods]


def _across(panel: Axes, networks: tuple[str, ...]) -> None:
    panel.set_xlim(-0.5, len(networks) - 0.5)
    panel.set_xticks(range(len(networks)), networks)
    panel.grid(visible=False, axis="x")
    for place in range(1, len(networks)):
        panel.axvline(place - 0.5, color="#d0d7de", lw=0.6)
    panel.tick_params(axis="x", length=0)


def _stability(rows: Rows) -> Figure:
    sheet = Sheet(2, 1, row_in=2.6)
    shares, energy = sheet.panels[:, 0]
    width = 0.8 * WIDTH / len(rows.asked.methods)
    for key, place in rows.places():
        style, foot, counts = style_of(key[1]), 0.0, rows.counts(key)
        for state, mark, _ in _PARTS:
            if share := 100.0 * counts[state, mark] / max(1, counts.total()):
                shares.bar(place, share, width, bottom=foot, **bar_look(state, mark, style["color"]))
                foot += share
        if flawed := counts.total() - counts["passive", "passive"]:
            shares.annotate(
                str(flawed), (place, foot), xytext=(0, 2), textcoords="offset points", ha="center", va="bottom", fontsize=8,
                color=INK,
            )  # fmt: skip
        elif counts:
            shares.plot(place, 0.0, **style, ms=5, clip_on=False, zorder=3)
    shares.set_ylim(0.0, 110.0)
    _scatter(rows, energy, "created_mj")
    for panel in (shares, energy):
        _across(panel, rows.asked.networks)
    legend = [
        *_legend(rows),
        (f"number: sessions of {len(rows.asked.seeds)}; mark on the axis: none", {"lw": 0}),
        *((words, bar_look(state, mark, INK)) for state, mark, words in _PARTS),
        *_DOT_LEGEND,
    ]
    return sheet.finish("network", ["unstable or not passive [%]", "energy created [mJ]"], legend)


def _dots(rows: Rows, measures: tuple[str, ...]) -> Figure:
    drawn = [measure for measure in measures if rows.numbers(measure)]
    if not drawn:
        raise NotDrawnError(f"no session has {', '.join(measures)}")
    sheet = Sheet(len(drawn), 1, row_in=2.4)
    for measure, panel in zip(drawn, sheet.panels[:, 0], strict=True):
        _scatter(rows, panel, measure)
        _across(panel, rows.asked.networks)
    labels = [f"{MEASURES[measure].heading} [{MEASURES[measure].unit}]" for measure in drawn]
    return sheet.finish("network", labels, [*_legend(rows), *_DOT_LEGEND])


def _scatter(rows: Rows, panel: Axes, measure: str) -> None:
    """Draw a dot for each session, side by side in the order of their seeds, and the median."""
    floor = _scale(panel, rows.numbers(measure))
    room = 0.75 * WIDTH / len(rows.asked.methods)
    for key, place in rows.places():
        judged = rows.judged(key, measure)
        if not judged:
            continue
        values = np.maximum(np.abs([value for value, _ in judged]), floor)
        places = place + _spread(len(values), room)
        look: Style = {**style_of(key[1]), "ms": _DOT_SIZE, "lw": 0, "clip_on": False}
        for depth, (mark, fill) in enumerate(FILLS.items()):
            of = np.array([each == mark for _, each in judged])
            if of.any():
                panel.plot(places[of], values[of], **look, **fill, zorder=3.0 + 0.1 * depth)
        middle = float(np.median(values))
        panel.plot([place - 0.64 * room, place + 0.64 * room], [middle, middle], **_MEDIAN, zorder=3.05, clip_on=False)


def _spread(count: int, room: float) -> NDArray[np.float64]:
    """Return the places of so many marks beside each other, around 0."""
    return room * ((np.arange(count) + 0.5) / count - 0.5)


def _scale(panel: Axes, values: Sequence[float]) -> float:
    """Scale the panel's axis, logarithmic where values spread far, and return where it begins: lesser values stand there."""
    most = max((abs(value) for value in values), default=0.0)
    positive = [abs(value) for value in values if abs(value) >= _LOG_FROM]
    if not positive or most <= _LOG_SPAN * min(positive):
        panel.set_ylim(0.0, 1.06 * most or 1.0)
        return 0.0
    first, last = int(np.floor(np.log10(min(positive)))), int(np.floor(np.log10(most)))
    powers = range(first, last + 1, 1 + (last - first) // 7)
    span = most / min(positive)
    steps = (1, 2, 5) if span < 1e2 else (1, 3) if span < 1e3 else (1,)
    known = [(step * 10.0**power, _tick(step, power)) for power in powers for step in steps]
    floor = max(tick for tick, _ in known if tick <= min(positive))
    ticks = [tick for tick, _ in known if tick >= floor]
    texts = [text for tick, text in known if tick >= floor]
    if any(abs(value) < floor for value in values):
        texts[0] = f"≤ {texts[0]}"
    panel.set_yscale("log")
    panel.set_yticks(ticks, texts)
    panel.set_ylim(floor, 1.4 * most)
    panel.minorticks_off()
    return floor


def _tick(step: int, power: int) -> str:
    """Return the label of step * 10^power, in digits where they are few."""
    if -2 <= power < 3:
        return f"{step * 10.0**power:g}"
    return f"$10^{{{power}}}$" if step == 1 else f"${step}{{\\cdot}}10^{{{power}}}$"


def _felt(rows: Rows) -> Figure:
    asked = rows.asked
    sheet = Sheet(1, 1, row_in=3.4)
    panel: Axes = sheet.panels[0, 0]
    shares = {key: [] if unstable_row(row) else _felt_shares(row) for key, row in rows.summary.items()}
    everything = [share for people in shares.values() for found in people if found for share in found[:1]]
    if not everything:
        raise NotDrawnError("no felt stiffness was measured")
    floor = _scale(panel, [*everything, 100.0])
    panel.set_ylim(top=max(160.0, 1.4 * max(everything)) if floor else max(115.0, 1.1 * max(everything)))
    panel.axhline(100.0, color=FAINT, lw=1.0, zorder=0)
    room = 0.6 * WIDTH / len(asked.methods)
    for key, place in rows.places():
        people, style = shares[key], style_of(key[1])
        places = place + _spread(len(people), room)
        felt = [(*found, float(at)) for found, at in zip(people, places, strict=True) if found]
        none = [float(at) for found, at in zip(people, places, strict=True) if not found] if people else [place]
        if none:
            look = _UNSTABLE if unstable_row(rows.summary[key]) else _NOT_MEASURED
            panel.plot(none, [0.04] * len(none), **look, transform=panel.get_xaxis_transform())
        if not felt:
            continue
        lowest, stiffness, at = min(felt)
        foot = max(lowest, floor)
        panel.plot([at, at], [100.0, foot], color=style["color"], lw=1.2, alpha=0.4, zorder=1)
        heights = [max(share, floor) for share, _, _ in felt]
        panel.plot([at for _, _, at in felt], heights, **style, ms=5, lw=0, mew=0, clip_on=False)
        below = -6 - 9 * (asked.methods.index(key[1]) % 2)  # in turns, so that no number runs into the next one
        panel.annotate(
            f"{stiffness:.{0 if stiffness >= 100.0 else 1}f}", (at, foot), xytext=(0, below), textcoords="offset points",
            ha="center", va="top", fontsize=7, color=INK,
        )  # fmt: skip
    panel.set_ylim(bottom=0.5 * floor if floor else -0.1 * panel.get_ylim()[1])  # room for crosses and numbers
    _across(panel, asked.networks)
    legend = [
        *_legend(rows), ("unstable", _UNSTABLE), ("not measured, or no rest", _NOT_MEASURED),
        ("number: the lowest mark's [N/m]", {"lw": 0}),
    ]  # fmt: skip
    return sheet.finish("network", ["felt stiffness / K asked for [%]"], legend)


def _felt_shares(row: Mapping[str, Any]) -> list[tuple[float, float] | None]:
    """Return K_felt / K [%] and K_felt [N/m] of each person, None for one who feels none."""
    return [
        (100.0 * person["felt_npm"]["median"] / person["asked_npm"], person["felt_npm"]["median"])
        if feels(person["felt_npm"])
        else None
        for person in row["felt"]
    ]
