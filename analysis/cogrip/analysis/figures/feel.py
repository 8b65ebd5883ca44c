"""The felt impedance over frequency: rendered and ideal in each condition, magnitude and phase."""

from __future__ import annotations

from typing import Any

import numpy as np

from cogrip.analysis.feel.feel import Condition, conditions, device_impedance, frequencies_hz
from cogrip.analysis.figures.page import FigurePage, FigureTable
from cogrip.analysis.linear.linear_session import LinearSession
from cogrip.results.plots.style import ALARM, DASHED, DOTTED, FAINT, INK, Sheet, colour, label, title

_GIVES = {"facecolor": ALARM, "alpha": 0.1, "lw": 0}


def feel_page(session: LinearSession, user: int) -> FigurePage:
    """Draw each condition with its ideal, and the bare device's own impedance, which comes on top."""
    frequency = frequencies_hz(session.people[0].rates)
    found = conditions(session, user, frequency)
    device = device_impedance(session, user, 2.0 * np.pi * frequency)
    sheet = Sheet(2, len(found), row_in=2.6)
    rows: list[list[Any]] = []
    tint = colour(user)
    for column, condition in enumerate(found):
        above, below = sheet.panels[:, column]
        _draw(above, below, condition, frequency, device, tint)
        title(above, condition.name)
        for each, rendered, ideal in zip(frequency, condition.rendered, condition.ideal, strict=True):
            rows.append([condition.name, each, rendered.real, rendered.imag, ideal.real, ideal.imag])
    legend: list[tuple[str, dict[str, Any]]] = [
        ("rendered", {"color": tint, "lw": 1.8}),
        ("direct contact", {"color": INK, "lw": 1.4, "linestyle": DASHED}),
        ("the bare device, on top of it", {"color": FAINT, "lw": 1.2, "linestyle": DOTTED}),
        ("gives energy", _GIVES),
    ]
    name = label(session.people[user].name)
    figure = sheet.finish("frequency [Hz]", ["impedance |F / v| [N s/m]", "phase [°]"], legend)
    caption = (
        f"What {name}'s hand feels of the object, over frequency, beside direct contact with the same spring, damper, mass and "
        "other hands. A phase between -90 and 90 degrees gives no energy."
    )
    columns = (
        "condition", "frequency_hz", "rendered_real_nspm", "rendered_imag_nspm", "ideal_real_nspm", "ideal_imag_nspm",
    )  # fmt: skip
    return FigurePage("feel", f"What {name} feels", caption, figure, FigureTable(columns, rows))


def _draw(above: Any, below: Any, condition: Condition, frequency: Any, device: Any, tint: Any) -> None:
    lines = (
        (condition.rendered, {"color": tint, "lw": 1.8, "zorder": 3}),
        (condition.ideal, {"color": INK, "lw": 1.4, "linestyle": DASHED, "zorder": 2}),
        (device, {"color": FAINT, "lw": 1.2, "linestyle": DOTTED, "zorder": 1}),
    )
    for values, style in lines:
        size = np.abs(values)
        if size.max() > 0.0:
            above.loglog(frequency, np.where(size > 0.0, size, np.nan), **style)
            below.semilogx(frequency, np.degrees(np.angle(values)), **style)
    below.axhspan(90.0, 190.0, **_GIVES)
    below.axhspan(-190.0, -90.0, **_GIVES)
    below.set_ylim(-190.0, 190.0)
    below.set_yticks([-180, -90, 0, 90, 180])
    above.tick_params(colors=INK)
    for panel in (above, below):
        panel.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
