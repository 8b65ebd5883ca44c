"""Return of freed memory to the system, with glibc's malloc_trim."""

import ctypes
import sys


def trim() -> None:
    """Give freed memory back: 1 ms for some MB, 0.1 ms for none. Memory locked by mlockall stays."""
    if _malloc_trim is not None:
        _malloc_trim(0)


_malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
