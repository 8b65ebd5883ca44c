"""Limit on the time that another author's world may take: a signal ends the call, in the main thread, which alone gets it."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from cogrip.server.io.platform import alarm
from cogrip.server.worlds.guarded import TooLongError

CALL_LIMIT_S = 0.25  # other rooms wait for so long, once


@contextmanager
def call_limit() -> Iterator[None]:
    """Raise TooLongError in what runs inside after CALL_LIMIT_S, and again as often as it goes on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with alarm(CALL_LIMIT_S, _end):
        yield


def _end(number: int, frame: FrameType | None) -> None:
    raise TooLongError
