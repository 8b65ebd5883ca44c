"""A run folder named by the time it is here and now."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from cogrip.cli.terminal.problem import BadInput
from cogrip.sim.runs.folder import make_run_folder


def new_run_folder(base: Path, name: str) -> Path:
    """A new folder below `base`. Raises BadInput where none can be made."""
    try:
        return make_run_folder(base, name, datetime.now(UTC).astimezone())
    except OSError as error:
        raise BadInput(f"--runs {base}: no folder can be made there: {error.strerror}; name another") from None


def live_run_folder(base: Path, name: str, say: Callable[[str], None]) -> Path | None:
    """As `new_run_folder`; where none can be made that is said: a session goes on without its files."""
    try:
        return new_run_folder(base, name)
    except BadInput as problem:
        say(f"warning: this session is not recorded and leaves no report: {problem}")
        return None
