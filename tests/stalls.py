"""Tests of live processes on a machine that takes the processor away meanwhile.

A watchdog is right to let go then: such a session says nothing about the code. A process of its own measures the machine. A
test that begins commands of cogrip, or is marked `on_time`, needs a processor within some time, and a machine that not too many
share. Where it failed and lacked either, it runs again alone once all others have ended. If the machine does not give it then,
it is skipped by name with the figures. Whatever fails on a machine that gives it fails.
"""

import gc
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Generator
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

from tests import forked

MACHINE_STALLED = "this machine took the processor away"
STALL_S = 0.03
"""A shorter stall is borne by every loop here: an arm's driver gives up after 50 ms, the watchdog after 100 ms."""
LEAST_SHARE = 0.7
"""Mean share of a processor, below which a live test is judged by itself: 0.67 where three want two processors."""
RUNS = 3
"""Runs of a test alone, before it is skipped."""
ALONE_S = 300.0
"""Time for all that run alone; what has had no turn by then is skipped."""
DEFECT = re.compile(
    r"\b(Attribute|Import|Index|Key|ModuleNotFound|Name|NotImplemented|Syntax|Type|UnboundLocal)Error\b"
)
"""Errors of a program, here or in one that a test began: a machine that stalls is no excuse of them."""
ALONE = "COGRIP_TESTS_ALONE"
"""Variable of the environment: the file for the reports of tests that run alone."""


class StallWatch:
    """The process of `stall_watch.py`. It ends with this one."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-S", str(Path(__file__).with_name("stall_watch.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def begin(self, limit_s: float) -> None:
        """Measure from now on, and end this process if it is not told of another test within a time [s]."""
        self._tell(b"%g\n" % limit_s)

    def look_closely(self) -> None:
        """Measure stalls from now on, until the next test begins."""
        self._tell(b"!\n")

    def measured(self) -> tuple[float, float]:
        """Return the longest stall since the close look [s], and the mean share of a processor that whoever wanted one had."""
        assert self._process.stdout is not None
        self._tell(b"?\n")
        stall_s, share = map(float, self._process.stdout.readline().split())
        return stall_s, share

    def end(self) -> None:
        self._process.communicate()

    def _tell(self, words: bytes) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(words)
        self._process.stdin.flush()


_WATCH = pytest.StashKey[StallWatch]()
_POSTPONED = pytest.StashKey[dict[str, str]]()
_SKIPPED = pytest.StashKey[list[str]]()
_BEGUN_S = time.monotonic()


def pytest_sessionstart(session: pytest.Session) -> None:
    session.config.stash[_POSTPONED] = {}
    session.config.stash[_SKIPPED] = []
    runs = session.config.getoption("dist", "no") == "no"  # itself, and leaves it to no workers
    if runs and os.name == "posix":  # elsewhere no test starts such processes
        session.config.stash[_WATCH] = watch = StallWatch()
        forked.listeners.append(watch.look_closely)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if _WATCH in session.config.stash:
        watch = session.config.stash[_WATCH]
        forked.listeners.remove(watch.look_closely)
        watch.end()


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test. Where it failed as the machine stalled, postpone it; alone, try again and then skip it."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in _run_alone(item, nextitem) if os.environ.get(ALONE) else _run_first(item, nextitem):
        if not _is_idle(report, item.config):
            item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _is_idle(report: pytest.TestReport, config: pytest.Config) -> bool:
    """Return True for what a worker need not tell: a set-up or an end that went well, where nobody asked for their times."""
    if (
        "PYTEST_XDIST_WORKER" not in os.environ
        or config.getoption("durations", None)
        or config.getoption("xmlpath", None)
    ):
        return False
    return report.passed and report.when != "call" and not hasattr(report, "postponed")


def _run_first(item: pytest.Item, nextitem: pytest.Item | None) -> list[pytest.TestReport]:
    reports, lacked = _run(item, nextitem)
    if lacked:
        _forget_what_is_open()
    return [_report(item, "passed", postponed=lacked)] if lacked else reports


def _forget_what_is_open() -> None:
    """Close what a test that is to run again has left open where it failed: else another one is told of it."""
    for name in ("last_exc", "last_value", "last_traceback", "last_type"):  # by which its frames are kept
        sys.__dict__.pop(name, None)
    with warnings.catch_warnings(action="ignore", category=ResourceWarning):
        gc.collect()


def _run_alone(item: pytest.Item, nextitem: pytest.Item | None) -> list[pytest.TestReport]:
    lacked = f"{MACHINE_STALLED}: {ALONE_S:g} s were not enough for all that had to run alone"
    for _ in range(RUNS):
        if time.monotonic() - _BEGUN_S > ALONE_S:
            break
        reports, lacked = _run(item, nextitem, alone=True)
        if not lacked:
            return reports
    needs = f"alone it needs one within {_within_s(item):g} s"
    return [_report(item, "skipped", f"{lacked}; {needs}")]


def _run(
    item: pytest.Item, nextitem: pytest.Item | None, *, alone: bool = False
) -> tuple[list[pytest.TestReport], str]:
    """Return the reports of a run, and what the machine did for which it says nothing about the code; "": it does.

    alone: a small share excuses nothing then, as no other test shares the machine: only a stall does
    """
    begun, watch = len(forked.begun), item.config.stash.get(_WATCH, None)
    on_time = item.get_closest_marker("on_time")
    if watch:
        watch.begin(hangs_s(item))
        if on_time is not None:
            watch.look_closely()
    reports = runtestprotocol(item, nextitem=nextitem, log=False)
    if any(report.failed and DEFECT.search(report.longreprtext) for report in reports):
        return reports, ""  # no machine makes that of a program
    said = any(report.skipped and MACHINE_STALLED in str(report.longrepr) for report in reports)
    lives = len(forked.begun) > begun or on_time is not None
    if watch and (said or (lives and any(report.failed for report in reports))):
        stall_s, share = watch.measured()
        if said or stall_s > _within_s(item) or (share < LEAST_SHARE and not alone):
            told = "as the test saw it; measured beside it: " if said else ""
            return (
                reports,
                f"{MACHINE_STALLED}, {told}for {stall_s:g} s, with a share of {share:g} for each who wants one",
            )
    return reports, ""


def hangs_s(item: pytest.Item) -> float:
    """Return how long a test may take, in time as the machine gives it [s]: 330 s, and what it says that it lasts."""
    lasts = item.get_closest_marker("lasts")
    return 330.0 + (float(lasts.args[0]) if lasts else 0.0)


def _within_s(item: pytest.Item) -> float:
    """Return within which time a test needs a processor [s]."""
    marker = item.get_closest_marker("on_time")
    return float(marker.args[0]) if marker and marker.args else STALL_S


def _report(item: pytest.Item, outcome: str, reason: str = "", postponed: str = "") -> pytest.TestReport:
    path, line, _ = item.location
    told = (path, line or 0, f"Skipped: {reason}") if reason else None
    report = pytest.TestReport(item.nodeid, item.location, {}, outcome, told, "setup")  # type: ignore[arg-type]
    if postponed:
        report.postponed = postponed
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Where this run is one of tests alone, hand every report to the one that began it."""
    if path := os.environ.get(ALONE):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(report._to_json(), default=str) + "\n")


