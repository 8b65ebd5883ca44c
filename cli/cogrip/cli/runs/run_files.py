"""What a live session leaves when it ends: summary, report, and the words about them."""

from pathlib import Path
from typing import Any

from rich.console import Console

from cogrip.sim.runs.folder import write_summary


def leave_files(folder: Path | None, summary: dict[str, Any], console: Console, *, shown: bool, report: bool) -> None:
    """Write what can be written; what cannot is said, and changes nothing of how the session ended."""
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
    except ValueError as error:  # the other end's account may be strange: no other room loses its files by it
        console.print(f"warning: {folder}: {error}; what was written before stands there", markup=False)
