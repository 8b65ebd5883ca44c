"""The plot of forces over time: a row a network, a column a method, each in its median session."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cogrip.experiments.methods.looks import WARNING, WORDS, person_look, style_of
from cogrip.experiments.methods.method import named
from cogrip.experiments.methods.query import ComparisonQuery
from cogrip.experiments.methods.rows import Rows, SessionRows
from cogrip.results.plots.style import (
    ALARM,
    COLOURS,
    DOTTED,
    FAINT,
    INK,
    NotDrawnError,
    Sheet,
    Style,
    draw_spread,
    label,
    title,
)

_STRETCHES = 80  # number of stretches of a session, of each of which a trace shows minimum, median and maximum
_MARGIN = 1.2  # factor on the largest force of a row's stable sessions that gives the height of its axis
_TRACE_LEGEND: list[tuple[str, Style]] = [
    ("band: from the least to the largest", {"facecolor": FAINT, "alpha": 0.35, "lw": 0}),
    ("diverged", {"color": ALARM, "lw": 1.0, "ls": DOTTED}),
    ("a panel without a verdict: stable and passive", {"lw": 0}),
]


def draw_traces(rows: Rows) -> Figure:
    asked = rows.asked
    whole_s = float(asked.base["seconds"])
    sheet = Sheet(len(asked.networks), len(asked.methods), row_in=1.25)
    found = False
    for network, panels in zip(asked.networks, sheet.panels, strict=True):
        sessions = {method: one for method in asked.methods if (one := rows.typical((network, method)))}
        found = found or bool(sessions)
        height = _height(list(sessions.values()))
        for method, panel in zip(asked.methods, panels, strict=True):
            panel.set_xlim(0.0, whole_s)
            panel.set_xticks([0.0, 0.5 * whole_s])  # one at the end would run into the next panel's first
            if height:
                panel.set_ylim(-height, height)
            if method in sessions:
                _trace(panel, sessions[method], style_of(method)["color"], whole_s, height)
    if not found:
        raise NotDrawnError("no forces were kept")
    for method, panel in zip(asked.methods, sheet.panels[0], strict=True):
        title(panel, method, style_of(method)["color"])
    methods = [(named(method), {"color": style_of(method)["color"], "lw": 1.5}) for method in asked.methods]
    legend = [*_people(asked), *_TRACE_LEGEND, *methods]
    return sheet.finish("time [s]", [f"{network}\nforce [N]" for network in asked.networks], legend)


def _height(sessions: Sequence[SessionRows]) -> float:
    """Return the height of a row [N]: for its stable sessions, or for all if none is stable; 0 without any forces."""
    stable = [session for session in sessions if session.state in ("not_passive", "passive")]
    return _MARGIN * max((_largest(session.forces) for session in stable or sessions), default=0.0)


def _largest(forces: list[list[float]]) -> float:
    return max((abs(value) for values in forces for value in values), default=0.0)


def _trace(panel: Axes, session: SessionRows, tint: str, whole_s: float, height: float) -> None:
    """Draw one session's forces, and say its seed, its verdict, and where it was cut off."""
    seconds = session.seconds
    stretches = max(2, round(_STRETCHES * seconds / whole_s))
    for person, values in enumerate(session.forces):
        times, style = np.linspace(0.0, seconds, len(values)), {**person_look(person, tint), "lw": 1.0, "ms": 3.0}
        draw_spread(panel, times, np.array(values, dtype=float), style, stretches, pale=0.3)
    words = [] if session.state == "passive" else [WORDS[session.state]]
    if session.state == "diverged":
        panel.axvline(seconds, color=ALARM, lw=1.0, ls=DOTTED)
        words = [f"diverged at {seconds:.2g} s"]
    if (most := _largest(session.forces)) > height:
        words.append(f"up to {most:.3g} N")
    alarm = WARNING if session.state == "not_passive" else ALARM
    for text, at, tint in ("\n".join(words), "top", alarm), (f"seed {session.seed}", "bottom", INK):
        if text:
            panel.text(
                0.985, 0.95 if at == "top" else 0.05, text, transform=panel.transAxes, ha="right", va=at, fontsize=8,
                color=tint, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
            )  # fmt: skip


def _people(asked: ComparisonQuery) -> list[tuple[str, Style]]:
    """Return entries of people, as many as there are colours, and the number of the others."""
    names = [str(user["name"]) for user in asked.base["users"]]
    legend: list[tuple[str, Style]] = [
        (label(name), {**person_look(number, FAINT), "lw": 1.5}) for number, name in enumerate(names[:COLOURS])
    ]
    if len(names) > COLOURS:
        legend.append((f"and {len(names) - COLOURS} more, in the same shades again", {"lw": 0}))
    return legend
