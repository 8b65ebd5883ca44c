"""A live table below a loop's log lines, drawn by a process of its own from what is recorded: the loop only passes lines on."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from types import FrameType

import msgspec
from rich.console import Console

from cogrip.cli.session.live_views import View
from cogrip.cli.terminal.echo import SHOW_CURSOR, Echo, in_foreground

END_LIMIT_S, STOP_LIMIT_S = 5.0, 1.0
# Ctrl-C and its like are the loop's: its end is the drawing's, which then leaves the terminal as it was
_NOT_ITS = ("SIGINT", "SIGTERM", "SIGQUIT", "SIGHUP", "SIGTTOU", "SIGTSTP")


def may_draw(console: Console) -> bool:
    """Return whether the console is a terminal on which a table can be drawn over."""
    return sys.platform != "win32" and sys.stdout.isatty() and console.is_terminal and not console.is_dumb_terminal


class LiveScreen:
    """`say` lines: above the table while one is drawn, else directly. Use it as a context."""

    def __init__(self, directly: Callable[[str], None]) -> None:
        self._directly = directly
        self._process: subprocess.Popen[bytes] | None = None
        self._echo = Echo(1)

    def __enter__(self) -> "LiveScreen":
        return self

    def __exit__(self, *ending: object) -> None:
        self.close()

    def draw(self, view: View) -> None:
        """Begin to draw. Call it before the loop takes real-time priority: the process would inherit it."""
        self._echo.note()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {getattr(signal, name) for name in _NOT_ITS})
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "cogrip.cli.session.live_process", msgspec.json.encode(view).decode()],
                stdin=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0,
            )  # fmt: skip
        except OSError as error:
            self._directly(f"warning: no live table: {error.strerror}")
            return
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        assert self._process.stdin is not None
        os.set_blocking(self._process.stdin.fileno(), False)
        if signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL:
            signal.signal(signal.SIGTSTP, self._stop)

    def say(self, text: str) -> None:
        """One line or several, at once; a drawing that does not take it is passed by."""
        if not self.passed(f"{text}\n"):
            self._directly(text)

    def passed(self, lines: str) -> bool:
        """Return whether the drawing has taken these lines."""
        if self._process is None:
            return False
        assert self._process.stdin is not None
        try:
            # a pipe takes a line whole, or not at all
            return self._process.stdin.write(lines.encode("utf-8", "replace")) is not None
        except OSError:  # it has ended
            self.close()
            return False

    def _stop(self, number: int, frame: FrameType | None) -> None:
        """Stop, as Ctrl-Z asks, once the drawing has left the terminal: from then on it is the shell's."""
        signal.signal(signal.SIGTSTP, signal.SIG_IGN)  # one at a time
        process = self._process
        if process is not None and process.stderr is not None:
            process.send_signal(signal.SIGTSTP)
            told = select.select([process.stderr], [], [], STOP_LIMIT_S)[0]
            if told and not os.read(process.stderr.fileno(), 1 << 12):  # it has ended
                self._mend()
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTSTP)  # here it stops, and here it goes on
        signal.signal(signal.SIGTSTP, self._stop)
        if process is not None:
            process.send_signal(signal.SIGCONT)

    def _mend(self) -> None:
        """Leave the terminal as the drawing would have, had it not been killed."""
        self._echo.restore()
        if in_foreground(1):
            with suppress(OSError):
                os.write(1, SHOW_CURSOR)

    def close(self) -> None:
        """End the drawing, and wait until the terminal is as it was."""
        process, self._process = self._process, None
        if process is None:
            return
        if signal.getsignal(signal.SIGTSTP) == self._stop:
            signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        with suppress(OSError):
            process.stdin.close()  # type: ignore[union-attr]
        try:
            process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stderr is not None:
            process.stderr.close()
        if process.returncode:
            self._mend()
