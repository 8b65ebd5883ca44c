"""A run folder named by the time it is here and now."""

from datetime import UTC, datetime
from pathlib import Path

from cogrip.cli.problem import BadInput
from cogrip.sim.run_folder import make_run_folder


def new_run_folder(base: Path, name: str) -> Path:
    """A new folder below `base`. Raises BadInput where none can be made."""
    try:
        return make_run_folder(base, name, datetime.now(UTC).astimezone())
    except OSError as error:
        raise BadInput(f"--runs {base}: no folder can be made there: {error.strerror}; name another") from None
