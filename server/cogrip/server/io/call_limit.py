"""Limits on the time that another author's world may take: a signal ends the call, in the main thread, which alone gets it."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from cogrip.machine.server_platform import alarm
from cogrip.server.worlds.guarded import TooLongError

COMPUTE_LIMIT_S = 0.25  # longest processor time of a call: a busy machine, or one that stood still, ends no world
WAIT_LIMIT_S = 1.0  # longest time of a call by the clock: other rooms wait for so long, once
LOOKS = 5  # number of looks at both clocks within the shorter of the two limits


def too_long(computed_s: float, waited_s: float) -> bool:
    """Return whether a call that has taken this much processor time and clock time is to end."""
    return computed_s >= COMPUTE_LIMIT_S or waited_s >= WAIT_LIMIT_S


@contextmanager
def call_limit() -> Iterator[None]:
    """Raise TooLongError in what runs inside once it takes too long, and again as often as it goes on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    computed_s, begun_s = time.thread_time(), time.monotonic()

    def end(number: int, frame: FrameType | None) -> None:
        if too_long(time.thread_time() - computed_s, time.monotonic() - begun_s):
            raise TooLongError

    with alarm(min(COMPUTE_LIMIT_S, WAIT_LIMIT_S) / LOOKS, end):
        yield
