"""Functions of the operating system for the page's process, beyond `cogrip.machine.platform`."""

import asyncio
import os
import sys
from collections.abc import Coroutine
from typing import Any, TypeVar

_T = TypeVar("_T")

STARTS_HANDS = sys.platform != "win32"  # whether an event loop can watch both sockets and child processes


def run(main: Coroutine[Any, Any, _T]) -> _T:
    """Run an event loop that can watch a socket; the usual one of Windows cannot."""
    if sys.platform == "win32":
        with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
            return runner.run(main)
    return asyncio.run(main)


def has_display() -> bool:
    """Return whether a browser has a window here; on Linux one in this terminal would draw over what is printed."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
