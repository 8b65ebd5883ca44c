"""`cogrip recover`: recover what is whole of a recording that was cut short or damaged."""

from pathlib import Path

from rich.console import Console

from cogrip.cli.runs.run_folder import RUNS, found_run
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import RunsBelow
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.addition import add_integers
from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.recording.folder import recordings_of
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.recover import Recovered, is_closed
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


def recover_unclosed(path: Path, console: Console) -> None:
    """Recover a run's recordings that were not closed, before it is opened, and say what was saved."""
    for each in recordings_of(path):
        if is_closed(each) or is_being_written(each):
            continue
        try:
            console.print(f"note: {words(each, recover_recording(each))}")
        except FileExistsError:
            pass  # it was recovered before, and this file was named by itself
        except RecordingError:
            continue  # the caller reports it on opening
        except OSError as error:
            console.print(f"note: {each.name} was not closed; it is read as it is ({error.strerror})")


def words(file: Path, saved: Recovered) -> str:
    """Return what was saved, in a sentence."""
    lost = add_integers(damage.length for damage in saved.damage)
    left = f"; {lost} bytes could not be read" if lost else ""
    return f"{file.name} was not closed: {saved.messages} messages over {saved.seconds:.3f} s are saved in {saved.path}{left}"
