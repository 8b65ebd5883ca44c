"""Live tests on a machine that takes the processor away: runs of pytest whose stalls are a table."""

import json
import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.fair_time import FairTime, share
from tests.stalls import ALONE, LEAST_SHARE, RUNS, STALL_S, StallWatch, hangs_s

ROOT = Path(__file__).resolve().parents[1]
CONFTEST = """
import json
from pathlib import Path
from tests import stalls

pytest_plugins = ("tests.stalls",)

def _run(item, nextitem, before=stalls._run, **given):
    table = item.path.with_suffix(".json")
    measured, *rest = json.loads(table.read_text())
    table.write_text(json.dumps(rest or [measured]))
    stalls.StallWatch.measured = lambda self: measured if isinstance(measured, list) else (measured, 1.0)
    return before(item, nextitem, **given)
stalls._run = _run
"""
TEST = """
import pytest
from pathlib import Path

RUNS, OTHERS = Path(__file__).with_suffix(".runs"), Path(__file__).with_suffix(".others")

{mark}
def test_lives():
    RUNS.write_text(RUNS.read_text() + "x" if RUNS.exists() else "x")
    assert len(RUNS.read_text()) >= {good_from}

def test_other():
    OTHERS.open("a").write(RUNS.read_text() + ",")
"""
ON_TIME = "@pytest.mark.on_time"
pytestmark = pytest.mark.skipif(os.name != "posix", reason="no stalls are measured here")


@dataclass(frozen=True)
class Case:
    """A test that passes from its so manieth run on.

    measured: of each run of it or of the other one, the stall [s], or that and the share
    """

    measured: list[Any]
    good_from: int | str
    mark: str = ON_TIME


def run(folder: Path, cases: Mapping[str, Case], *options: str) -> tuple[int, str]:
    """Return exit code and output of a run of pytest."""
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "pytest.ini").write_text("[pytest]\naddopts = -q -rA --show-capture=no\n")
    for name, case in cases.items():
        (folder / f"test_{name}.json").write_text(json.dumps(case.measured))
        (folder / f"test_{name}.py").write_text(TEST.format(mark=case.mark, good_from=case.good_from))
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST_", ALONE))}
    options = ("-p", "xdist", *options) if options else ("-p", "no:xdist")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "."],
        cwd=folder, env={**environment, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


def runs(folder: Path, name: str) -> int:
    """Return how often the test of a case was run."""
    return len((folder / f"test_{name}.runs").read_text())


@pytest.mark.parametrize("options", [(), ("-n", "1")], ids=["one process", "workers"])
def test_it_runs_again_alone_at_the_end(tmp_path: Path, options: tuple[str, ...]) -> None:
    code, said = run(tmp_path, {"it": Case([0.2, 0.0], 2)}, *options)
    assert (code, runs(tmp_path, "it")) == (0, 2), said
    assert "2 passed" in said
    assert "test_it.py::test_lives: this machine took the processor away, for 0.2 s" in said
    assert (tmp_path / "test_it.others").read_text() == "x,", "the other test ran before it was run again"


CASES = {
    "stalls alone too": Case([0.2, 0.0, 0.1, 0.3, 0.4], 99),
    "no stall alone": Case([0.2, 0.0, 0.0], 99),
    "small share": Case([[0.01, LEAST_SHARE - 0.01], 0.0], 2),
    "share that is enough": Case([[0.01, LEAST_SHARE], 0.0], 2),
    "small share alone": Case([[0.01, LEAST_SHARE - 0.4], 0.0, [0.01, LEAST_SHARE - 0.4]], 99),
    "error of a program": Case([0.2], "len(RUNS)"),  # which has no length
    "no stall": Case([STALL_S], 2),
    "no need": Case([0.2], 2, ""),
    "within its need": Case([0.2, 0.0], 2, "@pytest.mark.on_time(0.3)"),
    "beyond its need": Case([0.4, 0.0], 2, "@pytest.mark.on_time(0.3)"),
}


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A run of all cases: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("cases")
    code, said = run(folder, CASES)
    assert code == 1, said
    return folder, said


@pytest.mark.parametrize(
    ("name", "outcome", "times"),
    [
        ("stalls alone too", "SKIPPED", 1 + RUNS),
        ("no stall alone", "FAILED", 2),
        ("small share", "PASSED", 2),
        ("share that is enough", "FAILED", 1),
        ("small share alone", "FAILED", 2),
        ("error of a program", "FAILED", 1),
        ("no stall", "FAILED", 1),
        ("no need", "FAILED", 1),
        ("within its need", "FAILED", 1),
        ("beyond its need", "PASSED", 2),
    ],
)
def test_what_failed_is_excused_where_the_machine_gave_too_little(
    ran: tuple[Path, str], name: str, outcome: str, times: int
) -> None:
    """A stall, or a small share beside others, excuses it in its first run; alone a stall does; its own error nothing."""
    folder, said = ran
    assert re.search(rf"^{outcome} (\[1\] )?test_{name}\.py:(:test_lives|\d+: )", said, re.MULTILINE), said
    assert runs(folder, name) == times
    assert f"PASSED test_{name}.py::test_other" in said
    if name == "stalls alone too":
        assert re.search(r"test_lives: Skipped: .* for 0.4 s.*; alone it needs one within 0.03 s", said)
    if name == "error of a program":
        assert f"FAILED test_{name}.py::test_lives - TypeError" in said


def test_a_test_that_hangs_is_shown_and_ended(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "conftest.py").write_text(
        'pytest_plugins = ("tests.stalls",)\nfrom tests import stalls\nstalls.hangs_s = lambda item: 0.01\n'
    )
    (tmp_path / "test_it.py").write_text("import os\ndef test_hangs():\n    os.read(os.pipe()[0], 1)\n")
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST_", ALONE))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:xdist"], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**environment, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )  # fmt: skip
    assert done.returncode < 0, done.stdout
    assert "in test_hangs" in done.stderr


