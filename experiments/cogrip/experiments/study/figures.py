"""Figures of a study: a measure over conditions, a point a group, and the mean of all with its 95 % confidence interval.

Of each group (often of one person) the mean over trials counts once within a condition; practice is left out. People on
different seats may do different things, so each seat has a panel. The interval is Student's t over groups;
a single one has none.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import stdtrit  # type: ignore[import-untyped]

from cogrip.experiments.study.study_file import BASE, Study
from cogrip.experiments.study.table import Row, StudyTable
from cogrip.machine.addition import add_floats
from cogrip.results.measures.registry import MEASURES, Measure
from cogrip.results.plots.style import FAINT, INK, Sheet, Style, label, person_style, png, title

CONFIDENCE = 0.95
_SPREAD = 0.12  # width over which a condition's points are spread, to either side
_MOST_WORDS = 8  # most conditions whose names stand upright
_MOST_NAMED = 24  # most groups that the legend names
_AXIS_LENGTH = 80  # most characters of an axis label

Values = dict[str, dict[int, float]]
"""condition -> group, from 1 -> mean"""


def write_figures(table: StudyTable, folder: Path) -> Iterator[Path]:
    """Write a figure for each measure that there is, and yield its path; figures of before are replaced. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    for measure in MEASURES:
        values = by_seat(table, measure)
        if values:
            path = folder / f"{measure.name}.png"
            path.write_bytes(png(draw(table.study, measure, values)))
            yield path


def by_seat(table: StudyTable, measure: Measure) -> dict[int, Values]:
    """Return the means of each seat that has some: seats have tasks of their own, and are not pooled.

    Seat 0 stands for all where a measure is shared, or the other of two has the opposite.
    """
    seats = sorted({row["seat"] for row in table.rows})
    if measure.shared or (measure.opposite and len(seats) == 2):
        seats = [0]
    found = {seat: by_condition(table.rows, measure, seat) for seat in seats}
    names = list(table.study.conditions) or [BASE]
    return {seat: {name: one[name] for name in names if name in one} for seat, one in found.items() if one}


def by_condition(rows: Sequence[Row], measure: Measure, seat: int = 0) -> Values:
    """Return the mean of each group's person on that seat in each condition."""
    found: dict[str, dict[int, list[float]]] = {}
    for row in rows:
        value = row.get(measure.name)
        if value is not None and not row["practice"] and row["seat"] == seat:
            found.setdefault(row["condition"], {}).setdefault(row["group"], []).append(value)
    return {
        name: {group: add_floats(all_of) / len(all_of) for group, all_of in one.items()} for name, one in found.items()
    }


def interval(values: Sequence[float]) -> tuple[float, float | None]:
    """Return mean and half the width of its confidence interval; None for a single value, of which nothing is known."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, None
    error = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return mean, float(stdtrit(len(values) - 1, 0.5 + 0.5 * CONFIDENCE)) * float(error)


def draw(study: Study, measure: Measure, seats: Mapping[int, Values]) -> Figure:
    """Draw one measure, a panel a seat."""
    groups = study.groups()
    sheet = Sheet(1, len(seats), row_in=3.2)
    drawn = sorted({group for values in seats.values() for one in values.values() for group in one})
    for panel, (seat, values) in zip(sheet.panels[0], seats.items(), strict=True):
        _draw_seat(panel, values, drawn)
        if max(map(len, groups)) > 1 and not measure.shared:
            title(panel, f"seat {seat}")
    named = drawn if len(drawn) <= _MOST_NAMED else []
    legend = [(_called(groups[group - 1], group), {**person_style(group - 1), "lw": 0.6}) for group in named]
    if not named:
        legend.append(("a participant or group", {"color": FAINT, "marker": "o", "lw": 0.6}))
    counts = [len(one) for values in seats.values() for one in values.values()]
    mean: Style = {"color": INK, "marker": "_", "ms": 14, "lw": 1.6}
    if max(counts) > 1:
        legend.append(("mean, 95 % confidence", mean))
    if min(counts) < 2:
        legend.append(("one value, no interval", {**mean, "lw": 0.0}))
    return sheet.finish(axis_of(study), [measure.label], legend)


def axis_of(study: Study) -> str:
    """Return the words under the conditions: the study's own, else the settings that tell these apart."""
    if study.axis:
        return label(study.axis, _AXIS_LENGTH)
    keys = dict.fromkeys(key for name in study.conditions for key in study.changes(name))
    return label(f"condition: {', '.join(keys)}", _AXIS_LENGTH) if keys else "condition"


def _called(people: Sequence[str], group: int) -> str:
    """Return a group's words in the legend; one person alone goes by the name."""
    return label(people[0]) if len(people) == 1 else f"group {group}: {label(', '.join(people))}"


def _draw_seat(panel: Axes, values: Values, groups: Sequence[int]) -> None:
    for number, group in enumerate(groups):
        shift = _SPREAD * (2.0 * number / (len(groups) - 1) - 1.0) if len(groups) > 1 else 0.0
        points = [(place + shift, one[group]) for place, one in enumerate(values.values()) if group in one]
        if points:
            panel.plot(*zip(*points, strict=True), lw=0.6, alpha=0.7, **person_style(group - 1))
    for place, one in enumerate(values.values()):
        mean, half = interval(list(one.values()))
        panel.errorbar(place, mean, half, color=INK, marker="_", ms=18, capsize=6, lw=1.6, zorder=5)
    panel.set_xlim(-0.5, len(values) - 0.5)
    turned: dict[str, Any] = {"rotation": 30, "ha": "right"} if len(values) > _MOST_WORDS else {}
    panel.set_xticks(range(len(values)), [label(name) for name in values], **turned)
