"""`cogrip merge`: the recordings of one run from several machines, in one folder and on one clock."""

from pathlib import Path

from cogrip.cli.runs.run_folder import RUNS, found_run
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import RunsBelow
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.recording.reader import RecordingError
from cogrip.results.writing.merge import merge as merge_recordings


def merge(*folders: Path, out: Path, runs: RunsBelow = RUNS) -> int:
    """Merge the recordings of one run from several machines: the server's and those of its clients, on one clock.

    Parameters
    ----------
    folders
        Run folders, their names in `runs` (--runs), or .mcap files of the server and of each client.
    out
        The new folder.
    """
    console = make_console(soft_wrap=True)
    if len(folders) < 2:
        raise BadInput("merge: name at least two folders, the server's and a client's")
    found = [found_run(folder, runs) for folder in folders]
    with BadInput.of_files(out, RecordingError):
        try:
            alignments = merge_recordings(found, out)
        except FileExistsError:
            raise BadInput(f"--out {out} exists already; name a new folder") from None
    for each in alignments:
        bound_ms = (each.most_ns - each.least_ns) * 0.5e-6
        console.print(
            f"{each.file}: {each.add_ns * 1e-6:+z.3f} ms to the server's clock, by {each.by} "
            f"(datagrams bound it to ±{bound_ms:.1f} ms)"
        )
    console.print(f"merged: {out}; see `cogrip report {out}`")
    return 0
