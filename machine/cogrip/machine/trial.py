"""Trial of a foreign file in a child process, under limits of memory and processor time, before this process takes it in.

On Linux this process is forked, which takes milliseconds. Elsewhere an interpreter is started for each trial, with the limits
that its system has: of processor time on macOS, of time on the clock alone on Windows, and of memory on neither.
"""

import faulthandler
import gc
import os
import pickle
import select
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import suppress

from cogrip.machine.server_platform import (
    FORKS,
    OUT_OF_PROCESSOR,
    end_at_once,
    fork_awaited,
    limit_memory,
    limit_processor,
)

MEMORY_BYTES = 2**30  # memory that the trial may take, beyond what this process has
PROCESSOR_S = 10
CLOCK_S = 120.0  # longest time of the trial by the clock: a machine may be busy
MOST_ANSWER_BYTES = 65536


class TrialError(Exception):
    """The trial came to no answer. The text says which limit it met."""


def tried(trial: Callable[[], str]) -> str:
    """Return what `trial` returns in a child process: text. It is pickled where the system does not fork.

    Raises TrialError where it met a limit, or ended without an answer.
    """
    answer, status = _forked(trial) if FORKS else _started(trial)
    if answer.endswith(b"\n"):
        return answer[:-1].decode(errors="ignore")
    if status is None:
        raise TrialError(f"has taken more than {CLOCK_S:g} s")
    if status == OUT_OF_PROCESSOR:
        raise TrialError(f"takes more than {PROCESSOR_S} s of the processor")
    raise TrialError(f"takes more than {MEMORY_BYTES >> 20} MB of memory, or ends the process that loads it")


def _forked(trial: Callable[[], str]) -> tuple[bytes, int | None]:
    """Return the answer of a fork, and how it ended: 0, or less a signal's number; None where it had to be ended."""
    ours, theirs = os.pipe()
    with warnings.catch_warnings(action="ignore", category=DeprecationWarning):  # of threads, none of which it needs
        pid = fork_awaited()
    if pid == 0:
        _answer(trial, theirs)
    os.close(theirs)
    try:
        answer, in_time = _read(ours)
    finally:
        os.close(ours)
        end_at_once(pid)  # it has answered, or is not to
        status = 0
        with suppress(ChildProcessError):  # where the system reaps children by itself
            status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return answer, status if in_time else None


def _read(descriptor: int) -> tuple[bytes, bool]:
    """Return what comes until the other end closes, and whether it has closed in time."""
    answer, end_s = b"", time.monotonic() + CLOCK_S
    while select.select([descriptor], [], [], max(0.0, end_s - time.monotonic()))[0]:
        if not (data := os.read(descriptor, MOST_ANSWER_BYTES)):
            return answer, True
        answer += data
    return answer, False


def _answer(trial: Callable[[], str], descriptor: int) -> None:
    """Write the answer to a trial, one line, and end this process; nothing that it holds of its parent is touched."""
    try:
        gc.disable()  # garbage of the parent may have finalizers
        faulthandler.disable()
        nowhere = os.open(os.devnull, os.O_RDWR)
        for standard in range(3):  # where libraries write as they abort
            os.dup2(nowhere, standard)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        limit_memory(MEMORY_BYTES)
        limit_processor(PROCESSOR_S)
        os.write(descriptor, trial().encode("utf-8", "replace")[: MOST_ANSWER_BYTES - 1] + b"\n")
    finally:
        os._exit(0)


def _started(trial: Callable[[], str]) -> tuple[bytes, int | None]:
    """Return the answer of an interpreter that was started for it, and how it ended."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "cogrip.machine.trial"], input=pickle.dumps(trial), stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, timeout=CLOCK_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return b"", None
    return done.stdout, done.returncode


if __name__ == "__main__":
    given = pickle.load(sys.stdin.buffer)
    _answer(given, os.dup(sys.stdout.fileno()))
