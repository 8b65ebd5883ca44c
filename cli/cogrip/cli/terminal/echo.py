"""A terminal's echo, switched off below a live table; and which of a shell's jobs has the terminal."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

SHOW_CURSOR = b"\x1b[?25h"


def in_foreground(descriptor: int) -> bool:
    """Return whether this process's job has the terminal: another job may neither draw on it nor change it."""
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:  # no terminal, gone, or another session's
        return False


class Echo:
    """One terminal's echo. What fails because the terminal is gone is passed over."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._before: list[Any] | None = None  # as termios gives it; None while the echo is not ours

    def note(self) -> None:
        """Note how the terminal is now, for `restore`, if this job has it."""
        import termios

        if in_foreground(self._descriptor):
            with suppress(termios.error):
                self._before = termios.tcgetattr(self._descriptor)

    def switch_off(self) -> None:
        """Note how the terminal is, and stop the echo."""
        import termios

        self.note()
        if self._before is not None:
            with suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._silent(self._before))

    def restore(self) -> None:
        """Leave the terminal as it was noted, unless somebody, such as a shell, has changed it since."""
        import termios

        if self._before is None:
            return
        with suppress(termios.error), _undisturbed():
            if termios.tcgetattr(self._descriptor) == self._silent(self._before):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    @staticmethod
    def _silent(modes: list[Any]) -> list[Any]:
        import termios

        return [*modes[:3], modes[3] & ~termios.ECHO, *modes[4:]]


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let a job in the background set the terminal too; it would be stopped for it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
