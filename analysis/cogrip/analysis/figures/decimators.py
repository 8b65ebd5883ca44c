"""The passivity of decimators: S(w) of each, and the energy of runs, swept and worst."""

from __future__ import annotations

from math import pi
from typing import Any, NamedTuple

import numpy as np

from cogrip.analysis.figures.page import FigurePage, FigureTable
from cogrip.analysis.linear.decimation_passivity import (
    Filter,
    aliased_gain,
    filter_of,
    largest_gain,
    run_energy,
    swept_sine,
    worst_input,
)
from cogrip.protocol.laws.decimation import make_decimator
from cogrip.protocol.settings.rates import Rates
from cogrip.results.plots.style import ALARM, DOTTED, LINES, Sheet, colour

RATES = Rates(1024, 128)
SWEEP_S = 8.0
_POINTS = 721


class Case(NamedTuple):
    name: str
    kind: str
    cutoff_rad_s: float


CASES = (
    Case("boxcar", "boxcar", 50.0),
    Case("lowpass at 50 rad/s (P)", "lowpass", 50.0),
    Case("lowpass at 20 Hz", "lowpass", 2.0 * pi * 20.0),
    Case("lowpass at 40 Hz", "lowpass", 2.0 * pi * 40.0),
    Case("lowpass at 64 Hz", "lowpass", 2.0 * pi * 64.0),
    Case("none", "none", 50.0),
)


def decimator_page() -> FigurePage:
    """Draw S(w), and the share of the energy that each one keeps back in a swept run and under its worst input."""
    M = RATES.ticks_per_frame
    sheet = Sheet(1, 3, row_in=3.6, widths=(1.0, 1.0, 1.0))
    gain_panel, swept_panel, worst_panel = sheet.panels[0]
    angle = np.linspace(0.0, pi, _POINTS)
    hz = angle / pi * 0.5 * RATES.network_hz
    rows: list[list[Any]] = []
    legend = []
    sweep = swept_sine(RATES, SWEEP_S)
    for number, case in enumerate(CASES):
        which: Filter = filter_of(case.kind, RATES, case.cutoff_rad_s)
        most, _ = largest_gain(which, M)
        style = {"color": colour(number), "lw": 1.6, "ls": LINES[number]}
        legend.append((f"{case.name}: largest S {most:.4g}", style))
        gains = aliased_gain(which, M, angle)
        gain_panel.plot(hz, gains, **style)
        rows += [[case.name, "S", x, y] for x, y in zip(hz.tolist(), gains.tolist(), strict=True)]
        for panel, name, signal in (
            (swept_panel, "swept", sweep), (worst_panel, "worst", worst_input(which, M, round(SWEEP_S * RATES.network_hz)))
        ):  # fmt: skip
            decimator = make_decimator(case.kind, 1, M, RATES.tick_s, case.cutoff_rad_s)
            run = run_energy(decimator, signal, RATES)
            share = run.margin_j / np.cumsum((signal.reshape(-1, M) ** 2).sum(axis=1) * 0.5 * RATES.tick_s)
            time = np.arange(1, len(share) + 1) * RATES.frame_s
            panel.plot(time, 100.0 * share, **style)
            rows += [[case.name, name, x, y] for x, y in zip(time.tolist(), (100.0 * share).tolist(), strict=True)]
    gain_panel.set_yscale("log")
    gain_panel.axhline(1.0, color=ALARM, lw=1.0, linestyle=DOTTED, zorder=3)
    for panel in (swept_panel, worst_panel):
        panel.axhline(0.0, color=ALARM, lw=1.0, linestyle=DOTTED, zorder=3)
        panel.set_yscale("symlog", linthresh=1.0)
        panel.set_yticks([-1000, -100, -10, -1, 0, 1, 10, 100], ["−1000", "−100", "−10", "−1", "0", "1", "10", "100"])
        panel.set_ylim(-1300.0, 160.0)
    legend.append(("bound of passivity", {"color": ALARM, "lw": 1.0, "ls": DOTTED}))
    figure = sheet.finish(
        ["frequency after decimation [Hz]", "time [s]", "time [s]"],
        ["S, largest energy out over in [1]", "kept back of a swept sine [%]", "kept back of each one's worst [%]"],
        legend,
    )
    caption = (
        "From M = 8 fast waves to one. A decimator is passive for every signal if and only if S never exceeds 1: "
        "the mean of a frame alone is. "
        "P asks for a cut-off below pi/M; its own filter at 50 rad/s keeps that and still makes 1.25 % at worst."
    )
    columns = ("decimator", "curve", "frequency_hz_or_time_s", "gain_or_percent")
    return FigurePage("decimators", "Which decimator creates energy", caption, figure, FigureTable(columns, rows))
