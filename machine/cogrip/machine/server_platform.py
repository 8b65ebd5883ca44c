"""Functions of the operating system for a server, beyond `cogrip.machine.platform`.

A server as a service is for Linux and macOS: its state folder (encryption, tokens, checkpoints), `cogrip who` and `kick`, and
metrics are refused on Windows, each in one line. What is left there is a server without encryption on loopback, for
`cogrip demo`; the time that another author's world takes is not limited.
"""

import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import IO

if sys.platform == "win32":
    POSIX = False
    NO_WAIT = NO_LINK = 0
    OUT_OF_PROCESSOR = -(2**31)  # exit status that no process has

    def set_mode(fd: int, mode: int) -> None:
        """Do nothing: there are no modes."""

    def user_id() -> int:
        """Return 0: users have no numbers."""
        return 0

    def user_name(number: int) -> str:
        """Return the number."""
        return str(number)

    def local_socket(kind: socket.SocketKind) -> socket.socket:
        """Raise OSError."""
        raise OSError("Windows: Python has no local sockets there")

    def unblocked(pipe: IO[bytes], size: int) -> None:
        """Raise OSError."""
        raise OSError("Windows: a pipe cannot be written without waiting")

    def be_nice() -> None:
        """Do nothing."""

    def limit_processor(seconds: int) -> None:
        """Do nothing: there are no limits."""

    @contextmanager
    def alarm(seconds: float, act: Callable[[int, FrameType | None], None]) -> Iterator[None]:
        """Run what is inside without an alarm."""
        yield

else:
    import fcntl
    import pwd
    import resource

    POSIX = True
    NO_WAIT, NO_LINK = os.O_NONBLOCK, os.O_NOFOLLOW
    OUT_OF_PROCESSOR = -int(signal.SIGXCPU)
    """Exit status of a process that `limit_processor` has ended."""
    _NICE = 5

    def set_mode(fd: int, mode: int) -> None:
        """Set the mode of an open file."""
        os.fchmod(fd, mode)

    def user_id() -> int:
        """Return the number of the user of this process."""
        return os.geteuid()

    def user_name(number: int) -> str:
        """Return the name of a user, or the number where there is none."""
        try:
            return pwd.getpwuid(number).pw_name
        except KeyError:
            return str(number)

    def local_socket(kind: socket.SocketKind) -> socket.socket:
        """Return a socket that has a path. Raises OSError."""
        return socket.socket(socket.AF_UNIX, kind)

    def unblocked(pipe: IO[bytes], size: int) -> None:
        """Let writes to a pipe not wait, and make it as large as the system allows."""
        os.set_blocking(pipe.fileno(), False)
        if sys.platform == "linux":
            with suppress(OSError):  # less than this is well enough
                fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, size)

    def be_nice() -> None:
        """Let other processes come first."""
        with suppress(OSError):
            os.nice(_NICE)

    def limit_processor(seconds: int) -> None:
        """Let the system end this process once it has had so much more of the processor, and leave no core."""
        used = resource.getrusage(resource.RUSAGE_SELF)
        most = int(used.ru_utime + used.ru_stime) + seconds
        _limit(resource.RLIMIT_CPU, most, most + 1)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def _limit(what: int, soft: int, hard: int) -> None:
        """Set a limit, or leave the lower one that holds already."""
        before = [each for each in resource.getrlimit(what) if each != resource.RLIM_INFINITY]
        resource.setrlimit(what, (min([soft, *before]), min([hard, *before[1:]])))

    @contextmanager
    def alarm(seconds: float, act: Callable[[int, FrameType | None], None]) -> Iterator[None]:
        """Call `act` in the main thread after `seconds`, and again as often as what is inside goes on."""
        before = signal.signal(signal.SIGALRM, act)
        signal.setitimer(signal.ITIMER_REAL, seconds, seconds)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)


if sys.platform == "linux":
    FORKS = True

    def fork_awaited() -> int:
        """Fork this process. Returns the child's id, which the caller waits for, 0 in it."""
        return os.fork()

    def limit_memory(more_bytes: int) -> None:
        """Let this process have so much more memory, and no more; and be the first that ends where the machine has none."""
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + more_bytes
        _limit(resource.RLIMIT_AS, most, most)
        with suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text("1000")

    send_with_descriptors, receive_with_descriptors = socket.send_fds, socket.recv_fds

    def share_port(unbound: socket.socket) -> None:
        """Let other sockets of this user have the same port. Raises OSError."""
        unbound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)

    def fork() -> int:
        """Fork this process, whose children the system reaps, into a session of its own. Returns the child's id, 0 in it."""
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        if pid := os.fork():
            return pid
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.setsid()
        return 0

    def end_at_once(pid: int) -> None:
        """End a process of this user, if it is there."""
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)

    def message_pair() -> tuple[socket.socket, socket.socket]:
        """Return two connected local sockets of whole messages. Raises OSError."""
        return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def memory_file(content: bytes) -> int:
        """Return the descriptor of a file in memory alone. Raises OSError."""
        descriptor = os.memfd_create("content")
        os.pwrite(descriptor, content, 0)
        return descriptor

    def content_of(descriptor: int) -> bytes:
        """Return the content of a file that other processes may read at the same time."""
        return os.pread(descriptor, os.fstat(descriptor).st_size, 0)

else:
    FORKS = False

    def fork_awaited() -> int:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def limit_memory(more_bytes: int) -> None:
        """Do nothing: other systems have no such limit, or do not heed it."""

    WITHOUT = "several workers need Linux"

    def send_with_descriptors(link: socket.socket, pieces: Sequence[bytes], descriptors: Sequence[int]) -> int:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def receive_with_descriptors(
        link: socket.socket, most_bytes: int, most: int
    ) -> tuple[bytes, list[int], int, object]:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def share_port(unbound: socket.socket) -> None:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def fork() -> int:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def end_at_once(pid: int) -> None:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def message_pair() -> tuple[socket.socket, socket.socket]:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def memory_file(content: bytes) -> int:
        """Raise OSError."""
        raise OSError(WITHOUT)

    def content_of(descriptor: int) -> bytes:
        """Raise OSError."""
        raise OSError(WITHOUT)
