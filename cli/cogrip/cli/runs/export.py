"""`cogrip export`: a run as tables, a bag of ROS 2 or a layout for Foxglove; a study as a data set of BIDS."""

from pathlib import Path
from typing import Literal

from cogrip.cli.runs.run_folder import RUNS, found_run, opened
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import RunsBelow
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.experiments.study.bids import write_bids
from cogrip.experiments.study.study_file import StudyError
from cogrip.experiments.study.table import read_table
from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.recording.folder import recordings_of
from cogrip.results.reading.bag import export_bag
from cogrip.results.reading.export import ExportError
from cogrip.results.reading.export import export as export_run
from cogrip.results.reading.traces import losses
from cogrip.view.foxglove_layout import export_layout

To = Literal["csv", "parquet", "rosbag2", "foxglove", "bids"]
_NO_BAG_OF = "there is no bag of {what}; export --to csv has them, or say it again once the run has ended"


def export(
    run: Path,
    /,
    *,
    to: To,
    out: Path | None = None,
    datagrams: bool = False,
    runs: RunsBelow = RUNS,
) -> int:
    """Write a run as tables, a bag of ROS 2 or a layout for Foxglove; a study as BIDS.

    Tables: a file for each end and kind of message, such as client-anna.tick.csv. `time_s` stands first, in seconds of the run;
    vectors are spread over columns (position_m_x), accounts too (link_up_lost, ticks_late_us_p99); unknown values are empty.
    A number in a CSV file reads back as the very same bits.
    Nothing is overwritten. Of a run that still goes on the tables are called client-anna.tick.partial.csv; the next export
    replaces them.

    Parameters
    ----------
    run
        Run folder, or its name in `runs` (--runs), or one .mcap file; for bids the folder of a study, such as studies/fitts.
    to
        Format; parquet and rosbag2 need the extras of the same name. A bag of ROS 2 is the folder rosbag2. foxglove: a file,
        layout.json, for Foxglove and Lichtblick, which open the recordings as they are. A data set of BIDS is the folder bids:
        people as sub-01, sub-02 ..., motion data, events, measures and answers.
    out
        Folder for them; else the run's own.
    datagrams
        Export the datagrams too, as hexadecimal text.
    """
    if to == "bids":
        return _export_study(run, out)
    path = found_run(run, runs)
    with BadInput.of_files(path):
        goes_on = any(map(is_being_written, recordings_of(path)))  # asked before it is read: it may end meanwhile
    records = opened(run, runs)
    console, errors = make_console(soft_wrap=True), make_console(stderr=True, soft_wrap=True)
    into = out or records.folder
    with Problem.of_files(into, doing="cannot be written: "), errors.status("exporting"), BadInput.of(ExportError):
        if to == "rosbag2":
            if goes_on or datagrams:
                raise ExportError(_NO_BAG_OF.format(what="datagrams" if datagrams else "a run that still goes on"))
            tables, what = export_bag(records, into), "message"
        elif to == "foxglove":
            tables, what = export_layout(records, into), "line"
        else:
            tables, what = export_run(records, to, into, datagrams=datagrams, partial=goes_on), "row"
    for path, rows in tables:
        console.print(f"{path}: {rows} {what}{'' if rows == 1 else 's'}")
    if goes_on:
        errors.print(
            f"note: {run} still goes on: these tables are what was there just now, and another export replaces them"
        )
    ends = [*records.clients.values(), *([records.server] if records.server else [])]
    for note in [*records.notes, *(note for end in ends for note in losses(end))]:
        errors.print(f"warning: {note}")
    return 0


def _export_study(study: Path, out: Path | None) -> int:
    """Write a study as a data set of BIDS. Returns the exit code."""
    console, errors = make_console(soft_wrap=True), make_console(stderr=True, soft_wrap=True)
    into = out or study / "bids"
    with BadInput.of(StudyError), errors.status("measuring") as status:
        table = read_table(study, lambda done, total: status.update(f"measuring trial {done + 1} of {total}"))
    if not table.rows:
        raise Problem(f"{study}: no trial is finished yet; `cogrip study` runs them")
    with Problem.of_files(into, doing="cannot be written: "), errors.status("exporting"), BadInput.of(ExportError):
        written = write_bids(study, table, into)
    console.print(f"{into}: {written.people} participants, {written.sessions} runs of motion data")
    for note in written.notes:
        errors.print(f"warning: {note}")
    return 0
