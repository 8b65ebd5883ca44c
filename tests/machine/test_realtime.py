"""Real-time measures: granted or refused with words, undone afterwards, degrading where the system lacks them.

No test here leaves this process real-time: locked memory and SCHED_FIFO are only tried with the system call replaced.
"""

import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NoReturn

import pytest

from cogrip.machine import realtime

linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux system calls")


def raising(error: Exception) -> Callable[..., NoReturn]:
    def call(*_: object) -> NoReturn:
        raise error

    return call


@pytest.mark.parametrize("by_another", [False, True])
def test_gc_freezes_and_thaws_but_not_what_another_froze(by_another: bool) -> None:
    assert gc.isenabled()
    frozen = gc.get_freeze_count() > 0
    (gc.freeze if by_another else gc.unfreeze)()
    try:
        measures = realtime.engage(["gc-frozen"])
        assert [measure.granted for measure in measures] == [True]
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 0
        realtime.release(measures)
        assert gc.isenabled()
        assert (gc.get_freeze_count() > 0) is by_another
    finally:
        (gc.freeze if frozen else gc.unfreeze)()


@linux
def test_the_wait_for_a_processor_grows_by_what_another_thread_of_it_takes() -> None:
    """Two processes on one processor: the kernel's account has nearly all of what this one did not run."""
    wait = realtime.processor_wait()
    if wait is None:
        pytest.skip("this kernel keeps no account of it")
    before, own = os.sched_getaffinity(0), time.thread_time_ns
    os.sched_setaffinity(0, {min(before)})
    other = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        began_ns, ran_ns, waited_ns = time.monotonic_ns(), own(), wait()
        while wait() - waited_ns < 200_000_000:
            assert time.monotonic_ns() - began_ns < 60_000_000_000, "the other process never runs"
        lost_ns = time.monotonic_ns() - began_ns - (own() - ran_ns)
        assert wait() - waited_ns <= lost_ns * 1.1 + 20_000_000
    finally:
        os.sched_setaffinity(0, before)
        other.kill()
        other.wait()


def test_the_wait_for_a_processor_is_unknown_where_no_kernel_tells_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "open", raising(FileNotFoundError("/proc")))
    assert realtime.processor_wait() is None


@linux
def test_timer_slack_is_one_nanosecond_until_released() -> None:
    before_ns = realtime.libc_call("prctl", 30, 0, 0, 0, 0)
    (measure,) = realtime.engage(["timer-slack"])
    if measure.granted and before_ns:
        assert realtime.libc_call("prctl", 30, 0, 0, 0, 0) == 1
    realtime.release([measure])
    assert realtime.libc_call("prctl", 30, 0, 0, 0, 0) == before_ns


@linux
def test_fifo_is_asked_for_without_inheritance_and_given_back_and_a_refusal_names_the_cure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[int] = []
    before = os.sched_getscheduler(0)
    monkeypatch.setattr(os, "sched_setscheduler", lambda _pid, policy, _param: asked.append(policy))
    measures = realtime.engage(["fifo"], priority=7)
    realtime.release(measures)
    assert measures[0].detail == "priority 7"
    assert asked == [os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, before]
    monkeypatch.setattr(os, "sched_setscheduler", raising(PermissionError(1, "Operation not permitted")))
    (measure,) = realtime.engage(["fifo"])
    assert not measure.granted
    assert "rtprio 40" in measure.detail
    assert realtime.LIMITS_FILE in measure.detail
    measure.undo()


@linux
def test_memory_is_locked_and_unlocked_but_not_where_a_finite_limit_would_be_met_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import resource

    calls: list[tuple[object, ...]] = []
    monkeypatch.setattr(realtime, "libc_call", lambda *call: calls.append(call))
    monkeypatch.setattr(realtime, "has_capability", lambda _bit: True)
    realtime.release(realtime.engage(["memory-locked"]))
    assert calls == [("mlockall", 3), ("munlockall",)]
    monkeypatch.setattr(realtime, "has_capability", lambda _bit: False)
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (65536, 65536))
    (measure,) = realtime.engage(["memory-locked"])
    assert not measure.granted
    assert len(calls) == 2, "nothing was locked"
    assert "64 KiB" in measure.detail
    assert "memlock unlimited" in measure.detail


@linux
@pytest.mark.parametrize("error", [OSError(38, "Function not implemented"), AttributeError("undefined symbol: prctl")])
def test_a_missing_system_call_is_reported(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    monkeypatch.setattr(realtime, "libc_call", raising(error))
    monkeypatch.setattr(realtime, "has_capability", lambda _bit: True)
    for measure in realtime.engage(["timer-slack", "memory-locked"]):
        assert not measure.granted
        assert measure.detail.startswith("not available: ")


def test_another_system_gets_reasons_not_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "plan9")
    measures = realtime.engage(["timer-slack", "memory-locked", "fifo"])
    assert [measure.granted for measure in measures] == [False, False, False]
    assert all("not available" in measure.detail and "plan9" in measure.detail for measure in measures)
    realtime.release(measures)


def test_measures_come_in_the_stated_order_and_unknown_ones_are_named() -> None:
    assert realtime.NAMES[-1] == "fifo"
    with pytest.raises(ValueError, match=r"'turbo'.*timer-slack"):
        realtime.engage(["turbo"])
    assert realtime.engage([]) == []


def test_processors_are_kept_awake_by_an_open_file(tmp_path, monkeypatch):
    """The kernel honours the request while the file is open, and forgets it when it is closed."""
    file = tmp_path / "cpu_dma_latency"
    monkeypatch.setattr(realtime, "LATENCY_FILE", str(file))
    (absent,) = realtime.engage(["cpu-awake"])
    assert not absent.granted
    assert "there is no" in absent.detail
    file.touch()
    (measure,) = realtime.engage(["cpu-awake"])
    assert measure.granted
    assert file.read_bytes() == bytes(4)
    realtime.release([measure])
    with pytest.raises(OSError, match="Bad file descriptor"):
        measure.undo()
