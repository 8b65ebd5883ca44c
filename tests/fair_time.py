"""Time as the machine gives it: of a second in which six want two processors, a third counts.

A limit on what is waited for must not shoot what merely shares its machine. Imports no package: a watch runs it by itself.
"""

import os
import time
from contextlib import suppress


def share() -> float:
    """Return the part of a processor that each of those gets who want one now; 1 where the system does not say."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with suppress(OSError, ValueError, IndexError), open("/proc/loadavg", encoding="ascii") as file:
        running = int(file.read().split()[3].partition("/")[0])
        return min(1.0, processors / max(1, running))
    return 1.0


class FairTime:
    """Counts from its making on. It must be looked at often: the share of now is taken for that since the last look."""

    def __init__(self) -> None:
        self._looked_s = time.monotonic()
        self._spent_s = 0.0

    def spent_s(self) -> float:
        """Return the time that was given until now [s]."""
        now_s = time.monotonic()
        self._spent_s += (now_s - self._looked_s) * share()
        self._looked_s = now_s
        return self._spent_s
