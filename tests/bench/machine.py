"""Load, processors and memory of a benchmark's machine. Elsewhere than on Linux some are missing, and nothing is pinned."""

import math
import os
import socket
import subprocess
import sys
from typing import Any


def load() -> float:
    """Return the load average of the last minute; not a number where the system has none."""
    if sys.platform == "win32":
        return math.nan
    return os.getloadavg()[0]


def processors() -> list[int]:
    """Return the processors that this process may run on; none where that cannot be chosen."""
    if sys.platform == "linux":
        return sorted(os.sched_getaffinity(0))
    return []


def pin(process: int, cores: set[int]) -> None:
    """Let a process, 0 for this one, run on these processors only."""
    if sys.platform == "linux":
        os.sched_setaffinity(process, cores)


def peak_memory_kb() -> int:
    """Return the most memory that this process has held; 0 where that is not known."""
    if sys.platform == "win32":
        return 0
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def stop(process: subprocess.Popen[Any]) -> None:
    """Stop a process until `resume`."""
    if sys.platform != "win32":
        import signal

        process.send_signal(signal.SIGSTOP)


def resume(process: subprocess.Popen[Any]) -> None:
    """Let a stopped process go on."""
    if sys.platform != "win32":
        import signal

        process.send_signal(signal.SIGCONT)


def receive_stamped(receiver: socket.socket, most_bytes: int) -> tuple[bytes, list[tuple[int, int, bytes]], int, Any]:
    """Receive with the kernel's message about it. Raises BlockingIOError."""
    if sys.platform == "win32":
        raise OSError("Windows has no arrival times")
    return receiver.recvmsg(most_bytes, 64)
