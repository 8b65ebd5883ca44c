"""Cases of a parametrized test that only `--all` runs."""

from collections.abc import Iterable
from typing import Any

import pytest


def long(*values: Any) -> Any:
    """Return a case that is run with `--all` alone."""
    return pytest.param(*values, marks=pytest.mark.long)


def every(step: int, cases: Iterable[Any]) -> list[Any]:
    """Return all cases, of which the first, and each `step`-th after it, are run without `--all`."""
    return [
        case if number % step == 0 else long(*(case if isinstance(case, tuple) else (case,)))
        for number, case in enumerate(cases)
    ]
