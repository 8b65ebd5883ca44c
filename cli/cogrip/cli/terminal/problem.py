"""Errors a person can do something about, each printed as one line without a traceback."""

from collections.abc import Iterator
from contextlib import contextmanager


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


class BadInput(Problem):
    """A request that cannot be carried out as it was made."""

    exit_code = 2
