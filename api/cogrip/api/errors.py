"""The error of this package."""

from collections.abc import Iterator
from contextlib import contextmanager

from cogrip.cli.terminal.problem import Problem
from cogrip.client.io.paths import JoinError
from cogrip.devices.device import DeviceError
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.settings.table import SettingsError
from cogrip.server.admission.tokens import TokenError
from cogrip.server.io.state_folder import StateError


class ApiError(ValueError):
    """Something that the caller can mend. Its text names the thing, the value, the bound and the cure."""


@contextmanager
def as_api_error() -> Iterator[None]:
    """Raise ApiError in place of the errors that commands print."""
    try:
        yield
    except (
        Problem,
        SettingsError,
        DeviceError,
        JoinError,
        RecordingError,
        StateError,
        TokenError,
        FileNotFoundError,
    ) as error:
        raise ApiError(str(error)) from error
