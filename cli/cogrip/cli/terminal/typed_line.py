"""Next line of standard input, which Ctrl-C interrupts at any moment."""

import select
import sys

LOOK_EVERY_S = 0.2


def typed_line() -> str:
    """Return the next line of standard input. Raises EOFError at its end, KeyboardInterrupt after Ctrl-C.

    Python handles a signal that comes just before a blocking read when that read ends, which at a terminal may be never. So
    the terminal is read when there is something to read.
    """
    if sys.platform != "win32" and sys.stdin is not None and sys.stdin.isatty():
        while not select.select([sys.stdin], [], [], LOOK_EVERY_S)[0]:
            pass
    return input()
