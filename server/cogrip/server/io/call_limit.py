"""Limit on the time that another author's world may take: a signal ends the call, in the main thread, which alone gets it."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from cogrip.server.worlds.guarded import TooLongError

CALL_LIMIT_S = 0.25  # other rooms wait for so long, once


@contextmanager
def call_limit() -> Iterator[None]:
    """Raise TooLongError in what runs inside after CALL_LIMIT_S, and again as often as it goes on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, _end)
    signal.setitimer(signal.ITIMER_REAL, CALL_LIMIT_S, CALL_LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _end(number: int, frame: FrameType | None) -> None:
    raise TooLongError