def test_limits_are_330_s_and_what_a_test_says_that_it_lasts(request: pytest.FixtureRequest) -> None:
    assert hangs_s(request.node) == 330.0
    request.node.add_marker(pytest.mark.lasts(100.0))
    assert hangs_s(request.node) == 430.0


def test_the_watch_measures_from_where_it_is_to_look_closely_on() -> None:
    watch = StallWatch()
    watch.begin(100.0)
    watch.look_closely()
    watch.measured()  # it does
    os.kill(watch._process.pid, signal.SIGSTOP)
    os.waitid(os.P_PID, watch._process.pid, os.WSTOPPED | os.WNOWAIT)
    select.select([], [], [], 0.1)
    os.kill(watch._process.pid, signal.SIGCONT)
    stall_s, share = watch.measured()
    assert stall_s > 0.08
    assert 0.0 < share <= 1.0
    watch.end()
    assert watch._process.returncode == 0


def test_a_share_is_that_of_those_who_want_a_processor(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    load = tmp_path / "loadavg"
    given = open
    monkeypatch.setattr("builtins.open", lambda path, **how: given(load if path == "/proc/loadavg" else path, **how))
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1}, raising=False)
    for text, expected in (("0.1 0.1 0.1 6/200 77", 1 / 3), ("0 0 0 1/9 7", 1.0), ("0 0 0 0/9 7", 1.0), ("what", 1.0)):
        load.write_text(text)
        assert share() == expected
    monkeypatch.setattr("tests.fair_time.time.monotonic", iter([0.0, 3.0, 3.0, 4.0]).__next__)
    load.write_text("0 0 0 6/200 77")
    time = FairTime()
    assert (time.spent_s(), time.spent_s()) == (1.0, 1.0)
    load.write_text("0 0 0 2/200 77")
    assert time.spent_s() == 2.0
