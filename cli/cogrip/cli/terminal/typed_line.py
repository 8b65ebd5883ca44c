"""Next line of standard input, which Ctrl-C interrupts at any moment."""

import os
import sys

from cogrip.cli.terminal.platform import wait_for_input

_waiting = bytearray()  # bytes that were read from a pipe or a file, and not returned yet


def typed_line() -> str:
    """Return the next line of standard input. Raises EOFError at its end, KeyboardInterrupt after Ctrl-C."""
    try:
        descriptor = sys.stdin.fileno()
    except (AttributeError, OSError):  # there is none, or what stands for it is no file
        return input()
    if os.isatty(descriptor):
        wait_for_input(descriptor)
        return input()
    while b"\n" not in _waiting:
        wait_for_input(descriptor)
        if not (more := os.read(descriptor, 4096)):
            break
        _waiting.extend(more)
    if not _waiting:
        raise EOFError
    line, _, rest = bytes(_waiting).partition(b"\n")
    _waiting[:] = rest
    return line.decode("utf-8", "replace").removesuffix("\r")
