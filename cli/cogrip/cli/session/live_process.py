"""Draws a live table below the log lines of a loop: `python -m cogrip.cli.session.live_process VIEW`, VIEW as JSON.

The lines come on standard input; its end, which comes with the end of the loop however that ends, ends this process. The
terminal's echo is off meanwhile, as a key that is echoed would move the table; lines are read by the loop as before.

It draws only while its job has the terminal. When the job is stopped (Ctrl-Z) it leaves the terminal as it was, says so on
standard error, for which the loop waits, and stops too.
"""

import os
import select
import signal
import sys
import time
from contextlib import suppress

import msgspec
from rich.console import Console
from rich.live import Live

from cogrip.cli.session.live_views import JoinTable, JoinView, ServeTable, View
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.echo import Echo, in_foreground

DRAW_EVERY_S = 0.2
NICE = 10  # the loop comes first
_STOP = {signal.SIGTSTP} if sys.platform != "win32" else set()  # blocked but for when the terminal is as it was


def main(view_text: str) -> None:
    view: View = msgspec.json.decode(view_text, type=View)
    drawn = JoinTable(view) if isinstance(view, JoinView) else ServeTable(view)
    with suppress(OSError):
        os.nice(NICE)
    console = make_console()
    lines, drawing = _Lines(0), _Drawing(console, sys.stdout.fileno())
    drawn_s = -DRAW_EVERY_S
    try:
        while not lines.ended:
            for line in lines.wait(max(0.0, drawn_s + DRAW_EVERY_S - time.monotonic())):
                drawing.look()
                console.print(line, markup=False, soft_wrap=True)
            if _STOP & signal.sigpending():
                drawing.end()
                _stop()
            if time.monotonic() >= drawn_s + DRAW_EVERY_S:
                drawn_s = time.monotonic()
                drawing.look()
                if drawing.live is not None:
                    table = drawn.table(console.size.width, console.size.height - 1)
                    drawing.live.update(table, refresh=True)
    finally:
        drawing.end()


def _stop() -> None:
    """Say that the terminal is as it was, and stop until the job goes on."""
    with suppress(OSError):  # the loop has ended
        os.write(2, b".")
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP)  # here it stops
    signal.pthread_sigmask(signal.SIG_BLOCK, _STOP)


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
            self._echo.switch_off()
            # the table goes when the loop ends, as the summary follows
            self.live = Live(console=self._console, auto_refresh=False, transient=True)
            self.live.start()

    def end(self) -> None:
        """Leave the terminal as it was. Where another job has it already, the table stays: its place is that job's now."""
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


if __name__ == "__main__":
    main(sys.argv[1])
