"""A live table below a loop's log lines, drawn by a process of its own, so that the loop only passes lines on.

`LiveScreen` is the loop's side, `draw_below` the drawing process's. Lines go to the drawing through its standard input, whose
end, however the loop ends, ends it. The terminal's echo is off meanwhile, since an echoed key would move the table; the loop
reads lines as before. The drawing draws only while its job has the terminal. On Ctrl-Z it restores the terminal, says so on
standard error, for which the loop waits, and both stop.
"""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

from rich.console import Console, RenderableType

from cogrip.cli.terminal.output import make_console

if TYPE_CHECKING:
    from rich.live import Live

assert sys.platform != "win32"  # `screen` has the choice

DRAW_EVERY_S = 0.2
END_LIMIT_S, STOP_LIMIT_S = 5.0, 1.0
NICE = 10  # niceness of the drawing: the loop comes first
SHOW_CURSOR = b"\x1b[?25h"
# Signals that are blocked in the drawing: the loop handles Ctrl-C and its like, and its end is the drawing's, which then
# restores the terminal.
_BLOCKED_IN_DRAWING = ("SIGINT", "SIGTERM", "SIGQUIT", "SIGHUP", "SIGTTOU", "SIGTSTP")
_STOP = {signal.SIGTSTP}  # signals that are unblocked only while the terminal is restored


def in_foreground(descriptor: int) -> bool:
    """Return whether this process's job has the terminal: another job may neither draw on it nor change it."""
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:  # no terminal, gone, or another session's
        return False


def may_draw(console: Console) -> bool:
    """Return whether the console is a terminal on which a table can be drawn over."""
    return sys.stdout.isatty() and console.is_terminal and not console.is_dumb_terminal


class Echo:
    """The echo of one terminal. Errors of a terminal that is gone are ignored."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._before: list[Any] | None = None  # termios attributes; None while the echo is not ours

    def save(self) -> None:
        """Keep the terminal's attributes for `restore`, if this job has the terminal."""
        import termios

        if in_foreground(self._descriptor):
            with suppress(termios.error):
                self._before = termios.tcgetattr(self._descriptor)

    def switch_off(self) -> None:
        """Save the attributes, and stop the echo."""
        import termios

        self.save()
        if self._before is not None:
            with suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._silent(self._before))

    def restore(self) -> None:
        """Restore the saved attributes, unless another program, such as a shell, has changed them since."""
        import termios

        if self._before is None:
            return
        with suppress(termios.error), _background_writes():
            if termios.tcgetattr(self._descriptor) == self._silent(self._before):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    @staticmethod
    def _silent(modes: list[Any]) -> list[Any]:
        import termios

        return [*modes[:3], modes[3] & ~termios.ECHO, *modes[4:]]


@contextmanager
def _background_writes() -> Iterator[None]:
    """Let a job in the background set the terminal too, for which it would be stopped."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class LiveScreen:
    """Context in which `say` puts lines above the table while one is drawn, else passes them to `directly`."""

    def __init__(self, directly: Callable[[str], None]) -> None:
        self._directly = directly
        self._process: subprocess.Popen[bytes] | None = None
        self._echo = Echo(1)

    def __enter__(self) -> "LiveScreen":
        return self

    def __exit__(self, *ending: object) -> None:
        self.close()

    def draw(self, module: str, argument: str) -> None:
        """Start `module`, which draws. Call it before the loop takes real-time priority: the process would inherit it."""
        self._echo.save()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {getattr(signal, name) for name in _BLOCKED_IN_DRAWING})
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, argument], stdin=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0
            )
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
        """Show one line or several, at once; a drawing that does not take them is bypassed."""
        if not self.passed(f"{text}\n"):
            self._directly(text)

    def passed(self, lines: str) -> bool:
        """Return whether the drawing has taken these lines."""
        if self._process is None:
            return False
        assert self._process.stdin is not None
        try:  # a pipe takes a line whole, or not at all
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
            ready = select.select([process.stderr], [], [], STOP_LIMIT_S)[0]
            if ready and not os.read(process.stderr.fileno(), 1 << 12):  # it has ended
                self._mend()
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTSTP)  # here it stops, and here it goes on
        signal.signal(signal.SIGTSTP, self._stop)
        if process is not None:
            process.send_signal(signal.SIGCONT)

    def _mend(self) -> None:
        """Restore the terminal in place of a drawing that was killed."""
        self._echo.restore()
        if in_foreground(1):
            with suppress(OSError):
                os.write(1, SHOW_CURSOR)

    def close(self) -> None:
        """End the drawing, and wait until the terminal is restored."""
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


def draw_below(table: Callable[[int, int], RenderableType]) -> None:
    """Print the lines of standard input until it ends, and `table(columns, lines)` below them five times a second."""
    with suppress(OSError):
        os.nice(NICE)
    console = make_console()
    lines, drawing = _Lines(0), _Drawing(console, sys.stdout.fileno())
    drawn_s = -DRAW_EVERY_S
    try:
        while not lines.ended:
            for line in lines.wait(max(0.0, drawn_s + DRAW_EVERY_S - time.monotonic())):
                drawing.look()
                console.print(line, soft_wrap=True)
            if _STOP & signal.sigpending():
                drawing.end()
                with suppress(OSError):  # the loop may have ended
                    os.write(2, b".")
                signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP)  # here it stops
                signal.pthread_sigmask(signal.SIG_BLOCK, _STOP)
            if time.monotonic() >= drawn_s + DRAW_EVERY_S:
                drawn_s = time.monotonic()
                drawing.look()
                if drawing.live is not None:
                    drawing.live.update(table(console.size.width, console.size.height - 1), refresh=True)
    finally:
        drawing.end()


class _Drawing:
    """The table's place below the lines, and the silent terminal. live: None while another job has the terminal."""

    def __init__(self, console: Console, descriptor: int) -> None:
        self.live: Live | None = None
        self._console = console
        self._descriptor = descriptor
        self._echo = Echo(descriptor)

    def look(self) -> None:
        """Begin or end, by who has the terminal."""
        if not in_foreground(self._descriptor):
            self.end()
        elif self.live is None:
            from rich.live import Live

            self._echo.switch_off()
            # the table goes when the loop ends, as the summary follows
            self.live = Live(console=self._console, auto_refresh=False, transient=True)
            self.live.start()

    def end(self) -> None:
        """Restore the terminal. Where another job has it already, the table stays: its place is that job's now."""
        live, self.live = self.live, None
        if live is None:
            return
        self._console.quiet = not in_foreground(self._descriptor)
        live.stop()
        self._console.quiet = False
        self._console.show_cursor(True)
        self._echo.restore()


class _Lines:
    """Whole lines from a pipe."""

    def __init__(self, descriptor: int) -> None:
        self.ended = False
        self._descriptor = descriptor
        self._rest = b""

    def wait(self, limit_s: float) -> list[str]:
        """Return what has come, after `limit_s` at the latest."""
        if not select.select([self._descriptor], [], [], limit_s)[0]:
            return []
        data = os.read(self._descriptor, 1 << 16)
        self.ended = not data
        *whole, self._rest = (self._rest + data).split(b"\n")
        return [line.decode("utf-8", "replace") for line in whole]
