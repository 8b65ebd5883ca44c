"""Opening a recorded run that somebody named."""

from pathlib import Path

from cogrip.cli.runs.recover import recover_what_was_cut
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.recording.reader import RecordingError
from cogrip.sim.runs.records import RunRecords, open_run


def opened(path: Path) -> RunRecords:
    """The run's recordings, those that were cut short recovered first. Raises BadInput."""
    try:
        recover_what_was_cut(path, make_console(stderr=True, soft_wrap=True))
        return open_run(path)
    except (RecordingError, FileNotFoundError) as error:
        raise BadInput(str(error)) from None
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None
