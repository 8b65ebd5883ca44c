"""Processors of their own for the two sides of a live benchmark."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from cogrip.machine.realtime import engage, release

from tests.bench import machine


@contextmanager
def two_processors(console: Console) -> Iterator[tuple[int | None, int | None]]:
    """This process stays on the first while inside; the second is the server's. None where there is no choice."""
    allowed = machine.processors()
    if len(allowed) < 2:
        console.print("there is but one processor to choose: people and server share it, and the numbers are worse")
        yield None, None
        return
    machine.pin(0, {allowed[0]})
    measures = engage()
    try:
        yield allowed[0], allowed[-1]
    finally:
        release(measures)
        machine.pin(0, set(allowed))
