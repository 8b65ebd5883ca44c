"""A stand-in for Windows, on Linux: `python -P tests/windows.py MODULE ARGUMENTS...` runs a module as a process of it.

What Windows lacks is taken away before anything of cogrip is imported, what it has instead is put in its place, and child
processes are such processes, too. `os.name` stays, as do paths; other packages are imported before, for Linux.
"""

import asyncio
import asyncio.subprocess
import ctypes
import fcntl
import importlib
import mmap
import os
import platform
import runpy
import select
import signal
import socket
import stat
import subprocess
import sys
import time
import types
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NoReturn

WRITER = "json mcap.reader mcap.writer msgspec numpy zstandard"  # packages of all processes
COMMANDS = """
    OpenSSL.SSL cryptography.x509 cyclopts hid hidraw jinja2 loky matplotlib.backends.backend_agg matplotlib.figure
    matplotlib.font_manager mujoco prometheus_client rich.live rich.progress scipy.linalg scipy.optimize scipy.signal segno
    serial serial.tools.list_ports websockets.asyncio.server
    """  # of the commands

MODULES = "fcntl termios tty pty pwd grp resource readline curses syslog"
NAMES: dict[types.ModuleType, str] = {
    os: """
        O_CLOEXEC O_NOCTTY O_NOFOLLOW O_NONBLOCK SCHED_FIFO SCHED_OTHER SCHED_RESET_ON_FORK chown confstr ctermid fchdir fchmod
        fchown fork forkpty getegid geteuid getgid getgroups getloadavg getpgid getpgrp getpriority getsid getuid initgroups
        killpg lchown memfd_create mkfifo mknod nice openpty pidfd_open pread preadv pwrite pwritev sched_get_priority_max
        sched_getaffinity sched_getparam sched_getscheduler sched_param sched_setaffinity sched_setparam sched_setscheduler
        sched_yield sendfile set_blocking setegid seteuid setgid setpgid setpriority setsid setuid statvfs sysconf tcgetpgrp
        tcsetpgrp ttyname uname wait wait3 wait4 waitid
        """,
    signal: """
        ITIMER_REAL SIGALRM SIGCHLD SIGCONT SIGHUP SIGKILL SIGPIPE SIGQUIT SIGSTOP SIGTSTP SIGTTIN SIGTTOU SIGUSR1 SIGUSR2
        SIG_BLOCK SIG_SETMASK SIG_UNBLOCK alarm getitimer pause pthread_kill pthread_sigmask setitimer sigpending sigtimedwait
        sigwait sigwaitinfo
        """,
    socket: """
        AF_UNIX AF_NETLINK AF_PACKET CMSG_LEN CMSG_SPACE MSG_DONTWAIT SCM_RIGHTS SOCK_CLOEXEC SOCK_NONBLOCK SO_REUSEPORT
        recv_fds send_fds
        """,
    select: "EPOLLIN POLLHUP POLLIN epoll poll",
    time: "CLOCK_BOOTTIME CLOCK_MONOTONIC CLOCK_REALTIME clock_getres clock_gettime clock_gettime_ns clock_settime tzset",
    mmap: "MAP_ANONYMOUS MAP_PRIVATE MAP_SHARED PROT_READ PROT_WRITE",
    asyncio: "open_unix_connection start_unix_server",
}
METHODS = ("recvmsg", "recvmsg_into", "sendmsg")  # of socket

TICK_NS = 15_625_000  # of GetTickCount64, which time.monotonic is before Python 3.13
BREAK = int(signal.SIGUSR2)  # it carries CTRL_BREAK_EVENT
CTRL_C_EVENT, CTRL_BREAK_EVENT = 0, 1
CREATE_NEW_PROCESS_GROUP = 0x200
LOCK_VIOLATION, BAD_PARAMETER, NOT_A_SOCKET, INVALID_ARGUMENT = 33, 87, 10038, 10022

inheritable: set[int] = set()
called: list[tuple[Any, ...]] = []  # functions of the Windows API, with their arguments
real_popen, real_select, real_kill, flock = subprocess.Popen, select.select, os.kill, fcntl.flock
last_error = 0


class Function:
    """A function of a library; arguments are converted as declared."""

    def __init__(self, name: str, act: Callable[..., int]) -> None:
        self._name, self._act = name, act
        self.restype: Any = ctypes.c_int
        self.argtypes: Sequence[Any] | None = None

    def __call__(self, *arguments: Any) -> int:
        if self.argtypes is not None:
            assert len(arguments) == len(self.argtypes), self._name
            for argument, kind in zip(arguments, self.argtypes, strict=True):
                kind.from_param(argument)
        called.append((self._name, *arguments))
        return self._act(*arguments)


def lock_file(handle: int, flags: int, reserved: int, low: int, high: int, where: Any) -> int:
    """LockFileEx of one byte beyond the end."""
    global last_error
    at = where._obj
    assert (flags, reserved, low, high) == (3, 0, 1, 0)
    assert (at.offset_high << 32) + at.offset > 1 << 40
    try:
        flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        last_error = LOCK_VIOLATION
        return 0
    return 1


LIBRARIES: dict[str, dict[str, Callable[..., int]]] = {
    "winmm": {"timeBeginPeriod": lambda ms: 0, "timeEndPeriod": lambda ms: 0},
    "kernel32": {
        "LockFileEx": lock_file,
        "GetConsoleCP": lambda: 437,
        "GetCurrentProcess": lambda: -1,
        "GetCurrentThread": lambda: -2,
        "GetPriorityClass": lambda process: 0x20,
        "SetPriorityClass": lambda process, priority: 1,
        "GetThreadPriority": lambda thread: 0,
        "SetThreadPriority": lambda thread, priority: 1,
    },
}


