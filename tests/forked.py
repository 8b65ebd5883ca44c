"""Commands of cogrip as processes that begin at once: forked from one process of ours that has imported what they need.

A command so begun has a process id, a session, an environment, a folder, standard streams, signals and an exit code of its own.
Its imports alone would take it about a second of processor time. Where there is no safe fork it is started anew. What such a
command starts with `python -P -m MODULE` is forked from it in turn; tests/test_hostile_folder.py starts all of these anew.
"""

import atexit
import functools
import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NoReturn

from cogrip.machine.realtime import PRIORITY

PRELOADED = (
    "numpy", "encodings.idna", "cryptography.x509", "OpenSSL.SSL", "serial", "prometheus_client",
    "cogrip.api", "cogrip.cli.main",
    *(f"cogrip.cli.session.{each}" for each in ("demo", "join", "lab", "view")),
    *(f"cogrip.cli.serving.{each}" for each in ("gateway", "relay", "serve")),
    *(f"cogrip.cli.devices.{each}" for each in ("calibrate", "check", "conform", "emulate")),
    *(f"cogrip.cli.admin.{each}" for each in ("kick", "token_list", "token_new", "token_revoke", "who")),
    *(f"cogrip.devices.family.{each}" for each in ("emulated", "haply", "hid", "serial")),
    "cogrip.devices.io.serial_line", "cogrip.devices.family.simulated", "cogrip.devices.simulated.phantom",
    "cogrip.protocol.io.dtls_client", "cogrip.server.io.dtls_channel",
    "cogrip.protocol.recording.writer", "cogrip.view.io.page_server", "numpy.polynomial", "rich._unicode_data",
)  # fmt: skip
"""Not what draws a report: every process locks its memory, and would copy that too."""
begun: list[str] = []
"""Commands that were begun here until now."""
listeners: list[Callable[[], None]] = []
"""Hook that a command calls as it begins."""
_LONGEST = 200_000  # bytes of a request, environment and all
_COMM = 15  # characters of a process's name
_MESSAGE = struct.Struct("=ii")  # the process id, then the exit code as `subprocess` has it


class Forked:
    """A command, with what tests use of `subprocess.Popen`."""

    def __init__(self, request: Mapping[str, Any], stdin: int, stdout: int, stderr: int) -> None:
        self.stdin: IO[str] | None = None
        self.stdout: IO[str] | None = None
        self.returncode: int | None = None
        ours: list[int] = []  # ends that the command gets, closed here afterwards
        if stdin == subprocess.PIPE:
            stdin, writes = os.pipe()
            ours.append(stdin)
            self.stdin = os.fdopen(writes, "w", encoding="utf-8")
        elif stdin == subprocess.DEVNULL:
            stdin = os.open(os.devnull, os.O_RDONLY)
            ours.append(stdin)
        if stdout == subprocess.PIPE:
            reads, stdout = os.pipe()
            ours.append(stdout)
            self.stdout = os.fdopen(reads, encoding="utf-8")
        self._status, told = os.pipe()
        ours.append(told)
        try:
            _parent().begin(request, (stdin, stdout, stdout if stderr == subprocess.STDOUT else stderr, told))
        finally:
            for each in ours:
                os.close(each)
        self.pid, _ = _MESSAGE.unpack(os.read(self._status, _MESSAGE.size))

    def poll(self) -> int | None:
        return self._look(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code. Raises subprocess.TimeoutExpired."""
        code = self._look(timeout)
        if code is None:
            assert timeout is not None
            raise subprocess.TimeoutExpired(f"command {self.pid}", timeout)
        return code

    def _look(self, timeout_s: float | None) -> int | None:
        if self.returncode is None and select.select([self._status], [], [], timeout_s)[0]:
            _, self.returncode = _MESSAGE.unpack(os.read(self._status, _MESSAGE.size))
            os.close(self._status)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, None]:
        """Return all that it prints until its end, and its exit code is then known. Nothing is told it."""
        if self.stdin is not None:
            self.stdin.close()
        said = "" if self.stdout is None else self.stdout.read()
        self.wait(timeout)
        return said, None

    def __enter__(self) -> "Forked":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for stream in (self.stdin, self.stdout):
            if stream is not None:
                stream.close()
        self.wait()


def start(
    *arguments: object, code: str = "", stdin: int = subprocess.DEVNULL, stdout: int = subprocess.PIPE,
    stderr: int = subprocess.STDOUT, env: Mapping[str, str] | None = None,
) -> Any:  # fmt: skip
    """Start `cogrip ARGUMENTS`, or Python `code` with these arguments, unbuffered and in a session of its own; text streams."""
    words = [str(argument) for argument in arguments]
    begun.append(" ".join(words))
    for each in listeners:
        each()
    environment = dict(os.environ if env is None else env)
    if sys.platform == "linux":
        request = {"arguments": words, "code": code, "folder": os.getcwd(), "environment": environment}
        return Forked(request, stdin, stdout, stderr)
    begin = ["-c", code] if code else ["-m", "cogrip.cli"]
    return subprocess.Popen(
        [sys.executable, *begin, *words], stdin=stdin, stdout=stdout, stderr=stderr, text=True, start_new_session=True,
        env={**environment, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip


def child_of(pid: int, name: str = "") -> int:
    """Return the only child of a process, or that which runs a module or a command of cogrip of this name."""
    children = [
        int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()
    ]
    (found,) = (each for each in children if not name or _runs(each, name))
    return found


def _runs(pid: int, name: str) -> bool:
    folder = Path(f"/proc/{pid}")
    return (folder / "comm").read_text().strip() == name[:_COMM] or name.encode() in (folder / "cmdline").read_bytes()


def never_late(process: Any) -> None:
    """Run a process before all others, where that is allowed: an emulated firmware, which has a processor of its own."""
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))


class _Parent:
    """The process that all commands of this one are forked from."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-u", __file__, str(theirs.fileno())], pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"}, start_new_session=True,
            )  # fmt: skip
        atexit.register(self.end)

    def begin(self, request: Mapping[str, Any], descriptors: Sequence[int]) -> None:
        socket.send_fds(self._socket, [json.dumps(request).encode()], list(descriptors))

    def end(self) -> None:
        self._socket.close()
        self._process.wait()


