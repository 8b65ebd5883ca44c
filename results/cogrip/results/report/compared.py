"""Several runs on one page: verdicts, settings that differ, numbers with their differences, curves laid over each other."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cogrip.results.comparison.differences import (
    RunDifference,
    check_comparable,
    differences_of_runs,
    labels_of,
    settings_differences,
)
from cogrip.results.reading.traces import TracedRun, load_run
from cogrip.results.report.page import about, picture, render_page, verdict_of
from cogrip.results.report.tables import Cell, ReportTable, TableRow, plain

KIND = "comparison"
_MARK = f'content="cogrip {KIND}"'
_MARK_WITHIN = 1000  # bytes of the page's head within which the mark stands


class ComparedRuns(NamedTuple):
    """The page, its numbers, which are differences to the first run, and what a reader has to know of them."""

    page: Path
    rows: list[RunDifference]
    notes: list[str]


def write_comparison(
    out: Path, folders: Sequence[Path], labels: Sequence[str] | None = None, notes: Sequence[str] = ()
) -> ComparedRuns:
    """Write the page on these run folders to `out`. notes: sentences that stand at its head.

    An earlier comparison at `out` is replaced. Raises FileExistsError for any other file there, FileNotFoundError for a
    folder that holds nothing of a run, ComparisonError, OSError.
    """
    if out.exists() and not is_comparison(out):
        raise FileExistsError(f"{out} exists and is no comparison of ours; remove it, or name another file")
    runs = [load_run(folder) for folder in folders]
    labels = labels or labels_of(folders)
    out.write_text(compare(runs, labels, notes), encoding="utf-8")
    return ComparedRuns(out, *differences_of_runs(runs, labels))


def is_comparison(path: Path) -> bool:
    """Return whether the head of a file says that `compare` wrote it."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return _MARK.encode() in file.read(_MARK_WITHIN)


def compare(runs: Sequence[TracedRun], labels: Sequence[str], notes: Sequence[str] = ()) -> str:
    """Return the page; differences are to the first run. Raises ComparisonError for runs that cannot be compared."""
    from matplotlib.colors import to_hex

    from cogrip.results.plots.compared import compared_plots, tints

    names = check_comparable(runs, labels)
    others = dict.fromkeys(name for run in runs for name in run.names if name not in names)
    heading = f"{len(runs)} runs compared"
    numbers, lengths = differences_of_runs(runs, labels, names)
    left_out = [f"Not in all runs, so left out: {', '.join(others)}."] if others else []
    return render_page(
        "comparison.html.j2",
        title=f"{heading}: cogrip",
        kind=KIND,
        heading=heading,
        notes=[*notes, *lengths, *left_out],
        runs=[
            {
                "label": label,
                "tint": to_hex(tint),
                "about": about(run, str(run.summary.get("name") or run.settings.get("name") or "nameless")),
                "verdict": verdict_of(run),
                "notes": run.notes,
            }
            for run, label, tint in zip(runs, labels, tints(len(runs)), strict=True)
        ],
        settings=_settings_table(runs, labels),
        numbers=_numbers_table(numbers, labels),
        pictures=[picture(plot.heading, plot.caption, plot.draw) for plot in compared_plots(runs, labels, names)],
    )


def _settings_table(runs: Sequence[TracedRun], labels: Sequence[str]) -> ReportTable | str:
    unknown = [label for run, label in zip(runs, labels, strict=True) if not run.settings]
    if unknown:
        return f"The settings of {', '.join(unknown)} are not known."
    rows = [
        TableRow(key, "", [
            Cell(plain(value, key.rpartition(".")[2]), f"text{'' if value == values[0] else ' changed'}")
            for value in values
        ])
        for key, values in settings_differences([run.settings for run in runs])
    ]  # fmt: skip
    return ReportTable(["", *labels], rows) if rows else "None."


def _numbers_table(found: Sequence[RunDifference], labels: Sequence[str]) -> ReportTable:
    rows: list[TableRow | str] = []
    who = None
    for each in found:
        if each.who != who:
            who = each.who
            rows.append(who or "object and run")
        first, *others = each.shown()
        cells = [Cell(first)]
        for number, text in enumerate(others, 1):
            cells += Cell(text), Cell(each.shown_change(number), "unit")
        rows.append(TableRow(each.quantity.what, each.quantity.unit, cells))
    return ReportTable(["", labels[0], *(head for label in labels[1:] for head in (label, "difference"))], rows)
