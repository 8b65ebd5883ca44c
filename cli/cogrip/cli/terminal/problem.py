"""Errors a person can do something about, each printed as one line without a traceback."""


class Problem(Exception):  # noqa: N818 (what a person reads, not what a program broke)
    """The thing, the value, the bound, the cure."""

    exit_code = 1


class BadInput(Problem):
    """What was asked for cannot be done as asked."""

    exit_code = 2
