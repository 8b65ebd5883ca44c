"""Run a test of live processes anew where the machine itself took the processor away meanwhile.

A watchdog is right to let go then: such a session says nothing about the code. A process of its own measures the stalls.
"""

import os
import select
import subprocess
import sys

import pytest
from _pytest.runner import runtestprotocol

from tests import forked

MACHINE_STALLED = "this machine took the processor away"
STALL_S = 0.03
"""A shorter stall is borne by every loop here: an arm's driver gives up after 50 ms, the watchdog after 100 ms."""
RUNS = 5
_WATCH = f"""
import os, select, time
last_s = time.monotonic()
while not select.select([0], [], [], 0.005)[0]:
    now_s = time.monotonic()
    if now_s - last_s > {STALL_S}:
        os.write(1, b"%.3f " % (now_s - last_s))
    last_s = now_s
"""


class StallWatch:
    """A process that sleeps for 5 ms at a time and tells when it awoke too late. It ends with this one."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", _WATCH], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def longest_s(self) -> float:
        """Return the longest stall since this was asked last, 0 if there was none [s]."""
        assert self._process.stdout is not None
        pipe, told = self._process.stdout.fileno(), b""
        while select.select([pipe], [], [], 0.0)[0]:
            told += os.read(pipe, 65536)
        return max(map(float, told.split()), default=0.0)

    def end(self) -> None:
        self._process.communicate()


_WATCH_OF_RUN = pytest.StashKey[StallWatch]()


def pytest_sessionstart(session: pytest.Session) -> None:
    if os.name == "posix":  # elsewhere no test starts such processes
        session.config.stash[_WATCH_OF_RUN] = StallWatch()


def pytest_sessionfinish(session: pytest.Session) -> None:
    if _WATCH_OF_RUN in session.config.stash:
        session.config.stash[_WATCH_OF_RUN].end()


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test once, and where the machine stalled as it ran, up to five times."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    watch = item.config.stash.get(_WATCH_OF_RUN, None)
    for run in range(1, RUNS + 1):
        begun = len(forked.begun)
        if watch:
            watch.longest_s()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        stall_s = watch.longest_s() if watch and len(forked.begun) > begun else 0.0
        said = any(report.skipped and MACHINE_STALLED in str(report.longrepr) for report in reports)
        if run == RUNS or (not said and (not stall_s or not any(report.failed for report in reports))):
            break
        seen = f"for {stall_s:g} s" if stall_s else "as a process of the test says"
        print(f"{item.nodeid}: {MACHINE_STALLED}, {seen}; run anew", file=sys.__stderr__)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
