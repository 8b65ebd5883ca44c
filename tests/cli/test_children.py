"""Reasons of the end of child processes: the one that the child stated, never the last line of its log."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.cli.session.children import how_ended, listening_at, stated_reason
from cogrip.cli.terminal.problem import Problem
from cogrip.machine.stop import Stop

from tests.live.held_arms import until

LOGS = {
    "the server was stopped (SIGTERM)": (
        "anna holds cube in room demo with sim:phantom\n"
        "anna: the session is over, no force is left: the server was stopped (SIGTERM)\n"
        "anna: dealt with: skipped tick 3\n"
    ),
    "device: serial: no reply": (
        "anna: dealt with: reply missed 3\nanna: the session broke off, no force is left: device: serial: no reply\n"
    ),
    "cannot listen on 127.0.0.1:47800: taken": "warning: room demo: softer\ncogrip: cannot listen on 127.0.0.1:47800: taken\n",
    "stopped (SIGTERM)": "listening on 127.0.0.1:1, unencrypted\nstopped (SIGTERM)\nreport: runs/1/report.html\n",
    "stopped (SIGINT)": '{"event": "notice", "text": "stopped (SIGINT)"}\n{"event": "left", "text": "anna left: goodbye"}\n',
    "stopped (its --seconds are over)": "up: nothing is emulated\nended: stopped (its --seconds are over)\n",
    "ZeroDivisionError: a bug": 'Traceback (most recent call last):\n  File "x.py", line 1\nZeroDivisionError: a bug\n',
    "Not passive: it gave.": "anna: not a good run: Not passive: it gave.\n",
    "the server said goodbye: kicked": "anna: observing broke off: the server said goodbye: kicked\n",
    "": "demo: anna joined from 127.0.0.1:57089 with sim:phantom?hand=reach\nthe server is silent: trying to come back\n",
}


@pytest.mark.parametrize("reason", LOGS)
def test_the_reason_is_the_one_that_was_stated(reason: str, tmp_path: Path) -> None:
    log = tmp_path / "log"
    assert stated_reason(log) == "", "a log that is not there states nothing"
    log.write_text(LOGS[reason])
    assert stated_reason(log) == reason


PARENT = """
import sys, time
from pathlib import Path
from cogrip.cli.session.children import start_child
child = start_child(Path(sys.argv[1]), ["serve", "demo", "--port", "0", "--no-record", "--no-report", "--seconds", "600"])
print(child.pid, flush=True)
child.wait()
"""


def test_a_child_ends_with_its_parent_however_that_ends(tmp_path: Path) -> None:
    log = tmp_path / "log"
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(log)], stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    assert parent.stdout is not None
    parent.stdout.readline()
    until(lambda: "listening on" in log.read_text(), "the server listens")
    parent.kill()
    parent.wait(60.0)
    parent.stdout.close()
    until(lambda: "stopped (its parent has ended)" in log.read_text(), "the server ends")


@pytest.mark.parametrize(
    ("code", "said", "reason"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "", "was killed by SIGKILL"),
        ("raise SystemExit(3)", "joined", "gave no reason (exit code 3)"),
        ("raise SystemExit(2)", "cogrip: no such file", "no such file (exit code 2)"),
        ("", "stopped (SIGTERM)", "stopped (SIGTERM)"),
        ("", "joined", "ended in order"),
    ],
)
def test_the_end_of_a_process_in_words(code: str, said: str, reason: str, tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text(f"{said}\n")
    child = subprocess.Popen([sys.executable, "-c", code])
    child.wait(60.0)
    assert how_ended(child, log) == reason


def test_a_server_that_did_not_start_is_a_problem_of_one_line(tmp_path: Path) -> None:
    log = tmp_path / "server.log"
    log.write_text("warning: soft\ncogrip: cannot listen on 127.0.0.1:9: taken\n")
    child = subprocess.Popen([sys.executable, "-c", "raise SystemExit(1)"])
    child.wait(60.0)
    words = f"the server did not start: cannot listen on 127.0.0.1:9: taken (exit code 1) (see {log})"
    with pytest.raises(Problem, match=re.escape(words)):
        listening_at("server", child, log, Stop())