@functools.cache
def _parent() -> _Parent:
    return _Parent()


# --- in the process that is forked ------------------------------------------------------------------------------------


def _forked(requests: socket.socket) -> dict[str, Any] | None:
    """Fork for every request. Return it in the process that is to fulfil it; None in this one, when no more can come."""
    woken, wake = socket.socketpair()
    for end in (woken, wake):
        end.setblocking(False)
    signal.set_wakeup_fd(wake.fileno())
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    told: dict[int, int] = {}  # process id -> where its exit code is awaited
    while True:
        ready, _, _ = select.select([requests, woken], [], [])
        if woken in ready:
            woken.recv(4096)
            _tell_ends(told)
        if requests in ready:
            words, descriptors, _, _ = socket.recv_fds(requests, _LONGEST, 4)
            if not words:
                return None
            pid = os.fork()
            if not pid:
                request = json.loads(words)
                signal.set_wakeup_fd(-1)
                for each in (requests, woken, wake):
                    each.close()
                _separate(request, descriptors)
                return request
            told[pid] = descriptors.pop()
            for each in descriptors:
                os.close(each)
            os.write(told[pid], _MESSAGE.pack(pid, 0))


def _tell_ends(told: dict[int, int]) -> None:
    for pid in list(told):
        found, status = os.waitpid(pid, os.WNOHANG)
        if found:
            descriptor = told.pop(pid)
            with suppress(BrokenPipeError):  # nobody asks any more
                os.write(descriptor, _MESSAGE.pack(pid, os.waitstatus_to_exitcode(status)))
            os.close(descriptor)


def _separate(request: dict[str, Any], descriptors: Sequence[int]) -> None:
    """Make the forked process one of its own: session, streams, signals, environment, folder."""
    os.setsid()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number, descriptor in enumerate(descriptors[:3]):
        os.dup2(descriptor, number)
    os.closerange(3, 256)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["folder"])
    sys.argv = ["-c" if request["code"] else "cogrip", *request["arguments"]]


class _Child(subprocess.Popen[Any]):
    """A process that a command starts: forked from it where it would be another Python, and no thread could hold a lock."""

    def __init__(self, args: Sequence[str], **how: Any) -> None:
        words = [os.fspath(word) for word in args]
        if words[:3] == [sys.executable, "-P", "-m"] and _threads() == 1:
            how["preexec_fn"] = functools.partial(_run_module, words[3:], how.get("env"), how.get("pass_fds", ()))
        super().__init__(args, **how)


def _threads() -> int:
    return len(list(Path("/proc/self/task").iterdir()))


def _run_module(words: Sequence[str], environment: Mapping[str, str] | None, kept: Sequence[int]) -> None:
    """Be `python -m WORDS`, as far as that shows: `subprocess` has made streams, folder and session. Never returns."""
    try:
        atexit._clear()
        signal.set_wakeup_fd(-1)
        for number in signal.valid_signals():
            if callable(signal.getsignal(number)):
                signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        if environment is not None:
            os.environ.clear()
            os.environ.update(environment)
        for each in {int(name) for name in os.listdir("/proc/self/fd")} - {0, 1, 2, *kept}:
            with suppress(OSError):
                os.close(each)
        module, *arguments = words
        sys.argv = [module, *arguments]
        name = arguments[0] if module == "cogrip.cli" else module.rpartition(".")[2]
        Path("/proc/self/comm").write_text(name)
        sys.modules.pop(module, None)
        gc.enable()
    except BaseException:  # noqa: BLE001 - as an interpreter does
        traceback.print_exc()
        os._exit(1)
    _end_after(lambda: runpy.run_module(module, run_name="__main__", alter_sys=True))


def _end_after(command: Callable[[], object]) -> NoReturn:
    """Run a command and end the process, without freeing all that was imported, which takes longer than its start."""
    code = 0
    try:
        command()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
    except KeyboardInterrupt:
        traceback.print_exc()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:  # noqa: BLE001 - as an interpreter does
        code = 1
        traceback.print_exc()
    finally:
        with suppress(Exception):
            threading._shutdown()
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    for _name in PRELOADED:
        importlib.import_module(_name)
    gc.collect()
    gc.freeze()  # what is never looked at again is never copied
    assert _threads() == 1, "a process with threads cannot be forked"
    subprocess.Popen = _Child  # type: ignore[misc]
    _request = _forked(socket.socket(fileno=int(sys.argv[1])))
    if _request is not None:
        # Nothing of this module is the command's: its sockets are closed, its names are not seen.
        command = _request["code"] or "import sys; from cogrip.cli.main import main; sys.exit(main())"
        _end_after(lambda: exec(command, {"__name__": "__main__"}))
