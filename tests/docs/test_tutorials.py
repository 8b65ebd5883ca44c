"""Each tutorial's commands run in order in an empty folder, as its reader would type them, and print what the page shows."""

import os
import re
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.docs.pages import headings, page
from tests.docs.tutorials import NAMES, Saved, Typed, plain, steps
from tests.free_ports import free_port

LIMIT_S = 300.0
LIVE = re.compile(r"cogrip (?:demo|join)\b")
"""Commands that end with 1 where a busy machine has no time for every tick."""


def environment() -> dict[str, str]:
    """Return that of a terminal in which .venv is active."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith(("COGRIP", "COLUMNS", "PYTEST"))}
    return {**ours, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


def with_free_ports(command: str, taken: dict[str, int]) -> str:
    return re.sub(r"\b478\d\d\b", lambda found: str(taken.setdefault(found[0], free_port())), command)


def start(command: str, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        ["bash", "-c", command], cwd=folder, env=environment(), start_new_session=True, encoding="utf-8",
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)
    process.communicate(timeout=LIMIT_S)


def has_shown(process: subprocess.Popen[str], typed: Typed) -> None:
    """Wait until a command that stays has printed what the page shows."""
    said = ""
    assert process.stdout
    while any(piece not in plain(said) for piece in typed.shown):
        line = process.stdout.readline()
        assert line, (typed.command, said)
        said += line


def run(typed: Typed, folder: Path) -> None:
    process = start(typed.command, folder)
    try:
        said, _ = process.communicate(timeout=LIMIT_S)
    finally:
        end(process)
    assert process.returncode in ((0, 1) if LIVE.match(typed.command) else (0,)), (typed.command, said)
    missing = [piece for piece in typed.shown if piece not in plain(said)]
    assert not missing, (typed.command, missing, said)


@pytest.mark.long
@pytest.mark.lasts(600)
@pytest.mark.parametrize("name", NAMES)
def test_its_commands_print_what_it_shows(name: str, tmp_path: Path) -> None:
    taken: dict[str, int] = {}
    with ExitStack() as stack:
        for step in steps(name):
            if isinstance(step, Saved):
                (tmp_path / step.name).write_text(step.text, encoding="utf-8")
                continue
            typed = Typed(with_free_ports(step.command, taken), step.shown, step.stays)
            if not typed.stays:
                run(typed, tmp_path)
                continue
            process = start(typed.command, tmp_path)
            stack.callback(end, process)
            has_shown(process, typed)


@pytest.mark.parametrize("name", NAMES)
def test_it_says_what_comes_next_and_what_may_go_wrong(name: str) -> None:
    assert headings(page(name))[-2:] == ["What to try next", "What went wrong, and the cure"]
    assert re.search(r"\AAt the end you have ", page(name).split("\n", 2)[2])
    commands = [each for each in steps(name) if isinstance(each, Typed)]
    assert len(commands) >= 5
    assert sum(bool(each.shown) for each in commands) >= 4


def test_all_are_listed() -> None:
    assert all(f"]({Path(name).name})" in page("docs/tutorials/README.md") for name in NAMES)
    assert len(NAMES) == 5
