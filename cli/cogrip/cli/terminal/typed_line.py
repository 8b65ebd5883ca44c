"""Next line of standard input, which Ctrl-C interrupts at any moment."""

import os
import sys

from cogrip.cli.terminal.platform import wait_for_input

_read = bytearray()  # of a pipe or a file, beyond the lines that were returned


def typed_line() -> str:
    """Return the next line of standard input. Raises EOFError at its end, KeyboardInterrupt after Ctrl-C."""
    try:
        descriptor = sys.stdin.fileno()
    except (AttributeError, OSError):  # there is none, or what stands for it is no file
        return input()
    if os.isatty(descriptor):
        wait_for_input(descriptor)
        return input()
    while b"\n" not in _read:
        wait_for_input(descriptor)
        if not (more := os.read(descriptor, 4096)):
            break
        _read.extend(more)
    if not _read:
        raise EOFError
    line, _, rest = bytes(_read).partition(b"\n")
    _read[:] = rest
    return line.decode("utf-8", "replace").removesuffix("\r")
