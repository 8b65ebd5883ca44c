"""System functions of Linux and macOS; `platform` chooses between these and those of `windows`."""

import fcntl
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import IO, Any, Literal

assert sys.platform != "win32"

LINUX = sys.platform == "linux"
CLOCK: Literal["monotonic", "perf_counter"] = "monotonic"  # name of the clock for time.get_clock_info
SPIN_NS = 60_000
"""Longest spinning before a deadline: about what an ordinary thread with 1 ns of timer slack oversleeps."""
SPIN_PART = 4
"""Divisor of a period that gives the longest spinning in it: a loop of high priority and rate, which spun half of it, would
leave no processor for a server and recorders of lower priority. A thread under SCHED_FIFO oversleeps by some 15 us."""

NOBODY_LISTENS: tuple[type[OSError], ...] = (ConnectionRefusedError,)
"""Error that a connected UDP socket raises where nobody listens."""
LOCKS_ARE_INHERITED = True
RENAMES_OPEN_FILES = True
_PIECE_BYTES = 1 << 20

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
TERMINATION_SIGNALS = (signal.SIGTERM, signal.SIGHUP)
"""Signals that end a process; SIGHUP comes from a terminal that closes. Those of keys are others."""
REARM_SIGNAL: signal.Signals | None = signal.SIGUSR1
HANGUP_SIGNAL: signal.Signals | None = signal.SIGHUP
REARM_HOW = "`r` and Enter here, or `kill -USR1 {}`,"  # how a client is re-armed; {} is the number of its process

LACKS: dict[str, str] = {}
"""Lines of `cogrip doctor`: what this system lacks of what Linux has, and what is there instead."""
if not LINUX:
    LACKS = {
        "SCHED_FIFO, locked memory, timer slack": "nothing: ordinary scheduling",
        "arrival times of datagrams": "the time at which the loop drains its socket",
    }

REAL_TIME: dict[str, Callable[[], tuple[str, Callable[[], None]]]] = {}
"""Substitutes of real-time measures, by name: each sets it, returns what it set and how to undo that, or raises OSError."""


def lock(fd: int) -> None:
    """Lock a file that is written, for as long as a process has this descriptor. Raises OSError where it is locked already."""
    fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)


def free_bytes(fd: int) -> int | None:
    """Return the free bytes of the disk of an open file, for an ordinary user; None where they are not told."""
    try:
        found = os.fstatvfs(fd)
    except OSError:
        return None
    return found.f_bavail * found.f_frsize


def removed(fd: int) -> bool:
    """Return whether an open file has no name any more."""
    return not os.fstat(fd).st_nlink


def copy(source: int, target: int) -> None:
    """Copy a file from its beginning to the end of another, both by descriptor. Raises OSError."""
    done, size = 0, os.fstat(source).st_size
    while done < size:
        done += os.write(target, os.pread(source, _PIECE_BYTES, done))


def own_session(*handles: int) -> dict[str, Any]:
    """Return keywords of `Popen` for a child that the terminal's signals do not reach, with these handles."""
    return {"start_new_session": True, "pass_fds": handles}


def handle_of(fd: int) -> int:
    """Return the number by which a child that has it handed on names the file of a descriptor."""
    return fd


def descriptor_of(handle: int) -> int:
    """Return the descriptor of a file that this process was handed, by the number that `handle_of` gave."""
    return handle


def end_of_input(stream: IO[bytes]) -> Callable[[float], bool]:
    """Return a function that waits so many seconds, at most, for the end of a pipe on which nothing more comes."""
    return lambda limit_s: bool(select.select([stream], [], [], limit_s)[0])


@contextmanager
def end_signals_held() -> Iterator[None]:
    """Hold back signals to end from a process that is started within the context, until it ignores them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, END_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_end_signals() -> None:
    """Leave the end of this process to the one that started it."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, END_SIGNALS)  # which `end_signals_held` may have held back


def ordinary_priority() -> None:
    """Give up a real-time priority that was inherited."""
    if sys.platform == "linux":
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def usable_cpus() -> int:
    """Return the number of processors that this process may run on."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def has_terminal() -> bool:
    """Return whether our session has a terminal: one that was closed is taken from it."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True


def typed() -> bytes:
    """Return what was typed at our terminal, b"" for nothing, without waiting."""
    if not sys.stdin or sys.stdin.closed or not sys.stdin.isatty():
        return b""
    try:
        descriptor = sys.stdin.fileno()
        if not _foreground(descriptor) or not select.select([descriptor], [], [], 0.0)[0]:
            return b""
        return os.read(descriptor, 256)
    except OSError:  # the terminal was closed
        return b""


def _foreground(descriptor: int) -> bool:
    """Return whether we may read the terminal: a job in the background would be stopped for it."""
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:  # it is not the terminal of our session, where there are no jobs
        return True


def interrupt(process: subprocess.Popen[Any]) -> None:
    """Ask a child to end, as Ctrl-C would."""
    process.send_signal(signal.SIGINT)


def stamped(receiver: socket.socket, option: int) -> Callable[[int, int], tuple[bytes, list[Any], int, Any]] | None:
    """Ask for arrival times by a socket's option. Return the method that receives with them, None where there are none."""
    if LINUX:
        with suppress(OSError):  # an emulated kernel
            receiver.setsockopt(socket.SOL_SOCKET, option, 1)
            return receiver.recvmsg
    return None


def arrival_check(receiver: socket.socket) -> Callable[[], object]:
    """Return a call that tells whether there is something to receive, in a third of the time of a receive that raises.

    Where there is none, as on macOS, it always says yes.
    """
    if sys.platform == "linux":
        found = select.epoll()
        found.register(receiver, select.EPOLLIN)
        return partial(found.poll, 0, 1)
    return lambda: True


def end(process: subprocess.Popen[Any]) -> None:
    """Ask a child to end."""
    process.terminate()


def message_pair() -> tuple[socket.socket, socket.socket]:
    """Return two ends of a local link of whole messages; each end learns at once that the other is gone.

    macOS has no such link: there only a message that fails tells it.
    """
    kind = socket.SOCK_DGRAM if sys.platform == "darwin" else socket.SOCK_SEQPACKET
    return socket.socketpair(socket.AF_UNIX, kind)


def datagram_pair() -> tuple[socket.socket, socket.socket]:
    """Return two ends of a local link of datagrams."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
