"""Draws a live table below the log lines of a loop: `python -m cogrip.cli.live_process VIEW`, VIEW as JSON.

The lines come on standard input; its end, which comes with the end of the loop however that ends, ends this process. The
terminal's echo is off meanwhile, as a key that is echoed would move the table; lines are read by the loop as before.
"""

import os
import select
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import msgspec
from rich.console import Console
from rich.live import Live

from cogrip.cli.live_views import JoinTable, JoinView, ServeTable, View

DRAW_EVERY_S = 0.2
NICE = 10  # the loop comes first


def main(view_text: str) -> None:
    view: View = msgspec.json.decode(view_text, type=View)
    drawn = JoinTable(view) if isinstance(view, JoinView) else ServeTable(view)
    with suppress(OSError):
        os.nice(NICE)
    console = Console(highlight=False)
    lines = _Lines(0)
    # the table goes when the loop ends, as the summary follows
    with _without_echo(sys.stdout.fileno()), Live(console=console, auto_refresh=False, transient=True) as live:
        drawn_s = -DRAW_EVERY_S
        while not lines.ended:
            for line in lines.wait(max(0.0, drawn_s + DRAW_EVERY_S - time.monotonic())):
                live.console.print(line, markup=False, soft_wrap=True)
            if time.monotonic() >= drawn_s + DRAW_EVERY_S:
                drawn_s = time.monotonic()
                live.update(drawn.table(console.size.width, console.size.height - 1), refresh=True)


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


@contextmanager
def _without_echo(descriptor: int) -> Iterator[None]:
    import termios

    before = termios.tcgetattr(descriptor)
    silent = list(before)
    silent[3] &= ~termios.ECHO
    termios.tcsetattr(descriptor, termios.TCSADRAIN, silent)
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


if __name__ == "__main__":
    main(sys.argv[1])
