"""Pictures of a comparison: networks across, a colour and a mark a method, a dot a session, a bar at the median."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cogrip.sim.methods.measures import MEASURES
from cogrip.sim.methods.method import METHODS
from cogrip.sim.methods.question import Comparison
from cogrip.sim.methods.table import unstable as unstable_row
from cogrip.sim.plots.style import ALARM, DOTTED, FAINT, INK, NotDrawnError, Sheet, Style, colour, label, title
from cogrip.sim.sweep.cell import Result
from cogrip.sim.verdict import is_number

_MARKS = "osD^v"
_SHOWN_PEOPLE = 6  # in a legend
_WIDTH = 0.8  # of the room of a network that its methods take
_LOG_FROM, _LOG_SPAN = 1e-3, 300.0  # of values that spread more than this a logarithmic axis is drawn


class Plot(NamedTuple):
    """name is that of its files; caption says what to look for."""

    name: str
    heading: str
    caption: str
    figure: Figure


class _Entry(NamedTuple):
    name: str
    heading: str
    caption: str
    draw: Callable[[], Figure]


class Rows:
    """Results by network, method and measure, of the sessions that could be run."""

    def __init__(self, asked: Comparison, results: Mapping[int, Result], summary: Mapping[str, Any]) -> None:
        self.asked = asked
        self.summary = {(row["network"], row["method"]): row for row in summary["rows"]}
        self._values: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for cell in sorted(results):
            values = asked.values(cell)
            if not results[cell].error:
                self._values.setdefault((values["network"], values["method"]), []).append(results[cell].measures)

    def traces(self, network: str, method: str) -> tuple[float, list[list[float]]] | None:
        """Length [s] and sketched forces of the session that has them."""
        for row in self._values.get((network, method), ()):
            if row.get("trace"):
                return float(row["trace"]["seconds"]), row["trace"]["force_n"]
        return None

    def numbers(self, network: str, method: str, measure: str) -> list[float]:
        return [value for value, _ in self.judged(network, method, measure)]

    def judged(self, network: str, method: str, measure: str) -> list[tuple[float, bool]]:
        """Each number with whether its session was unstable."""
        found = self._values.get((network, method), ())
        return [(float(row[measure]), row["diverged"] or row["oscillates"]) for row in found if is_number(row[measure])]


def draw_all(asked: Comparison, results: Mapping[int, Result], summary: Mapping[str, Any]) -> Iterator[Plot]:
    """Every picture of which there is anything to draw."""
    rows = Rows(asked, results, summary)
    marks = (
        "A mark is a session, hollow if it diverged (measured up to then) or oscillates, a bar the median of a method; methods "
        "stand beside each other in the order of the legend."
    )
    entries = (
        _Entry(
            "stability",
            "Stability and energy",
            "Above, the share of sessions that diverged or oscillate; below, the most energy that the network had given out "
            f"beyond what the hands had put in. {marks} What is below the axis's first number stands on its edge.",
            partial(_stability, rows),
        ),
        _Entry(
            "traces",
            "Forces over time",
            f"The force on each hand in the sessions of seed {asked.seeds[0]}, a row a network, a column a method; a colour a "
            "person. What ends early, at the dotted line, has diverged.",
            partial(_traces, rows),
        ),
        _Entry(
            "forces",
            "Forces",
            f"The clean link stands first, as what to hold the others against. {marks}",
            partial(_dots, rows, ("peak_force_n", "force_step_n")),
        ),
        _Entry(
            "coherence",
            "Position coherence",
            "How far apart two people are told that the object is, how far apart their hands are, and how far apart once all "
            f"hold still where they began. {marks}",
            partial(_dots, rows, ("coherence_rms_mm", "coherence_max_mm", "hands_rms_mm", "rest_mm")),
        ),
        _Entry(
            "errors",
            "Force errors",
            "How far forces are from those of the same hands on a clean link, and from those of the object in the hands "
            f"alone. {marks}",
            partial(_dots, rows, ("error_clean_n", "error_ideal_n")),
        ),
        _Entry(
            "felt",
            "Felt stiffness",
            "The stiffness that a person feels under a static load; the line is the K that was asked for. Where a method is "
            "unstable nobody can feel it, and none is drawn.",
            partial(_felt, rows),
        ),
    )
    for name, heading, caption, draw in entries:
        try:
            figure = draw()
        except NotDrawnError:
            continue
        yield Plot(name, heading, caption, figure)


def style_of(number: int) -> Style:
    """Colour and mark of method number n."""
    return {"color": colour(number), "marker": _MARKS[number % len(_MARKS)]}


def _legend(rows: Rows) -> list[tuple[str, Style]]:
    return [
        (METHODS[name].title, {**style_of(number), "lw": 0, "ms": 7}) for number, name in enumerate(rows.asked.methods)
    ]


def _across(panel: Axes, networks: tuple[str, ...]) -> None:
    panel.set_xlim(-0.5, len(networks) - 0.5)
    panel.set_xticks(range(len(networks)), networks)
    panel.grid(visible=False, axis="x")
    for place in range(1, len(networks)):
        panel.axvline(place - 0.5, color="#d0d7de", lw=0.6)
    panel.tick_params(axis="x", length=0)


def _place(rows: Rows, network: int, method: int) -> float:
    count = len(rows.asked.methods)
    return network + _WIDTH * ((method + 0.5) / count - 0.5)


def _stability(rows: Rows) -> Figure:
    asked = rows.asked
    sheet = Sheet(2, 1, row_in=2.6)
    shares, energy = sheet.panels[:, 0]
    width = 0.8 * _WIDTH / len(asked.methods)
    for network, name in enumerate(asked.networks):
        for number, method in enumerate(asked.methods):
            row, place = rows.summary[name, method], _place(rows, network, number)
            if row["runs"]:
                lost, swinging = 100.0 * row["diverged"] / row["runs"], 100.0 * row["oscillates"] / row["runs"]
                shares.bar(place, lost, width, color=colour(number))
                shares.bar(
                    place,
                    swinging,
                    width,
                    bottom=lost,
                    color=colour(number),
                    alpha=0.45,
                    hatch="///",
                    edgecolor="white",
                    lw=0,
                )
                if not lost + swinging:
                    shares.plot(place, 0.0, **style_of(number), ms=5, clip_on=False, zorder=3)
    shares.set_ylim(0.0, 104.0)
    title(
        shares,
        "full: diverged; hatched: oscillates between hands at rest; mark: stable",
    )
    _scatter(rows, energy, "created_mj")
    for panel in (shares, energy):
        _across(panel, asked.networks)
    return sheet.finish("network", ["unstable sessions [%]", "energy created [mJ]"], _legend(rows))


def _traces(rows: Rows) -> Figure:
    asked = rows.asked
    sheet = Sheet(len(asked.networks), len(asked.methods), row_in=1.25)
    people = 0
    for network, panels in zip(asked.networks, sheet.panels, strict=True):
        for method, panel in zip(asked.methods, panels, strict=True):
            panel.set_xlim(0.0, float(asked.base["seconds"]))
            found = rows.traces(network, method)
            if found is None:
                continue
            seconds, forces = found
            people = max(people, len(forces))
            for person, values in enumerate(forces):
                panel.plot(np.linspace(0.0, seconds, len(values)), values, color=colour(person), lw=0.7, alpha=0.8)
            if rows.summary[network, method]["diverged"] and seconds < asked.base["seconds"]:
                panel.axvline(seconds, color=ALARM, lw=1.0, ls=DOTTED)
    if not people:
        raise NotDrawnError("no forces were kept")
    for method, panel in zip(asked.methods, sheet.panels[0], strict=True):
        title(panel, METHODS[method].title)
    names = [str(user["name"]) for user in asked.base["users"]][:_SHOWN_PEOPLE]
    legend: list[tuple[str, Style]] = [(label(name), {"color": colour(n), "lw": 1.5}) for n, name in enumerate(names)]
    return sheet.finish("time [s]", [f"{network}\n[N]" for network in asked.networks], legend)


def _dots(rows: Rows, measures: tuple[str, ...]) -> Figure:
    drawn = [measure for measure in measures if _any(rows, measure)]
    if not drawn:
        raise NotDrawnError(f"no session has {', '.join(measures)}")
    sheet = Sheet(len(drawn), 1, row_in=2.4)
    for measure, panel in zip(drawn, sheet.panels[:, 0], strict=True):
        _scatter(rows, panel, measure)
        _across(panel, rows.asked.networks)
    labels = [f"{MEASURES[measure].heading} [{MEASURES[measure].unit}]" for measure in drawn]
    return sheet.finish("network", labels, _legend(rows))


def _any(rows: Rows, measure: str) -> bool:
    return any(rows.numbers(*key, measure) for key in rows.summary)


def _scatter(rows: Rows, panel: Axes, measure: str) -> None:
    """Dots spread over a method's room in the order of their seeds; a logarithmic axis where the medians spread far."""
    asked = rows.asked
    everything = [abs(value) for key in rows.summary for value in rows.numbers(*key, measure)]
    positive = [value for value in everything if value >= _LOG_FROM]
    log = bool(positive) and max(positive) > _LOG_SPAN * min(positive)
    floor = 10.0 ** np.floor(np.log10(min(positive))) if log else 0.0
    room = 0.7 * _WIDTH / len(asked.methods)
    for network, name in enumerate(asked.networks):
        for number, method in enumerate(asked.methods):
            judged = rows.judged(name, method, measure)
            if not judged:
                continue
            values = np.maximum(np.abs([value for value, _ in judged]), floor)
            bad = np.array([unstable for _, unstable in judged])
            place = _place(rows, network, number)
            jitter = room * ((np.arange(len(values)) + 0.5) / len(values) - 0.5)
            look: Style = {**style_of(number), "ms": 3.4, "lw": 0, "alpha": 0.6, "clip_on": False}
            panel.plot((place + jitter)[~bad], values[~bad], **look, mew=0)
            panel.plot((place + jitter)[bad], values[bad], **look, mfc="none", mew=0.9)
            middle = float(np.median(values))
            panel.plot([place - 0.6 * room, place + 0.6 * room], [middle, middle], color=INK, lw=1.6, zorder=3)
    if log:
        panel.set_yscale("log")
        panel.set_ylim(bottom=floor)
        panel.minorticks_off()
    else:
        panel.set_ylim(bottom=0.0)


