"""One judgement of a run, and the seat sessions and names that its sentences speak of."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from cogrip.results.reading.summary_values import dig, earlier, name_of

Tone = Literal["good", "warn", "bad"]
UserValues = dict[str, Any]  # one user in `summary.json`


@dataclass(frozen=True, slots=True)
class Judgement:
    """One of three, in a sentence that gives its reasons; brief: the same in a line of a list, "" where there is no other."""

    name: Literal["passive", "stable", "felt as intended"]
    tone: Tone
    sentence: str
    brief: str = ""


def occupied(users: list[UserValues]) -> Iterator[UserValues]:
    """Yield every seat session from which something came: a seat that nobody took has nothing to tell."""
    for row in users:
        yield from earlier(row)
        empty = row.get("state") is None and not dig(row, "link", "received")
        if not (empty and dig(row, "energy", "up_margin_j") is None):
            yield row


def never_taken(row: UserValues) -> bool:
    """Return whether the server says that nobody took this seat: it received nothing, and made no line."""
    nothing = row.get("state") is None and dig(row, "link", "up", "received") == 0
    return nothing and all(dig(row, "energy", key) is None for key in ("up_margin_j", "line_margin_j"))


def names_of(rows: Iterable[UserValues]) -> list[str]:
    """Return each name once."""
    return list(dict.fromkeys(map(name_of, rows)))


def some(names: Iterable[str]) -> str:
    """Return a few of the names, and how many more there are."""
    names = list(names)
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
