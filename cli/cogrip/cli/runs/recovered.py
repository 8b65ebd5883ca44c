"""Recovery of a run's recordings that were not closed, before the run is opened."""

from pathlib import Path

from rich.console import Console

from cogrip.machine.addition import add_integers
from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.recording.folder import recordings_of
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.recover import Recovered, is_closed
from cogrip.protocol.recording.recover import recover as recover_recording


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
