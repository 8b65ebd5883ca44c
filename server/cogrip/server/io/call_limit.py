"""Limits on the time that another author's world may take: a signal ends the call, in the main thread, which alone gets it.

The signal comes again and again, so that no call that has caught it goes on, and may come as the call has just ended. It does
nothing then: raised in what puts the timer off, it would leave that on, and later end whatever runs.
"""

import contextlib
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from inspect import unwrap
from types import FrameType

from cogrip.machine.server_platform import alarm
from cogrip.server.worlds.guarded import TooLongError, called

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
        if too_long(time.thread_time() - computed_s, time.monotonic() - begun_s) and not _leaves(frame):
            raise TooLongError

    with alarm(min(COMPUTE_LIMIT_S, WAIT_LIMIT_S) / LOOKS, end):
        yield


_CONTEXTS = frozenset(unwrap(each).__code__ for each in (alarm, call_limit, called))
"""Code of the contexts of a limit. They are on the stack as they are entered or left, and not while what is inside runs."""


def _leaves(frame: FrameType | None) -> bool:
    """Return whether a limit is being entered or left where a signal has come."""
    if frame is not None and frame.f_globals is contextlib.__dict__:  # on its way to one of them, perhaps
        return True
    while frame is not None and frame.f_code not in _CONTEXTS:
        frame = frame.f_back
    return frame is not None