class WinDLL:
    """A library."""

    def __init__(self, name: str, use_last_error: bool = False) -> None:
        for each, act in LIBRARIES[name].items():
            setattr(self, each, Function(each, act))


class STARTUPINFO:
    def __init__(self, *, lpAttributeList: dict[str, list[int]]) -> None:
        self.handles = lpAttributeList["handle_list"]


class Popen(real_popen):  # type: ignore[type-arg]
    """A process of this stand-in: `pass_fds` is refused, `start_new_session` without effect, `terminate` at once."""

    def __init__(
        self, args: Sequence[str], *more: Any, startupinfo: STARTUPINFO | None = None, creationflags: int = 0, **keys: Any
    ) -> None:  # fmt: skip
        assert not more
        if keys.pop("pass_fds", ()) or keys.pop("preexec_fn", None):
            raise ValueError("pass_fds not supported on Windows.")
        keys.pop("start_new_session", None)
        handles = startupinfo.handles if startupinfo else []
        if not inheritable.issuperset(handles):
            raise OSError(BAD_PARAMETER, "The parameter is incorrect")
        if list(args[:3]) == [sys.executable, "-P", "-m"]:
            args = [sys.executable, "-P", __file__, *args[3:]]
        self._own_group = bool(creationflags & CREATE_NEW_PROCESS_GROUP)
        super().__init__(args, pass_fds=handles, start_new_session=self._own_group, **keys)

    def send_signal(self, sig: int) -> None:
        if self.poll() is not None:
            return
        if sig == signal.SIGTERM:
            self.terminate()
        elif sig == CTRL_BREAK_EVENT and self._own_group:
            real_kill(self.pid, BREAK)
        else:
            raise ValueError(f"Unsupported signal: {sig}")

    def terminate(self) -> None:
        with suppress(ProcessLookupError):
            real_kill(self.pid, 9)

    kill = terminate


def select_sockets(reading: Any, writing: Any, failing: Any, limit_s: float | None = None) -> Any:
    """Winsock's select: of sockets alone, and of one at least."""
    every = [*reading, *writing, *failing]
    if not every:
        raise OSError(INVALID_ARGUMENT, "An invalid argument was supplied")
    for each in every:
        if not stat.S_ISSOCK(os.fstat(each if isinstance(each, int) else each.fileno()).st_mode):
            raise OSError(NOT_A_SOCKET, "An operation was attempted on something that is not a socket")
    return real_select(reading, writing, failing, limit_s)


def tcp_pair(family: int = socket.AF_INET, kind: int = socket.SOCK_STREAM, proto: int = 0) -> Any:
    """`socketpair` as Python makes it on Windows."""
    if (family, kind) != (socket.AF_INET, socket.SOCK_STREAM):
        raise ValueError("Only AF_INET and AF_INET6 socket address families, SOCK_STREAM sockets are supported")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = socket.create_connection(listener.getsockname())
        return ours, listener.accept()[0]


def missing(owner: object) -> NoReturn:
    raise AttributeError("Windows has none")


def become_windows(packages: str) -> None:
    """Turn this process into one of the stand-in, with these packages."""
    for name in packages.split():
        importlib.import_module(name)
    platform.uname()
    platform.python_implementation()
    for module, names in NAMES.items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    for name in METHODS:
        setattr(socket.socket, name, property(missing))
    for name in MODULES.split():
        sys.modules[name] = None  # type: ignore[assignment]
    msvcrt: Any = types.ModuleType("msvcrt")
    msvcrt.get_osfhandle = msvcrt.open_osfhandle = lambda fd, flags=0: fd
    msvcrt.kbhit = lambda: False
    sys.modules["msvcrt"] = msvcrt
    additions: dict[Any, dict[str, Any]] = {
        ctypes: {
            "WinDLL": WinDLL,
            "get_last_error": lambda: last_error,
            "WinError": lambda number: OSError(number, "WinError"),
        },
        os: {"O_BINARY": 0, "set_handle_inheritable": lambda handle, wanted: inheritable.add(handle)},
        signal: {"SIGBREAK": BREAK, "CTRL_C_EVENT": CTRL_C_EVENT, "CTRL_BREAK_EVENT": CTRL_BREAK_EVENT},
        socket: {"socketpair": tcp_pair},
        select: {"select": select_sockets},
        subprocess: {"Popen": Popen, "STARTUPINFO": STARTUPINFO, "CREATE_NEW_PROCESS_GROUP": CREATE_NEW_PROCESS_GROUP},
        time: {
            "monotonic_ns": lambda: time.perf_counter_ns() // TICK_NS * TICK_NS,
            "monotonic": lambda: time.perf_counter_ns() // TICK_NS * TICK_NS * 1e-9,
        },
    }  # fmt: skip
    for module, names in additions.items():
        for name, value in names.items():
            setattr(module, name, value)
    sys.platform = "win32"


if __name__ == "__main__":
    sys.argv = sys.argv[1:]
    become_windows(WRITER + (COMMANDS if "cogrip.cli" in " ".join(sys.argv[:2]) else ""))
    if sys.argv[0] == "-c":
        exec(compile(sys.argv[1], "<program>", "exec"), {"__name__": "__main__", "api_calls": lambda: called})
    else:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
