"""Verdict of a comparison of methods on cogrip's own, by the rows' `ours`: that a baseline fails is a result."""

from collections.abc import Mapping, Sequence
from typing import Any

from cogrip.results.verdict.judgement import some

Row = Mapping[str, Any]


def failed_of_ours(summary: Mapping[str, Any]) -> list[Row]:
    """Return the rows of cogrip's own methods in which a session diverged, oscillated or was not passive.

    Raises KeyError where a row does not say whose method it is, or what became of it.
    """
    return [
        row for row in summary["rows"] if row["ours"] and (row["diverged"] or row["oscillates"] or row["not_passive"])
    ]


def failure_sentence(failed: Sequence[Row]) -> str:
    """Return which rows failed, of which there is one at least, and how: `wave on wan, local on lte diverged`."""
    ways = {"diverged": "diverged", "oscillates": "oscillated", "not_passive": "was not passive"}
    seen = [words for key, words in ways.items() if any(row[key] for row in failed)]
    where = [f"{row['method']} on {row['network']}" for row in failed]
    return f"{some(where)} {' or '.join(seen)}"


def failed_methods(failed: Sequence[Row]) -> str:
    """Return the names of the methods that failed."""
    return some(dict.fromkeys(row["method"] for row in failed))