def _felt(rows: Rows) -> Figure:
    asked, found = rows.asked, False
    sheet = Sheet(1, 1, row_in=3.4)
    panel: Axes = sheet.panels[0, 0]
    for network, name in enumerate(asked.networks):
        for number, method in enumerate(asked.methods):
            row = rows.summary[name, method]
            if row["felt_npm"] is None or unstable_row(row):
                continue
            found, place, felt = True, _place(rows, network, number), row["felt_npm"]
            panel.plot([place, place], [row["asked_npm"], felt], color=colour(number), lw=1.2, alpha=0.6)
            panel.plot(place, felt, **style_of(number), ms=7, clip_on=False)
            panel.annotate(
                f"{felt:.0f}", (place, felt), xytext=(7, 0), textcoords="offset points", va="center", fontsize=8, color=INK,
            )  # fmt: skip
    if not found:
        raise NotDrawnError("no felt stiffness was measured")
    for stiffness in sorted({row["asked_npm"] for row in rows.summary.values() if row["asked_npm"]}):
        panel.axhline(stiffness, color=FAINT, lw=1.0, zorder=0)
    panel.set_ylim(bottom=0.0)
    _across(panel, asked.networks)
    return sheet.finish("network", ["felt stiffness [N/m]"], _legend(rows))
