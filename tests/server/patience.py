"""Waiting in tests for what another thread or process does."""

import time
from collections.abc import Callable

import pytest

from tests.fair_time import FairTime

LIMIT_S = 60.0  # for anything that is waited for, in time as the machine gives it


def until(condition: Callable[[], object]) -> None:
    """Call it until it is true."""
    given = FairTime()
    while not condition():
        if given.spent_s() > LIMIT_S:
            pytest.fail("it never came true")
        time.sleep(0.001)
