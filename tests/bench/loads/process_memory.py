"""The memory of running processes over time, as Linux tells it in /proc."""

import ctypes
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.bench import machine

PAGE_KB = os.sysconf("SC_PAGE_SIZE") // 1024 if hasattr(os, "sysconf") else 4


class MemoryGrowth(NamedTuple):
    """Resident memory [KiB], and how fast it grew over the second half."""

    first_kb: float
    middle_kb: float
    last_kb: float
    slope_kb_per_h: float


class Growth:
    """Resident memory of one process, noted now and then."""

    def __init__(self) -> None:
        self._times_s: list[float] = []
        self._sizes_kb: list[float] = []

    def note(self, time_s: float, size_kb: float | None) -> None:
        """None: the process has ended by now."""
        if size_kb is not None:
            self._times_s.append(time_s)
            self._sizes_kb.append(size_kb)

    @property
    def last_kb(self) -> float:
        return self._sizes_kb[-1] if self._sizes_kb else 0.0

    @property
    def slope_kb_per_h(self) -> float:
        """Slope of the least-squares line through the second half; 0 where there are fewer than three notes."""
        half = len(self._times_s) // 2
        times, sizes = np.array(self._times_s[half:]), np.array(self._sizes_kb[half:])
        if len(times) < 3:
            return 0.0
        away = times - times.mean()
        return float((away * (sizes - sizes.mean())).sum() / (away * away).sum() * 3600.0)

    def summary(self) -> MemoryGrowth:
        """Raises ValueError where nothing was noted."""
        if not self._sizes_kb:
            raise ValueError("no memory was noted of this process")
        return MemoryGrowth(
            self._sizes_kb[0], self._sizes_kb[len(self._sizes_kb) // 2], self.last_kb, self.slope_kb_per_h
        )


def family_of(leader: int) -> list[tuple[int, str]]:
    """A process and those that it started: (pid, "" for itself, else what it is for)."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and leader in (pid := int(entry.name), _parent_of(entry)):
            role = "" if pid == leader else _role(entry)
            if role is not None:
                found.append((pid, role))
    return sorted(found)


def memory_kb(process: int) -> float | None:
    """Resident memory, None where there is no such process."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE_KB
    except (OSError, IndexError, ValueError):
        return None


def own_memory_kb() -> int:
    """Resident memory of this process; where the system does not tell, the most it ever held."""
    if (now_kb := memory_kb(os.getpid())) is not None:
        return round(now_kb)
    return machine.peak_memory_kb()


class _Mallinfo2(ctypes.Structure):
    """`struct mallinfo2` of malloc.h."""

    _fields_ = [(f"size{number}", ctypes.c_size_t) for number in range(7)] + [
        (name, ctypes.c_size_t) for name in ("uordblks", "fordblks", "keepcost")
    ]


def own_memory_in_use_kb() -> int:
    """Resident memory of this process without what the C library's heap keeps free, a large page at a time.

    Where the system does not tell: `own_memory_kb`.
    """
    with suppress(OSError, AttributeError, TypeError):  # not Linux; not glibc 2.33; Windows
        mallinfo2 = ctypes.CDLL(None).mallinfo2
        mallinfo2.restype = _Mallinfo2
        of_heap_kb = sum(
            int(size)
            for part in re.split(r"^(?=[0-9a-f]+-)", Path("/proc/self/smaps").read_text(), flags=re.MULTILINE)
            if "[heap]" in part
            for size in re.findall(r"^Rss: +(\d+)", part, re.MULTILINE)
        )
        return own_memory_kb() - of_heap_kb + int(mallinfo2().uordblks) // 1024
    return own_memory_kb()


def _parent_of(entry: Path) -> int:
    try:
        return int(entry.joinpath("stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError, ValueError):
        return 0


def _role(entry: Path) -> str | None:
    """Return the purpose of a child; None for Python's own resource tracker."""
    try:
        words = entry.joinpath("cmdline").read_bytes()
    except OSError:
        return None
    if b"resource_tracker" in words:
        return None
    return " recorder" if b"recording_process" in words else " child"
