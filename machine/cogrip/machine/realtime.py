"""Best-effort real time for the calling thread: ask for each measure, report what was granted, undo on request.

Nothing here raises because a permission is missing: the report says what was refused and what would cure it.
`timer-slack` and `fifo` hold for the calling thread, `memory-locked` and `gc-frozen` for the whole process,
`cpu-awake` for the machine while the process holds it.
"""

import ctypes
import gc
import os
import struct
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field

from cogrip.machine.platform import system

PRIORITY = 40
"""SCHED_FIFO priority: above ordinary work, below the kernel's interrupt threads (50 on PREEMPT_RT)."""
SERVER_PRIORITY = PRIORITY - 1
"""Priority of a server beside clients: the shorter the period, the higher the priority (rate-monotonic scheduling)."""

_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30  # options of prctl, of linux/prctl.h
_MCL_CURRENT, _MCL_FUTURE = 1, 2  # flags of mlockall, of sys/mman.h
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23  # numbers of capabilities, of linux/capability.h

LATENCY_FILE = "/dev/cpu_dma_latency"
LIMITS_FILE = "/etc/security/limits.d/90-cogrip.conf"


@dataclass(frozen=True, slots=True)
class RealTimeMeasure:
    """One real-time measure as it turned out; `detail` is the setting, or why not and the cure."""

    name: str
    granted: bool
    detail: str
    undo: Callable[[], None] = field(default=lambda: None, repr=False, compare=False)


class ProcessorWait:
    """Time [ns] for which the thread that makes it has been ready without a processor, in all so far: Linux's account of it."""

    def __init__(self) -> None:
        """Raises OSError where the system keeps no account."""
        self._descriptor = os.open("/proc/thread-self/schedstat", os.O_RDONLY)

    def __call__(self) -> int:
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        return int(os.read(self._descriptor, 64).split()[1])

    def __del__(self) -> None:
        with suppress(AttributeError):  # it was not opened
            os.close(self._descriptor)


def processor_wait() -> Callable[[], int] | None:
    """Return `ProcessorWait` of this thread, None where that is not known."""
    try:
        wait = ProcessorWait()
        wait()
    except (OSError, AttributeError, IndexError, ValueError):
        return None
    return wait


def has_capability(bit: int) -> bool:
    """Return whether this process holds Linux capability `bit` (effective); False where that cannot be read."""
    with suppress(OSError), open("/proc/self/status", encoding="ascii", errors="replace") as status:
        for line in status:
            if line.startswith("CapEff:"):
                return bool(int(line.split()[1], 16) >> bit & 1)
    return False


def _unavailable(name: str, why: str) -> RealTimeMeasure:
    return RealTimeMeasure(name, False, f"not available: {why}")


def libc_call(name: str, *arguments: int) -> int:
    """Call a C library function on unsigned longs. Raises OSError on -1, AttributeError when it does not exist."""
    function = getattr(ctypes.CDLL(None, use_errno=True), name)
    function.restype = ctypes.c_int
    result = int(function(*(ctypes.c_ulong(argument) for argument in arguments)))
    if result == -1:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


def _timer_slack(_priority: int) -> RealTimeMeasure:
    """Let the kernel's timer wake this thread within 1 ns of the request, not within its usual 50 us."""
    if sys.platform != "linux":
        return _unavailable("timer-slack", f"timer slack is a Linux setting, this is {sys.platform}")
    try:
        before_ns = libc_call("prctl", _PR_GET_TIMERSLACK, 0, 0, 0, 0)
        libc_call("prctl", _PR_SET_TIMERSLACK, 1, 0, 0, 0)
    except (OSError, AttributeError) as error:
        return _unavailable("timer-slack", f"prctl: {error}")

    def undo() -> None:  # a real-time thread reads as 0, and 0 sets the default: the right way back for both
        libc_call("prctl", _PR_SET_TIMERSLACK, before_ns, 0, 0, 0)

    return RealTimeMeasure("timer-slack", True, f"1 ns instead of {before_ns} ns", undo)


def _gc_frozen(_priority: int) -> RealTimeMeasure:
    """Collect garbage once, freeze all living objects, and switch the collector off. What was frozen before stays so."""
    if not hasattr(gc, "freeze"):
        return _unavailable("gc-frozen", f"{sys.implementation.name} has no gc.freeze")
    was_enabled, was_frozen = gc.isenabled(), gc.get_freeze_count() > 0
    gc.collect()
    gc.freeze()
    gc.disable()

    def undo() -> None:
        if not was_frozen:
            gc.unfreeze()
        if was_enabled:
            gc.enable()

    return RealTimeMeasure(
        "gc-frozen", True, f"{gc.get_freeze_count()} objects frozen; cycles made from now on stay", undo
    )


