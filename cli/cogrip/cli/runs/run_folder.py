"""Run folders: made by the time it is here and now, opened when somebody names one, and left with summary and report."""

import difflib
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.recording.reader import RecordingError
from cogrip.results.reading.folder import make_run_folder, write_summary

if TYPE_CHECKING:
    from cogrip.results.reading.records import RunRecords

RUNS = Path("runs")  # folder where commands leave runs, and look for their names


def new_run_folder(base: Path, name: str) -> Path:
    """Make a new folder below `base`. Raises BadInput where none can be made."""
    try:
        return make_run_folder(base, name, datetime.now(UTC).astimezone())
    except OSError as error:
        raise BadInput(f"--runs {base}: no folder can be made there: {error.strerror}; name another") from None


def live_run_folder(base: Path, name: str, say: Callable[[str], None]) -> Path | None:
    """Do as `new_run_folder`; where none can be made warn and return None: a session goes on without its files."""
    try:
        return new_run_folder(base, name)
    except BadInput as problem:
        say(f"warning: this session is not recorded and leaves no report: {problem}")
        return None


def found_run(run: Path, runs: Path) -> Path:
    """Return `run`, or what has that name below `runs` where there is no such path. Raises BadInput for neither."""
    for path in (run, runs / run):
        if path.exists():
            return path
    raise BadInput(f"{run}: there is no such run{nowhere(str(run), runs)}")


def nowhere(name: str, runs: Path) -> str:
    """Return where a run was looked for, the nearest name there, and the cure; to stand behind "no such run"."""
    known: list[str] = []
    with suppress(OSError):
        known = sorted((folder.name for folder in runs.iterdir() if folder.is_dir()), reverse=True)  # newest first
    name = Path(name).name
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5) or [each for each in known if name in each]
    hint = f"did you mean {near[0]}? " if near else ""
    return f", neither here nor in {runs}; {hint}`cogrip runs{'' if runs == RUNS else f' {runs}'}` lists them"


def opened(run: Path, runs: Path) -> "RunRecords":
    """Return the recordings of a `found_run`, those that were cut short recovered first. Raises BadInput."""
    from cogrip.cli.runs.recovered import recover_unclosed  # readers of recordings, which no live session needs
    from cogrip.results.reading.records import open_run

    path = found_run(run, runs)
    with BadInput.of_files(path, RecordingError):
        recover_unclosed(path, make_console(stderr=True, soft_wrap=True))
        return open_run(path)


def leave_files(folder: Path | None, summary: dict[str, Any], console: Console, *, shown: bool, report: bool) -> bool:
    """Write summary and report of a live session. A file that cannot be written is a warning, and False is returned."""
    if shown:
        from cogrip.cli.runs.summary_table import terminal_summary

        console.print(terminal_summary(summary))
    if folder is None:
        return True
    try:
        write_summary(folder, summary)
        if report:
            from cogrip.results.report.page import write_report

            console.print(f"report: {write_report(folder)}")
    except OSError as error:
        console.print(f"warning: {error.filename or folder}: {error.strerror}; the summary above is all that is left")
        return False
    except ValueError as error:  # an implausible account of the other end: no other room loses its files by it
        console.print(f"warning: {folder}: {error}; what was written before stands there")
        return False
    return True
