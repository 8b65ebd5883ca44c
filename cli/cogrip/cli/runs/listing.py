"""`cogrip runs`: the recorded runs, newest first."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.cells import cell_len
from rich.text import Text

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import padded, shortened
from cogrip.machine.addition import add_integers
from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.texts import shown
from cogrip.results.listing.listing import ListedRun, list_runs
from cogrip.results.verdict.judgement import Tone

_TONES: dict[Tone, tuple[str, str]] = {"good": ("✓", "green"), "warn": ("!", "yellow"), "bad": ("✗", "red")}
_HEADINGS = ("run", "age", "kind", "people", "verdict", "length", "size")
"""Headings of columns; the last ones are left out first."""
_RIGHT = ("age", "length", "size")
_KEPT = 5  # number of columns that every terminal shows
_NAME_WIDTH = 32  # width that a run's name keeps as columns are left out: a time and a short name
_PEOPLE_WIDTH = 12  # width of people's names; those who find no room are counted
_PIPED_WIDTH = 200  # width of the table where it is not shown on a terminal
_AGES = ((60.0, "s"), (60.0, "min"), (24.0, "h"), (1000.0, "d"))  # units of age: how many of each make one of the next


def runs(
    folder: Path | None = None,
    /,
    *,
    below: Annotated[Path | None, Parameter(name="--runs")] = None,
    json: Json = None,
) -> int:
    """List the recorded runs, newest first.

    Each has its verdict in a word or two. Exit code 0 whatever the verdicts. `--json` has the whole verdict, the time, and
    all names.

    Parameters
    ----------
    folder
        The folder that holds the runs' own folders; else runs.
    below
        The same, as other commands take it.
    """
    if folder is not None and below is not None:
        raise BadInput(f"{folder} and --runs {below}: give one of them")
    folder = folder or below or Path("runs")
    if not folder.is_dir():
        raise BadInput(f"{folder}: there is no such folder; name the one that holds your runs, or make a run first")
    with BadInput.of_files(folder, doing="cannot be read: "):
        found = list_runs(folder, is_being_written)
    if json:
        write_json({"folder": str(folder), "runs": [_record(run) for run in found]}, json)
        return 0
    if found:
        console = make_console(soft_wrap=True, piped_width=_PIPED_WIDTH)
        for line in lines_of(found, console.width, datetime.now(UTC)):
            console.print(line)
    else:
        make_console(stderr=True).print(f"no runs in {folder}")
    return 0


def lines_of(found: Sequence[ListedRun], width: int, now: datetime) -> list[Text]:
    """Return a heading, then a line a run; a name that leaves no room for the rest has its own line, and is never cut."""
    rows = [_cells(run, now) for run in found]
    widths = [max(map(cell_len, column)) for column in zip(_HEADINGS, *rows, strict=True)]
    many = len(_HEADINGS)
    while many > _KEPT and add_integers(widths[1:many]) + many - 1 + min(widths[0], _NAME_WIDTH) > width:
        many -= 1
    widths[0] = max(len(_HEADINGS[0]), min(widths[0], width - add_integers(widths[1:many]) - many + 1))
    lines = [Text(_line(_HEADINGS, widths, many), style="dim")]
    for run, (name, *cells) in zip(found, rows, strict=True):
        if cell_len(name) > widths[0]:
            lines.append(Text(name))
            name = ""
        line = Text(_line((name, *cells), widths, many))
        mark, tint = _TONES[run.tone]
        begin = line.plain.rindex(f"{mark} {run.brief}")
        line.stylize(f"bold {tint}" if run.tone == "bad" else tint, begin, begin + len(mark))
        lines.append(line)
    return lines


def _line(cells: Sequence[str], widths: Sequence[int], many: int) -> str:
    columns = zip(_HEADINGS[:many], cells, widths, strict=False)
    return " ".join(padded(cell, width, right=heading in _RIGHT) for heading, cell, width in columns).rstrip()


def _cells(run: ListedRun, now: datetime) -> tuple[str, ...]:
    """Return the cells below _HEADINGS."""
    return (
        shown(run.name), age((now - run.when).total_seconds()), run.kind, _people(run.people),
        f"{_TONES[run.tone][0]} {run.brief}", "-" if run.seconds is None else _length(run.seconds), size(run.size_bytes),
    )  # fmt: skip


def _people(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are: `anna, ben +2`."""
    for many in range(len(names), 0, -1):
        more = f" +{len(names) - many}" if len(names) > many else ""
        text = shown(", ".join(names[:many]))
        if cell_len(text + more) <= _PEOPLE_WIDTH or many == 1:
            return shortened(text, _PEOPLE_WIDTH - len(more)) + more
    return "-"


def age(seconds: float) -> str:
    """Return an age in the largest unit of which there is one."""
    left = max(0.0, seconds)
    for many, unit in _AGES:
        if left < many:
            return f"{int(left)} {unit}"
        left /= many
    return "long ago"


def _length(seconds: float) -> str:
    """Return the length of a session in few digits."""
    if seconds >= 9999.5:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds:.1f} s" if seconds < 99.95 else f"{seconds:.0f} s"


def size(size_bytes: float) -> str:
    """Return a size with three digits."""
    for unit in ("B", "kB", "MB"):
        if size_bytes < 999.5:  # three digits, rounded
            return f"{size_bytes:.3g} {unit}"
        size_bytes /= 1000.0
    return f"{size_bytes:.3g} GB"


def _record(run: ListedRun) -> dict[str, Any]:
    return {
        "run": run.name, "folder": str(run.folder), "kind": run.kind, "when": run.when.isoformat(), "seconds": run.seconds,
        "people": list(run.people), "tone": run.tone, "brief": run.brief, "verdict": run.verdict,
        "size_bytes": run.size_bytes,
    }  # fmt: skip
