"""Verdict of a comparison of methods on cogrip's own."""

from collections.abc import Mapping
from typing import Any

OURS = ("wave", "tuned")


def ours_failed(summary: Mapping[str, Any]) -> bool:
    """Return whether cogrip's own method diverged or oscillated anywhere, or gave out energy that had not been put in."""
    return any(
        row["method"] in OURS and (row["diverged"] or row["oscillates"] or row["not_passive"])
        for row in summary["rows"]
    )
