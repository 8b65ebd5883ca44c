"""Processors of their own for the two sides of a live benchmark."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from cogrip.protocol.io.realtime import engage, release


@contextmanager
def two_processors(console: Console) -> Iterator[tuple[int | None, int | None]]:
    """This process stays on the first while inside; the second is the server's. None where there is no choice."""
    if sys.platform != "linux" or len(allowed := sorted(os.sched_getaffinity(0))) < 2:
        console.print("there is but one processor to choose: people and server share it, and the numbers are worse")
        yield None, None
        return
    os.sched_setaffinity(0, {allowed[0]})
    measures = engage()
    try:
        yield allowed[0], allowed[-1]
    finally:
        release(measures)
        os.sched_setaffinity(0, allowed)