def _memory_locked(_priority: int) -> RealTimeMeasure:
    """Keep every page, present and future, in memory: no tick waits for a page fault from disk."""
    name = "memory-locked"
    if sys.platform != "linux":
        return _unavailable(name, f"mlockall is only used on Linux, this is {sys.platform}")
    import resource

    before = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    unlimited = before[1] == resource.RLIM_INFINITY
    # With a finite limit the lock may succeed now and a later allocation fail: MemoryError in the middle of a session.
    if not unlimited and not has_capability(CAP_IPC_LOCK):
        cure = f"put '<user> - memlock unlimited' into {LIMITS_FILE} and log in again"
        return RealTimeMeasure(name, False, f"refused: the memlock limit is {before[1] // 1024} KiB; {cure}")
    if unlimited:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (before[1], before[1]))
    try:
        libc_call("mlockall", _MCL_CURRENT | _MCL_FUTURE)
    except (OSError, AttributeError) as error:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, before)
        return _unavailable(name, f"mlockall: {error}")

    def undo() -> None:
        libc_call("munlockall")
        resource.setrlimit(resource.RLIMIT_MEMLOCK, before)

    return RealTimeMeasure(name, True, "all present and future pages", undo)


def _cpu_awake(_priority: int) -> RealTimeMeasure:
    """Ask idle processors to poll instead of halting (PM QoS, as cyclictest does), as long as the file is held open.

    A halted processor wakes with cold caches: the work of a tick then costs two to five times its time.
    """
    name = "cpu-awake"
    try:
        descriptor = os.open(LATENCY_FILE, os.O_WRONLY | getattr(os, "O_CLOEXEC", 0))
    except FileNotFoundError:
        return _unavailable(name, f"there is no {LATENCY_FILE}")
    except OSError as error:
        return RealTimeMeasure(
            name, False, f"refused: {error.strerror}; make {LATENCY_FILE} writable for you by a udev rule"
        )
    try:
        os.write(descriptor, struct.pack("=i", 0))
    except OSError as error:
        os.close(descriptor)
        return _unavailable(name, f"{LATENCY_FILE}: {error.strerror}")
    return RealTimeMeasure(name, True, "idle processors poll", lambda: os.close(descriptor))


def _fifo(priority: int) -> RealTimeMeasure:
    """Put this thread under SCHED_FIFO: it runs before any ordinary thread. Children and new threads stay ordinary."""
    name = "fifo"
    if sys.platform != "linux":
        return _unavailable(name, f"SCHED_FIFO is only used on Linux, this is {sys.platform}")
    before = os.sched_getscheduler(0)
    before_param = os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        cure = f"put '<user> - rtprio {priority}' into {LIMITS_FILE} and log in again"
        return RealTimeMeasure(name, False, f"refused: priority {priority} needs an rtprio limit; {cure}")
    except (OSError, ValueError) as error:
        return _unavailable(name, f"sched_setscheduler: {error}")

    def undo() -> None:
        try:
            os.sched_setscheduler(0, before, before_param)
        except PermissionError:  # without CAP_SYS_NICE the reset-on-fork flag, once set, stays
            os.sched_setscheduler(0, before | os.SCHED_RESET_ON_FORK, before_param)

    return RealTimeMeasure(name, True, f"priority {priority}", undo)


_MEASURES: dict[str, Callable[[int], RealTimeMeasure]] = {
    "timer-slack": _timer_slack,
    "gc-frozen": _gc_frozen,
    "memory-locked": _memory_locked,
    "cpu-awake": _cpu_awake,
    "fifo": _fifo,  # last: what the others do should not run at real-time priority
}

NAMES = tuple(_MEASURES)


def engage(names: Iterable[str] = NAMES, *, priority: int = PRIORITY) -> list[RealTimeMeasure]:
    """Try the named measures, in the order of NAMES, and return each result. Raises ValueError for an unknown name."""
    wanted = set(names)
    unknown = sorted(wanted - set(NAMES))
    if unknown:
        raise ValueError(f"unknown real-time measure {unknown[0]!r}: known are {', '.join(NAMES)}")
    return [
        _substitute(name) if name in system.REAL_TIME else _MEASURES[name](priority) for name in NAMES if name in wanted
    ]


def _substitute(name: str) -> RealTimeMeasure:
    """Take a system's own measure of this name."""
    try:
        return RealTimeMeasure(name, True, *system.REAL_TIME[name]())
    except OSError as error:
        return _unavailable(name, str(error))


def release(measures: Iterable[RealTimeMeasure]) -> None:
    """Undo measures, last first."""
    for measure in reversed(list(measures)):
        measure.undo()
