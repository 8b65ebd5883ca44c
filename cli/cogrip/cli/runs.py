"""`cogrip runs`: what was run, newest first."""

import os
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from cogrip.cli.json_answer import Json, write_json
from cogrip.cli.problem import BadInput
from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.messages import shown
from cogrip.sim.run_list import ListedRun, list_runs

_TONES = {"good": ("✓", "green"), "warn": ("!", "yellow"), "bad": ("✗", "red")}
_MOST_NAMES = 3  # more people are counted only
_HEADINGS = ("run", "when", "seconds", "people", "size", "", "verdict")
_RIGHT = ("seconds", "size")
_MOST_WIDE = 200  # where it is not shown on a terminal: no line is cut in two


def runs(folder: Path = Path("runs"), /, *, json: Json = None) -> int:
    """List the runs in a folder, newest first, each with its verdict. Exit code 0 whatever the verdicts.

    Parameters
    ----------
    folder
        The folder that holds the runs' own folders.
    """
    if not folder.is_dir():
        raise BadInput(f"{folder}: there is no such folder; name the one that holds your runs, or make a run first")
    try:
        found = list_runs(folder, is_being_written)
    except OSError as error:
        raise BadInput(f"{error.filename or folder}: cannot be read: {error.strerror}") from None
    if json:
        write_json({"folder": str(folder), "runs": [_record(run) for run in found]}, json)
        return 0
    if found:
        console = Console(highlight=False)
        if not console.is_terminal and "COLUMNS" not in os.environ:
            console.width = _MOST_WIDE
        console.print(_table(found))
    else:
        Console(stderr=True, highlight=False).print(f"no runs in {folder}", markup=False)
    return 0


def _table(found: list[ListedRun]) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for heading in _HEADINGS:
        # of a narrow terminal the verdict takes what is left, on several lines where it must
        wraps = heading == "verdict"
        table.add_column(heading, justify="right" if heading in _RIGHT else "left", no_wrap=not wraps, overflow="fold")
    for run in found:
        mark, tint = _TONES[run.tone]
        table.add_row(
            Text(shown(run.name)),
            Text(f"{run.when:%Y-%m-%d %H:%M}"),
            Text("-" if run.seconds is None else f"{run.seconds:.1f}"),
            Text(shown(", ".join(run.people)) if len(run.people) <= _MOST_NAMES else f"{len(run.people)} people"),
            Text(_size(run.size_bytes)),
            Text(mark, style=tint),
            Text(run.verdict, style="bold red" if run.tone == "bad" else ""),
        )
    return table


def _size(size_bytes: float) -> str:
    for unit in ("B", "kB", "MB"):
        if size_bytes < 999.5:  # three digits, rounded
            return f"{size_bytes:.3g} {unit}"
        size_bytes /= 1000.0
    return f"{size_bytes:.3g} GB"


def _record(run: ListedRun) -> dict[str, Any]:
    return {
        "run": run.name,
        "folder": str(run.folder),
        "when": run.when.isoformat(),
        "seconds": run.seconds,
        "people": list(run.people),
        "tone": run.tone,
        "verdict": run.verdict,
        "size_bytes": run.size_bytes,
    }
