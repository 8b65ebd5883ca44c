"""Runs: made in virtual time, or read from a folder."""

import shutil
import tempfile
import weakref
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from cogrip.api import frames
from cogrip.api.errors import as_api_error
from cogrip.api.settings import Source, settings
from cogrip.cli.runs.run_folder import new_run_folder
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.columns import Array
from cogrip.results.reading.folder import SETTINGS, SUMMARY
from cogrip.results.reading.records import RunRecords
from cogrip.results.reading.records import open_run as open_records
from cogrip.results.report.page import write_report
from cogrip.results.verdict.verdict import succeeded
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.recorder import WHO, step_topic
from cogrip.sim.laboratory import Laboratory

OnFrame = Callable[[frames.Frame], None]


class Run:
    """A recorded session.

    folder      where its files are
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"

    @cached_property
    def _records(self) -> RunRecords:
        with as_api_error():
            return open_records(self.folder)

    @property
    def people(self) -> list[str]:
        """Names in the order of their seats."""
        return self._records.names()

    @cached_property
    def settings(self) -> Settings | None:
        """Settings of the session; None where neither the server's recording nor the settings file is there."""
        file = self.folder / SETTINGS
        return settings(file) if file.is_file() else self._records.settings()

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The summary (docs/summary.md); {} of a run that was cut short."""
        file = self.folder / SUMMARY
        return dict(msgspec.json.decode(file.read_bytes())) if file.is_file() else {}

    @property
    def good(self) -> bool:
        """True where it was stable and passive, devices included, and nothing broke off (docs/verdict.md)."""
        return bool(self.summary) and succeeded(self.summary)

    def columns(self, who: str | int, *names: str) -> dict[str, Array]:
        """Return what one end recorded as arrays.

        Parameters
        ----------
        who
            A person's name or seat number: their device's ticks. "server": the steps of the object, with a seat's fields
            under its person (`anna.proxy_m`).
        names
            Fields (docs/recordings.md); all of them if none is named.

        Returns a dict of name to array, shape (n,) or (n, axes), nan where a value is not known, and `time_s` [s] on one clock
        for all ends. Raises ApiError for a run without that recording, KeyError for an unknown person or field.
        """
        records = self._records
        with as_api_error():
            topic = step_topic(records.room()) if who == WHO else "tick"
            return records.end(who).columns(topic, *names)

    @property
    def markers(self) -> list[tuple[float, str]]:
        """Time [s] and text of every marker, on the clock of `columns`; who set it stands before the text."""
        with as_api_error():
            return self._records.markers()

    @property
    def triggers(self) -> list[tuple[float, int, str]]:
        """Time [s] of every write to the trigger line, on the clock of `columns`, its code and the words of its marker."""
        with as_api_error():
            return self._records.triggers()

    def report(self) -> Path:
        """Write the report with its plots into the folder, and return the page's path."""
        with as_api_error():
            return write_report(self.folder)


def open_run(folder: str | Path) -> Run:
    """Return the run in a folder, or in one recording. Raises ApiError where there is none."""
    found = Run(Path(folder))
    _ = found.people
    return found


def run(
    source: Source = "demo", *, folder: str | Path | None = None, on_frame: OnFrame | None = None, **changes: Any
) -> Run:
    """Run a session in virtual time with simulated people, and return what it recorded.

    Parameters
    ----------
    source, changes
        As of `settings`.
    folder
        Folder below which the run's own is made; None for a temporary one, which goes with the `Run`.
    on_frame
        Called with each network frame.

    Raises ApiError.
    """
    wanted = settings(source, **changes)
    if folder is None:
        into = Path(tempfile.mkdtemp(prefix="cogrip-run-"))
    else:
        with as_api_error():
            into = new_run_folder(Path(folder), wanted.name)

    def over(laboratory: Laboratory) -> bool:
        if on_frame:
            on_frame(frames.of_laboratory(laboratory))
        return False

    try:
        with as_api_error():
            run_laboratory(wanted, into, over=over)
    except BaseException:
        if folder is None:
            shutil.rmtree(into, ignore_errors=True)
        raise
    found = Run(into)
    if folder is None:
        weakref.finalize(found, shutil.rmtree, into, ignore_errors=True)
    return found
