"""Ending a loop from outside: a flag that signals set and loops read once a tick."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType


@dataclass(slots=True)
class Stop:
    """`reason` is "" until the loop should end."""

    reason: str = ""
    signals: int = 0


@contextmanager
def on_signals(stop: Stop) -> Iterator[Stop]:
    """While inside, Ctrl-C and SIGTERM set `stop`; a third one breaks whatever hangs."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop.signals += 1
        stop.reason = stop.reason or ("interrupted" if number == signal.SIGINT else "terminated")
        if stop.signals >= 3:
            raise KeyboardInterrupt

    before = [(number, signal.signal(number, handle)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        yield stop
    finally:
        for number, handler in before:
            signal.signal(number, handler)
