"""Magnitude-squared coherence and correlation of hands' velocities along the axis that moved most."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from cogrip.results.plots.spectra import correlation_near, cross_densities
from cogrip.results.plots.style import (
    AXIS_NAMES,
    FAINT,
    INK,
    LINES,
    Array,
    NotDrawnError,
    Sheet,
    Style,
    draw,
    label,
    person_style,
)
from cogrip.results.reading.summary_values import number as plain
from cogrip.results.reading.traces import MOST_PEOPLE, TracedRun

_MOST_PAIRS = 6
_HALF = 3  # number of pairs that are drawn dark
_HIGHEST_HZ = 20.0  # highest frequency that is shown: hands move below 10 Hz, what lies above is the devices
_SEGMENT_S = 2.0
_LEAST_S = 1.0
_LEAST_SEGMENTS = 4
_FURTHEST_LAG_S = 1.0
_STILL_MPS = 1e-6
_BETTER = 0.01  # least gain in correlation for which a lag is told


class Movement(NamedTuple):
    """Hands' velocities on one grid of time: rate [Hz], values shape (people, samples) [m/s], in the order of `numbers`."""

    rate_hz: float
    axis: int
    numbers: tuple[int, ...]
    values: Array


def movement(run: TracedRun) -> Movement:
    """Return the velocities of all who have a trace and moved, along the axis that moved most, while all were there."""
    found = [(number, run.clients[name]) for number, name in enumerate(run.names[:MOST_PEOPLE]) if name in run.clients]
    if len(found) < 2:
        raise NotDrawnError("it takes the traces of two people")
    start = max(float(trace.time_s[0]) for _, trace in found)
    end = min(float(trace.time_s[-1]) for _, trace in found)
    if end - start < _LEAST_S:
        raise NotDrawnError(f"the people have less than {_LEAST_S:g} s in common")
    rate_hz = float(min(trace.rate_hz for _, trace in found))
    velocities = [trace.columns["velocity_mps"] for _, trace in found]
    axis = int(np.argmax(np.sum([values.var(axis=0) for values in velocities], axis=0)))
    grid = start + np.arange(int((end - start) * rate_hz)) / rate_hz
    numbers, rows = [], []
    for (number, trace), velocity in zip(found, velocities, strict=True):
        values = np.interp(grid, trace.time_s, np.nan_to_num(velocity[:, axis]))
        if np.std(values) > _STILL_MPS:
            numbers.append(number)
            rows.append(values)
    if len(rows) < 2:
        raise NotDrawnError("fewer than two hands moved")
    return Movement(rate_hz, axis, tuple(numbers), np.array(rows))


def correlation(first: Array, second: Array, rate_hz: float) -> tuple[float, float, float]:
    """Return (Pearson's r, largest r within a second's lag, that lag [s]; positive: `second` moves later)."""
    first, second = (first - first.mean()) / first.std(), (second - second.mean()) / second.std()
    size = len(first)
    reach = min(size - 1, round(_FURTHEST_LAG_S * rate_hz))
    near = correlation_near(first, second, reach) / size
    best = int(np.argmax(near))
    return float(near[reach]), float(near[best]), (best - reach) / rate_hz


def coherence(run: TracedRun) -> Figure:
    """Draw the coherence of each pair by frequency, and below how much each hand moves there (Welch's method)."""
    moved = movement(run)
    rate_hz, values = moved.rate_hz, moved.values
    segment = int(min(_SEGMENT_S * rate_hz, values.shape[1] // _LEAST_SEGMENTS))
    sheet = Sheet(2, row_in=2.0)
    shared, power = sheet.panels[:, 0]
    legend: list[tuple[str, Style]] = []
    pairs = list(combinations(range(len(values)), 2))
    frequency, densities = cross_densities(values, rate_hz, segment)
    shown = (frequency > 0.0) & (frequency <= _HIGHEST_HZ)
    for index, (first, second) in enumerate(pairs[:_MOST_PAIRS]):
        with np.errstate(invalid="ignore"):  # not a number where neither hand has any power
            level = abs(densities[first, second]) ** 2 / (densities[first, first] * densities[second, second]).real
        style: Style = {"color": INK if index < _HALF else FAINT, "ls": LINES[index % _HALF], "lw": 1.8}
        shared.plot(frequency[shown], level[shown], **style)
        r, best, lag_s = correlation(values[first], values[second], rate_hz)
        names = [run.names[moved.numbers[each]] for each in (first, second)]
        text = f"{label(names[0])} and {label(names[1])}: r = {plain(r, digits=2)}"
        if best - r > _BETTER:
            text += f", {plain(best, digits=2)} with {label(names[lag_s > 0])} {abs(lag_s) * 1e3:.0f} ms later"
        legend.append((text, style))
    if len(pairs) > _MOST_PAIRS:
        legend.append((f"and {len(pairs) - _MOST_PAIRS} more pairs, not shown", {"alpha": 0.0}))
    independent = values.shape[1] // segment
    shared.axhline(1.0 - 0.05 ** (1.0 / (independent - 1)), color=FAINT, lw=1.2, ls=(0, (6, 3)))
    legend.append(("one in twenty by chance", {"color": FAINT, "ls": (0, (6, 3))}))
    for place, number in enumerate(moved.numbers):
        power.set_yscale("log")
        draw(power, frequency[shown], densities[place, place, shown].real * 1e6, **person_style(number), lw=1.5)
        legend.append((label(run.names[number]), {**person_style(number), "lw": 2.0}))
    shared.set_ylim(0.0, 1.03)
    shared.set_xlim(0.0, _HIGHEST_HZ)
    axis = AXIS_NAMES[moved.axis]
    return sheet.finish("frequency [Hz]", ["coherence [1]", f"power along {axis} [(mm/s)²/Hz]"], legend)
