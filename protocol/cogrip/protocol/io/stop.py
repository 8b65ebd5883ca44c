"""The stop flag of a loop: signals set it, loops read it once a tick."""

import os
import select
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Literal


@dataclass(slots=True)
class Stop:
    """Requests to a loop.

    reason  why the loop should end, such as "stopped (SIGTERM)"; "" until then
    rearm   leave a fault
    reload  read files anew
    """

    reason: str = ""
    signals: int = 0
    rearm: bool = False
    reload: bool = False

    def take_rearm(self) -> bool:
        """Return whether re-arming was asked for since the last call: by SIGUSR1, or with `r` and Enter at a terminal."""
        typed = _typed_r()
        if not self.rearm:  # looked at before it is taken back: a signal may come between any two steps
            return typed
        self.rearm = False
        return True

    def take_reload(self) -> bool:
        """Return whether reloading was asked for since the last call, by SIGHUP."""
        if not self.reload:
            return False
        self.reload = False
        return True


@contextmanager
def on_signals(stop: Stop, hangup: Literal["terminate", "reload"] = "terminate") -> Iterator[Stop]:
    """Let Ctrl-C, SIGTERM and a terminal that closes set `stop`, and SIGUSR1 ask to re-arm, within the context.

    hangup: meaning of a SIGHUP that is not the end of a terminal. A third signal to end interrupts whatever hangs.
    """
    had_terminal = _has_terminal()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.signals += 1
        stop.reason = stop.reason or f"stopped ({signal.Signals(number).name})"
        if stop.signals >= 3:
            raise KeyboardInterrupt

    def hang_up(number: int, frame: FrameType | None) -> None:
        if hangup == "reload" and not (had_terminal and not _has_terminal()):
            stop.reload = True
        else:
            handle(number, frame)

    def rearm(number: int, frame: FrameType | None) -> None:
        stop.rearm = True

    handlers = {signal.SIGINT: handle, signal.SIGTERM: handle}
    if sys.platform != "win32":
        handlers[signal.SIGUSR1] = rearm
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # not under nohup
            handlers[signal.SIGHUP] = hang_up
    before = [(number, signal.signal(number, handler)) for number, handler in handlers.items()]
    try:
        yield stop
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def _has_terminal() -> bool:
    """Return whether our session has a terminal: one that was closed is taken from it."""
    if sys.platform == "win32":
        return False
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True


def _typed_r() -> bool:
    """Return whether a line `r` was typed at our terminal, without waiting."""
    if sys.platform == "win32" or not sys.stdin or sys.stdin.closed or not sys.stdin.isatty():
        return False
    try:
        descriptor = sys.stdin.fileno()
        if not _foreground(descriptor) or not select.select([descriptor], [], [], 0.0)[0]:
            return False
        return os.read(descriptor, 256).strip().lower() == b"r"
    except OSError:  # the terminal was closed
        return False


def _foreground(descriptor: int) -> bool:
    """Return whether we may read the terminal: a job in the background would be stopped for it."""
    if sys.platform == "win32":
        return True
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:  # it is not the terminal of our session, where there are no jobs
        return True
