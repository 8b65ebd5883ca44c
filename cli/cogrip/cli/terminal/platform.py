"""Functions of the operating system for the streams of a command."""

import io
import select
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

LOOK_EVERY_S = 0.2

if sys.platform == "win32":

    def use_utf8() -> None:
        """Write UTF-8 into pipes and files, too: their encoding is else one of 256 characters."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(encoding="utf-8")

    def takes_output(descriptor: int) -> bool:
        """Return True: whether a pipe has room cannot be asked."""
        return True

    def wait_for_input(descriptor: int) -> None:
        """Do nothing: Ctrl-C interrupts a read."""

    @contextmanager
    def no_stop_key() -> Iterator[None]:
        """Do nothing: no key stops a process."""
        yield

else:

    def use_utf8() -> None:
        """Do nothing: the locale is the user's."""

    def takes_output(descriptor: int) -> bool:
        """Return whether a write would go at once: not to a terminal on hold, or a full pipe."""
        return bool(select.select([], [descriptor], [], 0.0)[1])

    def wait_for_input(descriptor: int) -> None:
        """Wait until there is something to read, or the end. Ctrl-C interrupts it at any moment.

        Python handles a signal that comes just before a blocking read when that read ends, which may be never.
        """
        while not select.select([descriptor], [], [], LOOK_EVERY_S)[0]:
            pass

    @contextmanager
    def no_stop_key() -> Iterator[None]:
        """Ignore Ctrl-Z: children in sessions of their own would go on, and nobody could end them from this terminal."""
        before = signal.signal(signal.SIGTSTP, signal.SIG_IGN)
        try:
            yield
        finally:
            signal.signal(signal.SIGTSTP, before)
