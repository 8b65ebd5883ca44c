"""`cogrip recover`: recover what is whole of a recording that was cut short or damaged."""

from pathlib import Path

from cogrip.cli.runs.recovered import words
from cogrip.cli.runs.run_folder import RUNS, found_run
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import RunsBelow
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.recording.folder import recordings_of
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.recover import is_closed
from cogrip.protocol.recording.recover import recover as recover_recording


def recover(file: Path, /, *, runs: RunsBelow = RUNS) -> int:
    """Write what is whole of a recording into a new file beside it; the old one is kept.

    Parameters
    ----------
    file
        A .mcap file; of a run folder, or its name in `runs` (--runs), every recording in it that was not closed.
    """
    console = make_console(soft_wrap=True)
    file = found_run(file, runs)
    with BadInput.of_files(file, RecordingError):
        if file.is_dir():
            found = recordings_of(file)
            if not found:
                raise BadInput(f"{file} holds no recording; name a run folder or a .mcap file")
            broken = [each for each in found if not is_closed(each)]
            if not broken:
                console.print(f"{file}: every recording was closed; there is nothing to recover")
        else:
            broken = [file]
        for each in broken:
            if is_being_written(each):
                raise Problem(f"{each} is still being written; end its session first")
            try:
                console.print(words(each, recover_recording(each)))
            except FileExistsError as error:
                raise BadInput(f"{error.filename} exists already; remove it to recover anew") from None
    return 0
