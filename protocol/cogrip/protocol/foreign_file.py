"""The error of a file that somebody else may have written: settings, scenes, worlds, traces, recordings."""


class ForeignFileError(Exception):
    """A file of others that cannot be used. The text is one line: which file, and why. No command shows a traceback of it."""
