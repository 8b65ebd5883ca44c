"""Waiting in tests for what another thread or process does."""

import time
from collections.abc import Callable

import pytest

LIMIT_S = 60.0  # for anything that is waited for


def until(condition: Callable[[], object]) -> None:
    """Call it until it is true."""
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > end_s:
            pytest.fail("it never came true")
        time.sleep(0.001)
