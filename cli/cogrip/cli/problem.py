"""Errors a person can do something about, each printed as one line without a traceback."""


class Problem(Exception):
    """The thing, the value, the bound, the cure."""

    exit_code = 1


class BadInput(Problem):
    """What was asked for cannot be done as asked."""

    exit_code = 2
