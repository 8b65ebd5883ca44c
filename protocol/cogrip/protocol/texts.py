"""Texts of the other end and of files: cut to length, and shown without doing anything to a terminal or page."""

from collections.abc import Sequence
from typing import Any

TEXT_BYTES = 300  # longest text: senders cut it to this
MARK_BYTES = 80  # longest text of a marker: senders cut it to this
MOST_NAMED = 20  # most names in a line


def clipped(text: str, most: int = TEXT_BYTES) -> str:
    """Return `text` cut to `most` bytes of UTF-8."""
    return text.encode("utf-8", "replace")[:most].decode("utf-8", "ignore")


def shown(text: str) -> str:
    """Return a text of the other end with control characters, line ends and changes of the writing direction escaped: nothing
    in it moves a cursor, turns the text beside it, or looks like a line of ours."""
    return "".join([each if each.isprintable() else each.encode("unicode_escape").decode() for each in text])


def clipped_mark(text: str) -> str:
    """Return a marker's text as it is sent: one line of at most MARK_BYTES."""
    return clipped(shown(text.strip()), MARK_BYTES)


def all_shown(value: Any) -> Any:
    """Return a table from a foreign file with every text in it escaped as by `shown`. Raises RecursionError."""
    if isinstance(value, str):
        return shown(value)
    if isinstance(value, dict):
        return {shown(key) if isinstance(key, str) else key: all_shown(item) for key, item in value.items()}
    if isinstance(value, list):
        return [all_shown(item) for item in value]
    return value


def named(names: Sequence[str]) -> str:
    """Return the names of the first of them, and how many more there are."""
    more = len(names) - MOST_NAMED
    return f"{', '.join(names[:MOST_NAMED])}{f' and {more} more' if more > 0 else ''}"
