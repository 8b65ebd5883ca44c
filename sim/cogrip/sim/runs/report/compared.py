"""Several runs on one page: verdicts, settings that differ, numbers with their differences, curves laid over each other.

As in a single run's report every text is escaped, and there is nothing to fetch.
"""

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

from cogrip.sim.runs.comparison import Difference, check_comparable, differences, labels_of, settings_differences
from cogrip.sim.runs.report.page import Picture, about, figure, notes_list, page, picture, verdict_of
from cogrip.sim.runs.report.tables import plain, table
from cogrip.sim.runs.traces import Run, load_run

KIND = "comparison"
_MARK = f'content="cogrip {KIND}"'
_MARK_WITHIN = 1000  # bytes of the page's head


def write_comparison(
    out: Path, folders: Sequence[Path], labels: Sequence[str] | None = None
) -> tuple[Path, list[Difference]]:
    """The page on these run folders, at `out`, with the numbers in it; the first run is what the others are held against.

    A comparison of ours that stands there is replaced, as it can be made again. Raises FileExistsError for any other
    file, FileNotFoundError for a folder that holds nothing of a run, ComparisonError, OSError.
    """
    if out.exists() and not is_comparison(out):
        raise FileExistsError(f"{out} exists and is no comparison of ours; remove it, or name another file")
    runs = [load_run(folder) for folder in folders]
    out.write_text(compare(runs, labels or labels_of(folders)), encoding="utf-8")
    return out, differences([run.summary for run in runs])


def is_comparison(path: Path) -> bool:
    """Whether a file says in its head that `compare` wrote it."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return _MARK.encode() in file.read(_MARK_WITHIN)


def compare(runs: Sequence[Run], labels: Sequence[str]) -> str:
    """The page. Differences are against the first run. Raises ComparisonError for runs that cannot be compared."""
    from matplotlib.colors import to_hex

    from cogrip.sim.runs.plots.compared import tints

    names = check_comparable(runs, labels)
    marks = [f'<span class=run style="color:{to_hex(tint)}">■</span>' for tint in tints(len(runs))]
    heading = f"{len(runs)} runs compared"
    parts = [
        f"<h1>{heading}</h1>",
        f"<p class=about>{escape(f'Differences are against the first, {labels[0]}.')}</p>",
        notes_list(_left_out(runs, names)),
    ]
    for run, label, mark in zip(runs, labels, marks, strict=True):
        parts += [f"<h2>{mark} {escape(label)}</h2>", about(run, _name(run)), verdict_of(run), notes_list(run.notes)]
    parts += [
        "<h2>Settings that differ</h2>",
        _settings_table(runs, labels),
        "<h2>Numbers</h2>",
        _numbers_table(differences([run.summary for run in runs], names), labels),
        *map(figure, _draw(runs, labels, names)),
    ]
    return page(f"{heading}: cogrip", KIND, parts)


def _name(run: Run) -> str:
    return str(run.summary.get("name") or run.settings.get("name") or "nameless")


def _left_out(runs: Sequence[Run], names: Sequence[str]) -> list[str]:
    others = dict.fromkeys(name for run in runs for name in run.names if name not in names)
    return [f"Not in all runs, so left out: {', '.join(others)}."] if others else []


def _draw(runs: Sequence[Run], labels: Sequence[str], names: Sequence[str]) -> Iterator[Picture]:
    from cogrip.sim.runs.plots.compared import compared_plots

    for plot in compared_plots(runs, labels, names):
        yield picture(plot.heading, plot.caption, plot.draw)


def _settings_table(runs: Sequence[Run], labels: Sequence[str]) -> str:
    unknown = [label for run, label in zip(runs, labels, strict=True) if not run.settings]
    if unknown:
        return f"<p>The settings of {escape(', '.join(unknown))} are not known.</p>"
    rows = [
        f"<tr><th>{escape(row.key)}</th>"
        + "".join(_setting(row.key, value, changed=value != row.values[0]) for value in row.values)
        + "</tr>"
        for row in settings_differences([run.settings for run in runs])
    ]
    return table(["", *labels], rows) if rows else "<p>None.</p>"


def _setting(key: str, value: Any, *, changed: bool) -> str:
    return f"<td class='text{' changed' if changed else ''}'>{escape(plain(value, key.rpartition('.')[2]))}</td>"


def _numbers_table(rows: Sequence[Difference], labels: Sequence[str]) -> str:
    lines, who = [], None
    for row in rows:
        if row.who != who:
            who = row.who
            lines.append(f"<tr class=group><th>{escape(who or 'object and run')}</th></tr>")
        unit = f" <span class=unit>[{escape(row.quantity.unit)}]</span>" if row.quantity.unit else ""
        first, *others = row.shown()
        cells = f"<td>{escape(first)}</td>" + "".join(
            f"<td>{escape(text)}</td><td class=unit>{escape(row.shown_change(number))}</td>"
            for number, text in enumerate(others, 1)
        )
        lines.append(f"<tr><th>{escape(row.quantity.what)}{unit}</th>{cells}</tr>")
    head = ["", labels[0]]
    for label in labels[1:]:
        head += [label, "difference"]
    return table(head, lines)
