"""System functions of Windows, under the names that `posix` has; `platform` chooses.

Type-checked, and run in the tests on a stand-in for the Windows API; not yet on Windows. Functions and constants have the
names of Microsoft's documentation (processthreadsapi.h, fileapi.h, timeapi.h).
"""

import ctypes
import msvcrt
import os
import signal
import socket
import subprocess
import sys
import threading
import time as _time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, Any, Literal

assert sys.platform == "win32"

from ctypes import wintypes  # noqa: E402


class time:  # noqa: N801 - it stands for the module
    """The functions of the module `time` that loops use.

    Before Python 3.13 `time.monotonic` is GetTickCount64, which moves on every 10 to 16 ms; `perf_counter` is
    QueryPerformanceCounter, the same in every process. `sleep` is a waitable timer with CREATE_WAITABLE_TIMER_HIGH_RESOLUTION
    from Python 3.11 on, where Windows has it (10, version 1803).
    """

    monotonic_ns = staticmethod(_time.perf_counter_ns)
    monotonic = staticmethod(_time.perf_counter)
    time_ns = staticmethod(_time.time_ns)
    sleep = staticmethod(_time.sleep)


LINUX = False
CLOCK: Literal["monotonic", "perf_counter"] = "perf_counter"
SPIN_NS = 600_000
"""Longest spinning before a deadline: high-resolution timers end on the next half of a millisecond."""
SPIN_PART = 1
"""Divisor of a period that gives the longest spinning in it: all of it, at a rate at which no timer is fine enough."""

# A datagram to a port that nobody listens on fails the next receive with WSAECONNRESET.
NOBODY_LISTENS: tuple[type[OSError], ...] = (ConnectionRefusedError, ConnectionResetError)
LOCKS_ARE_INHERITED = False
RENAMES_OPEN_FILES = False

END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)
TERMINATION_SIGNALS = (signal.SIGTERM, signal.SIGBREAK)
REARM_SIGNAL: signal.Signals | None = None
HANGUP_SIGNAL: signal.Signals | None = None
REARM_HOW = "`r` here"

LACKS: dict[str, str] = {
    "SCHED_FIFO": "HIGH_PRIORITY_CLASS and THREAD_PRIORITY_TIME_CRITICAL",
    "timer slack": "timeBeginPeriod(1), sleep by a high-resolution timer, the last 0.6 ms spun",
    "locked memory": "nothing",
    "arrival times of datagrams": "the time at which the loop drains its socket",
    "live table of join": "lines",
    "re-arming by a signal": "the key r",
    "state folder, metrics, gateway": "refused: run the server on Linux or macOS",
}
"""Lines of `cogrip doctor`: what this system lacks of what Linux has, and what is there instead."""

_kernel32 = ctypes.WinDLL("kernel32", use_last_error=True)
_winmm = ctypes.WinDLL("winmm")

_LOCKFILE_FAIL_IMMEDIATELY, _LOCKFILE_EXCLUSIVE_LOCK = 1, 2
_ERROR_LOCK_VIOLATION = 33
_LOCKED_AT = 1 << 62  # byte that is locked: beyond the end of any file, as others cannot read a locked byte
_HIGH_PRIORITY_CLASS, _THREAD_PRIORITY_TIME_CRITICAL = 0x80, 15
_THREAD_PRIORITY_ERROR_RETURN = 0x7FFFFFFF
_PERIOD_MS = 1


class _Overlapped(ctypes.Structure):
    """OVERLAPPED of minwinbase.h."""

    _fields_ = (
        ("internal", ctypes.c_size_t), ("internal_high", ctypes.c_size_t), ("offset", wintypes.DWORD),
        ("offset_high", wintypes.DWORD), ("event", wintypes.HANDLE),
    )  # fmt: skip


def _declared(name: str, result: Any, *arguments: Any) -> Any:
    function = getattr(_kernel32, name)
    function.restype, function.argtypes = result, arguments
    return function


_lock_file = _declared(
    "LockFileEx",
    wintypes.BOOL,
    *(wintypes.HANDLE, wintypes.DWORD, wintypes.DWORD, wintypes.DWORD, wintypes.DWORD, ctypes.POINTER(_Overlapped)),
)
_process = _declared("GetCurrentProcess", wintypes.HANDLE)
_thread = _declared("GetCurrentThread", wintypes.HANDLE)
_priority_class = _declared("GetPriorityClass", wintypes.DWORD, wintypes.HANDLE)
_set_priority_class = _declared("SetPriorityClass", wintypes.BOOL, wintypes.HANDLE, wintypes.DWORD)
_thread_priority = _declared("GetThreadPriority", ctypes.c_int, wintypes.HANDLE)
_set_thread_priority = _declared("SetThreadPriority", wintypes.BOOL, wintypes.HANDLE, ctypes.c_int)


def lock(fd: int) -> None:
    """Lock a file that is written, for as long as a process has this descriptor. Raises OSError where it is locked already."""
    where = _Overlapped(offset=_LOCKED_AT & 0xFFFF_FFFF, offset_high=_LOCKED_AT >> 32)
    flags = _LOCKFILE_FAIL_IMMEDIATELY | _LOCKFILE_EXCLUSIVE_LOCK
    if not _lock_file(msvcrt.get_osfhandle(fd), flags, 0, 1, 0, ctypes.byref(where)):
        number = ctypes.get_last_error()
        if number == _ERROR_LOCK_VIOLATION:
            raise BlockingIOError(number, "another process has locked it")
        raise ctypes.WinError(number)