class Alone:
    """Plugin that runs postponed tests after a session, in a process of their own. Workers have it not."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if lacked := getattr(report, "postponed", ""):
            self._config.stash[_POSTPONED][report.nodeid] = lacked
        elif report.skipped and MACHINE_STALLED in str(report.longrepr):
            self._config.stash[_SKIPPED].append(f"{report.nodeid}: {report.longrepr[2]}")  # type: ignore[index]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Generator[None, object, object]:
        done = yield
        if (postponed := self._config.stash[_POSTPONED]) and not session.shouldstop and not session.shouldfail:
            self._run_alone(list(postponed))
        return done

    def _run_alone(self, names: list[str]) -> None:
        chosen = [f"--{each}" for each in ("quick", "all") if self._config.getoption(each, False)]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "reports.jsonl")
            path.touch()
            subprocess.run(
                [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *chosen, *names],
                cwd=self._config.rootpath, env={**os.environ, ALONE: str(path)}, stdout=subprocess.DEVNULL, check=False,
            )  # fmt: skip
            reports = [
                pytest.TestReport._from_json(json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()
            ]
        for report in reports:
            if isinstance(report.longrepr, list):
                report.longrepr = tuple(report.longrepr)  # as pytest has a place, which JSON makes a list
            self._config.hook.pytest_runtest_logreport(report=report)
        for name in set(names) - {report.nodeid for report in reports}:
            place = (name.partition("::")[0], 0, name)
            lost = pytest.TestReport(name, place, {}, "failed", "it ended the process in which it ran alone", "call")
            self._config.hook.pytest_runtest_logreport(report=lost)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if postponed := self._config.stash[_POSTPONED]:
            terminalreporter.section("run again alone")
            for name, lacked in postponed.items():
                terminalreporter.line(f"{name}: {lacked}")
        for line in self._config.stash[_SKIPPED]:
            terminalreporter.line(line)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "on_time(seconds): judged only where a process gets a processor within that time, 0.03 s if not said"
    )
    if not os.environ.get(ALONE) and not os.environ.get("PYTEST_XDIST_WORKER"):
        config.pluginmanager.register(Alone(config))
