"""Errors a person can do something about, each printed as one line without a traceback; and checks of numbers."""

from collections.abc import Iterator
from contextlib import contextmanager

from cogrip.protocol.settings.errors import expects


class Problem(Exception):  # noqa: N818 (what a person reads, not what a program broke)
    """An error of the environment: its text names the thing, the value, the bound and the cure."""

    exit_code = 1

    @classmethod
    @contextmanager
    def of(cls, *errors: type[Exception], where: str = "") -> Iterator[None]:
        """Raise this in place of `errors` that are raised inside, with their text behind `where`."""
        try:
            yield
        except errors as error:
            raise cls(f"{where}{error}") from None

    @classmethod
    @contextmanager
    def of_files(cls, path: object, *errors: type[Exception], doing: str = "") -> Iterator[None]:
        """Raise this in place of an OSError, with its file, else `path`; and in place of `errors`, with their text."""
        with cls.of(*errors):
            try:
                yield
            except OSError as error:
                words = f"{error.filename or path}: {doing}{error.strerror}" if error.strerror else str(error)
                raise cls(words) from None


class BadInput(Problem):
    """A request that cannot be carried out as it was made."""

    exit_code = 2


def above_zero(flag: str, value: float | None) -> None:
    """Raise BadInput for a number that is not above 0, and finite."""
    if value is not None and not 0.0 < value < float("inf"):
        raise BadInput(expects(flag, "a number above 0", value))


def some_time(seconds: float | None, to: str) -> None:
    """Raise BadInput for a time [s] to do something that is not above 0, and finite."""
    if seconds is not None and not 0.0 < seconds < float("inf"):
        raise BadInput(f"--seconds {seconds:g} is no time to {to}: give more than 0, or leave it out")


def at_least_one(flag: str, value: int | None) -> None:
    """Raise BadInput for a count that is below 1."""
    if value is not None and value < 1:
        raise BadInput(f"{flag} {value} must be at least 1")


def within(flag: str, value: int | float, least: float, most: float) -> None:
    """Raise BadInput for a number that is not from `least` to `most`."""
    if not least <= value <= most:
        raise BadInput(f"{flag} {f'{value:g}' if isinstance(value, float) else value} is outside {least} to {most}")
