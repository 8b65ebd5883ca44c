"""Live tests on a machine that takes the processor away: runs of pytest whose stalls are a table."""

import json
import os
import re
import select
import signal
import subprocess
import sys
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
TABLE = Path("table.json")

def _run(item, nextitem, before=stalls._run, **given):
    measured, *rest = json.loads(TABLE.read_text())
    TABLE.write_text(json.dumps(rest or [measured]))
    stalls.StallWatch.measured = lambda self: measured if isinstance(measured, list) else (measured, 1.0)
    return before(item, nextitem, **given)
stalls._run = _run
"""
TEST = """
import json
from pathlib import Path
from tests import stalls

pytest_plugins = ("tests.stalls",)
TABLE = Path("table.json")

def longest_s(self):
    return 0.0
stalls.StallWatch.longest_s = longest_s

def _run(item, nextitem, before=stalls._run, **given):
    stalls_s, *rest = json.loads(TABLE.read_text())
    TABLE.write_text(json.dumps(rest or [stalls_s]))
    stalls.StallWatch.longest_s = lambda self: stalls_s
    return before(item, nextitem, **given)
stalls._run = _run
"""
TEST = """
import pytest
from pathlib import Path

{mark}
def test_lives():
    runs = Path("runs.txt")
    runs.write_text(runs.read_text() + "x" if runs.exists() else "x")
    assert len(runs.read_text()) >= {good_from}

def test_other():
    Path("others.txt").open("a").write(str(Path("runs.txt").read_text()) + ",")
"""
pytestmark = pytest.mark.skipif(os.name != "posix", reason="no stalls are measured here")


def run(
    folder: Path, measured: list[Any], good_from: int | str, mark: str = "@pytest.mark.on_time", *options: str
) -> tuple[int, str, int]:
    """Return exit code, output and the number of runs of a test that passes from its so manieth run on.

    measured: of each run, the stall [s], or that and the share
    """
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "pytest.ini").write_text("[pytest]\naddopts = -q\n")
    (folder / "table.json").write_text(json.dumps(measured))
    (folder / "test_it.py").write_text(TEST.format(mark=mark, good_from=good_from))
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST_", ALONE))}
    options = ("-p", "xdist", *options) if options else ("-p", "no:xdist")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "."],
        cwd=folder, env={**environment, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr, len((folder / "runs.txt").read_text())


@pytest.mark.parametrize("options", [(), ("-n", "1")], ids=["one process", "workers"])
def test_it_runs_again_alone_at_the_end(tmp_path: Path, options: tuple[str, ...]) -> None:
    code, said, runs = run(tmp_path, [0.2, 0.0], 2, "@pytest.mark.on_time", *options)
    assert (code, runs) == (0, 2), said
    assert "2 passed" in said
    assert "test_it.py::test_lives: this machine took the processor away, for 0.2 s" in said
    assert (tmp_path / "others.txt").read_text() == "x,", "the other test ran before it was run again"


def test_it_is_skipped_by_name_with_the_figure_where_the_machine_stalls_alone_too(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [0.2, 0.0, 0.1, 0.3, 0.4], 99)
    assert (code, runs) == (0, 1 + RUNS), said
    assert "1 passed, 1 skipped" in said
    assert re.search(r"test_lives: Skipped: .* for 0.4 s.*; alone it needs one within 0.03 s", said)


def test_it_fails_where_it_fails_alone_on_a_machine_that_does_not_stall(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [0.2, 0.0, 0.0], 99)
    assert (code, runs) == (1, 2), said
    assert "1 failed, 1 passed" in said


def test_a_machine_that_too_many_share_is_one_that_does_not_give_it(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [[0.01, LEAST_SHARE - 0.01], 0.0], 2)
    assert (code, runs) == (0, 2), said
    (tmp_path / "runs.txt").unlink()
    code, said, runs = run(tmp_path, [[0.01, LEAST_SHARE], 0.0], 2)
    assert (code, runs) == (1, 1), said


def test_alone_a_small_share_is_no_excuse(tmp_path: Path) -> None:
    small = [0.01, LEAST_SHARE - 0.4]
    code, said, runs = run(tmp_path, [small, 0.0, small], 99)
    assert (code, runs) == (1, 2), said
    assert "1 failed, 1 passed" in said


def test_an_error_of_a_program_is_none_of_the_machine(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [0.2], "len(runs)")  # which has no length
    assert (code, runs) == (1, 1), said
    assert "TypeError" in said


def test_it_fails_at_once_where_nothing_stalled(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [STALL_S], 2)
    assert (code, runs) == (1, 1), said


def test_a_test_that_needs_no_processor_in_time_is_not_excused(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [0.2], 2, "")
    assert (code, runs) == (1, 1), said


def test_the_need_is_what_the_test_says(tmp_path: Path) -> None:
    code, said, runs = run(tmp_path, [0.2, 0.0], 2, "@pytest.mark.on_time(0.3)")
    assert (code, runs) == (1, 1), said
    (tmp_path / "runs.txt").unlink()
    code, said, runs = run(tmp_path, [0.4, 0.0], 2, "@pytest.mark.on_time(0.3)")
    assert (code, runs) == (0, 2), said


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


def test_the_watch_measures_from_the_beginning_of_a_test_on() -> None:
    watch = StallWatch()
    watch.begin(100.0)
    watch.measured()  # it has begun
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
