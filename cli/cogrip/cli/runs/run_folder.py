"""Run folders: made by the time it is here and now, opened when somebody names one, and left with summary and report."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.recording.reader import RecordingError
from cogrip.sim.runs.folder import make_run_folder, write_summary

if TYPE_CHECKING:
    from cogrip.sim.runs.records import RunRecords


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


def opened(path: Path) -> "RunRecords":
    """Return the run's recordings, those that were cut short recovered first. Raises BadInput."""
    from cogrip.cli.runs.recover import recover_unclosed  # readers of recordings, which no live session needs
    from cogrip.sim.runs.records import open_run

    with BadInput.of_files(path, RecordingError):
        recover_unclosed(path, make_console(stderr=True, soft_wrap=True))
        return open_run(path)


def leave_files(folder: Path | None, summary: dict[str, Any], console: Console, *, shown: bool, report: bool) -> None:
    """Write summary and report of a live session; a file that cannot be written is a warning and changes no exit code."""
    if shown:
        from cogrip.cli.runs.summary_table import terminal_summary

        console.print(terminal_summary(summary))
    if folder is None:
        return
    try:
        write_summary(folder, summary)
        if report:
            from cogrip.sim.runs.report.page import write_report

            console.print(f"report: {write_report(folder)}")
    except OSError as error:
        console.print(f"warning: {error.filename or folder}: {error.strerror}; the summary above is all that is left")
    except ValueError as error:  # an implausible account of the other end: no other room loses its files by it
        console.print(f"warning: {folder}: {error}; what was written before stands there")