def free_bytes(fd: int) -> int | None:
    """Return None: a server, which leaves room, runs on POSIX alone."""
    return None


def removed(fd: int) -> bool:
    """Return False: a file that is open cannot be removed."""
    return False


def copy(source: int, target: int) -> None:
    """Raise OSError: `removed` asks for no copy."""
    raise OSError("a file that is open is not copied here")


def own_session(*handles: int) -> dict[str, Any]:
    """Return keywords of `Popen` for a child that Ctrl-C does not reach, with these handles."""
    for handle in handles:
        os.set_handle_inheritable(handle, True)
    started = subprocess.STARTUPINFO(lpAttributeList={"handle_list": list(handles)})
    return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP, "startupinfo": started}


def handle_of(fd: int) -> int:
    """Return the number by which a child that has it handed on names the file of a descriptor."""
    return msvcrt.get_osfhandle(fd)


def descriptor_of(handle: int) -> int:
    """Return the descriptor of a file that this process was handed, by the number that `handle_of` gave."""
    return msvcrt.open_osfhandle(handle, os.O_RDWR | os.O_BINARY)


def end_of_input(stream: IO[bytes]) -> Callable[[float], bool]:
    """Return a function that waits so many seconds, at most, for the end of a pipe on which nothing more comes."""
    ended = threading.Event()

    def watch() -> None:
        stream.read()
        ended.set()

    threading.Thread(target=watch, daemon=True).start()  # no pipe can be waited for with a limit
    return ended.wait


@contextmanager
def end_signals_held() -> Iterator[None]:
    """Do nothing: no process gets a signal of another's group."""
    yield


def ignore_end_signals() -> None:
    """Leave the end of this process to the one that started it."""
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def ordinary_priority() -> None:
    """Do nothing: no child inherits a priority above the normal one."""


def usable_cpus() -> int:
    """Return the number of processors."""
    return os.cpu_count() or 1


def has_terminal() -> bool:
    """Return False: no signal tells of a console that closes."""
    return False


def typed() -> bytes:
    """Return the keys pressed at our console, b"" for none, without waiting."""
    keys = b""
    if sys.stdin and not sys.stdin.closed and sys.stdin.isatty():
        while msvcrt.kbhit():
            keys += msvcrt.getch()
    return keys


def interrupt(process: subprocess.Popen[Any]) -> None:
    """Ask a child of `own_session` to end, by CTRL_BREAK_EVENT to its group; without a console by the end of its input.

    Without a console CPython's `os.kill` ends the process itself, and then raises SystemError for the error before. So does
    this, where the child's input is no pipe of ours.
    """
    if not _kernel32.GetConsoleCP() and process.stdin is not None:
        process.stdin.close()
        return
    try:
        process.send_signal(signal.CTRL_BREAK_EVENT)
    except (OSError, SystemError):
        process.terminate()


end = interrupt


def arrival_check(receiver: socket.socket) -> Callable[[], object]:
    """Return a call that says yes: whether there is something to receive is not asked here."""
    return lambda: True


def stamped(receiver: socket.socket, option: int) -> Callable[[int, int], tuple[bytes, list[Any], int, Any]] | None:
    """Return None: there are no arrival times."""
    return None


def message_pair() -> tuple[socket.socket, socket.socket]:
    """Return two ends of a local link of whole messages; a message that fails tells an end that the other is gone."""
    ours, theirs = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for end in (ours, theirs):
        end.bind(("127.0.0.1", 0))
    ours.connect(theirs.getsockname())
    theirs.connect(ours.getsockname())  # neither takes a datagram from anyone else
    return ours, theirs


datagram_pair = message_pair


def _timer_period() -> tuple[str, Callable[[], None]]:
    """Ask for timers of 1 ms: waits with a limit, such as select's, else end on the next of 15.6 ms."""
    if _winmm.timeBeginPeriod(_PERIOD_MS):
        raise OSError(f"timeBeginPeriod({_PERIOD_MS}) is refused")
    return f"timer period {_PERIOD_MS} ms, sleep by a high-resolution timer", lambda: _winmm.timeEndPeriod(_PERIOD_MS)


def _high_priority() -> tuple[str, Callable[[], None]]:
    """Run this thread before all that is not real-time; REALTIME_PRIORITY_CLASS would starve the system's own threads."""
    before, thread_before = _priority_class(_process()), _thread_priority(_thread())
    if not before or thread_before == _THREAD_PRIORITY_ERROR_RETURN:
        raise ctypes.WinError(ctypes.get_last_error())

    def undo() -> None:
        _set_thread_priority(_thread(), thread_before)
        _set_priority_class(_process(), before)

    granted = _set_priority_class(_process(), _HIGH_PRIORITY_CLASS)
    if not granted or not _set_thread_priority(_thread(), _THREAD_PRIORITY_TIME_CRITICAL):
        number = ctypes.get_last_error()
        undo()
        raise ctypes.WinError(number)
    return "HIGH_PRIORITY_CLASS, THREAD_PRIORITY_TIME_CRITICAL", undo


REAL_TIME: dict[str, Callable[[], tuple[str, Callable[[], None]]]] = {
    "timer-slack": _timer_period,
    "fifo": _high_priority,
}
"""Substitutes of real-time measures, by name: each sets it, returns what it set and how to undo that, or raises OSError."""
