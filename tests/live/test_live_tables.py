"""Live tables of `join` and `serve` at a terminal, and how they leave it."""

import os
import re
import shlex
import signal
import sys
import termios
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.extent import long
from tests.live.held_arms import DEMO, fairly
from tests.terminal import JobShell, Terminal

SIZES = [(80, 24), long(120, 40)]


def serving(
    at_terminal: Callable[..., Terminal], tmp_path: Path, *arguments: object, **size: int
) -> tuple[Terminal, str]:
    server = at_terminal("serve", DEMO, "--port", "0", "--state", tmp_path / "state", *arguments, **size)
    shown = server.see(r"listening on \S+:(\d+)")
    return server, re.search(r"listening on (\S+:\d+)", shown)[1]


@pytest.mark.parametrize(("columns", "lines"), SIZES)
def test_a_session_is_seen_from_both_ends_and_the_terminal_is_left_as_it_was(at_terminal, tmp_path, columns, lines):
    size = {"columns": columns, "lines": lines}
    server, place = serving(at_terminal, tmp_path, "--set", "object.axes=3", **size)
    anna = at_terminal("join", place, "--name", "anna", **size)
    # every axis with its sign, and what the network does; a screen may be read while a drawing is half there
    axes = r"x +[+-]\d+\.\d\s[\s\S]*y +[+-][\s\S]*z +[+-]" if columns == 80 else r"x +[+-]\d.*y +[+-]\d.*z +[+-]\d"
    headings = ("hand", "force", "reserve", "mJ: up", "rtt", "ms: up", "lost", "ticks", "playout")
    anna.see(lambda text: re.search(axes, text) is not None and all(heading in text for heading in headings))
    assert anna.screen.hidden
    assert anna.modes != anna.before, "keys are not echoed into the table"
    server.see(r"anna +holds +\d+:\d\d +127\.0\.0\.1:\d+ +\d+\.\d +\d+")
    # proxy and force of each axis; the last line of the drawing is the free seat's
    shown = server.see(r"anna +holds .*( [+-]\d+\.\d){3}( [+-]\d+\.\d\d){3}\nben +free".replace("( ", "( +"))
    assert re.search(r"room demo: object .* mm, step \d+, \d+ µs late, \d+ skipped", shown)
    assert "demo: anna joined from 127.0.0.1" in shown, "lines stand above the table"
    for person in (anna, server):
        person.type("\x03")
        assert person.end() == 0, person.screen.text
        assert person.modes == person.before
        assert not person.screen.hidden
        assert "state  " not in person.screen.text.partition("stopped:")[0], "the table is gone"
        assert max(map(len, person.screen.text.splitlines())) <= columns
        assert "Traceback" not in person.screen.text


@fairly
def test_r_and_enter_re_arm_with_the_table_on(start, session, at_terminal):
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    anna = at_terminal("join", f"127.0.0.1:{session.port}", "--name", "anna", "--device", arm.address)
    if "device stall" in anna.see(r"(live|fault) +(- +)*x"):  # in a fault, nothing may have been measured yet
        pytest.skip(f"this machine took the processor away for too long: {anna.screen.text}")
    arm.fault("silence 0.2")
    anna.see("`r` and Enter here")
    anna.see(r"fault +(- +)*x")  # where nothing could be measured yet a column has a dash
    anna.type("what now?\n")
    anna.type("r\n")
    anna.see("re-armed: force ramps in")
    shown = anna.see(r"live +(- +)*x")
    assert shown.count("anna in room demo") == 1, "the keys moved no table"
    assert shown.count("what now?") == 1, "as the line that says it is no order; the keys themselves are not echoed"
    anna.type("\x03")
    assert anna.end() == 0, anna.screen.text
    assert anna.modes == anna.before


def test_a_client_that_was_killed_leaves_the_terminal_as_it_was(at_terminal, tmp_path):
    _, place = serving(at_terminal, tmp_path, "--quiet")
    anna = at_terminal("join", place, "--name", "anna")
    anna.see(r"live +x")
    anna.kill()
    assert anna.end() == signal.SIGKILL
    anna.settle(lambda: anna.modes == anna.before and not anna.screen.hidden)


@pytest.mark.parametrize(
    ("flags", "words"), [(("--quiet",), "holds cube"), (("--no-record",), "no live table without a recording")]
)
def test_no_table_where_none_is_wanted_or_none_can_be(at_terminal, tmp_path, flags, words):
    server, place = serving(at_terminal, tmp_path, *flags)
    anna = at_terminal("join", place, "--name", "anna", "--seconds", "0.5", *flags)
    anna.see(words)
    assert anna.end() == 0, anna.screen.text
    server.see("demo: anna left")
    for person in (anna, server):
        assert "\x1b[?25l" not in person.written
        assert "room demo:" not in person.screen.text
        assert "anna in room demo" not in person.screen.text
    assert ("no live table" in server.screen.text) is ("--no-record" in flags)


def test_a_log_for_programs_has_no_table(at_terminal, tmp_path):
    server = at_terminal("serve", DEMO, "--port", "0", "--log", "json", "--seconds", "0.5")
    assert server.end() == 0
    assert "\x1b[?25l" not in server.written


@pytest.fixture
def shell() -> Iterator[JobShell]:
    jobs = JobShell()
    jobs.see(r"\$")
    yield jobs
    jobs.close()


def command(tmp_path: Path, *arguments: object) -> str:
    folders = ("--state", tmp_path / "state", "--runs", tmp_path / "runs", "--no-report")
    words = (sys.executable, "-m", "cogrip.cli", "serve", DEMO, "--port", "0", *folders, *arguments)
    return shlex.join(map(str, words))


def echoes(terminal: Terminal) -> bool:
    return bool(terminal.modes[3] & termios.ECHO)


@pytest.mark.long
def test_a_job_in_the_background_leaves_the_terminal_to_the_shell(shell, tmp_path):
    shell.type(f"{command(tmp_path, '--seconds', '1.5')} &\n")
    shell.see("listening on")
    assert shell.modes == shell.before
    shell.type("echo typed-$((40 + 2))\n")
    shell.see(r"typed-\$")  # what is typed is seen
    shell.see("typed-42")
    shell.see("object")  # the summary
    shell.type("wait; echo over-$((1 + 1))\n")
    shell.see("over-2")
    assert "\x1b[?25l" not in shell.written
    assert "nothing is recorded yet" not in shell.written
    assert shell.modes == shell.before


@pytest.mark.long
def test_a_job_from_the_background_draws_once_it_is_fetched(shell, tmp_path):
    shell.type(f"{command(tmp_path)} &\n")
    shell.see("listening on")
    shell.type("fg\n")
    shell.see(r"ben +free")
    assert not echoes(shell)
    shell.type("\x03")
    shell.settle(lambda: shell.modes == shell.before and not shell.screen.hidden)


def test_a_stopped_job_gives_the_terminal_back_and_takes_it_again(shell, tmp_path):
    shell.type(f"{command(tmp_path)}\n")
    shell.see(r"ben +free")
    assert not echoes(shell)
    shell.type("\x1a")
    shell.see("Stopped")
    assert shell.modes == shell.before
    assert not shell.screen.hidden
    assert "ben  free" not in shell.screen.text, "the table is gone"
    written = len(shell.written)
    shell.type("echo typed-$((40 + 2))\n")
    shell.see("typed-42")
    assert "\x1b[" not in shell.written[written:], "nothing is drawn over the prompt"
    shell.type("fg\n")
    shell.see(r"ben +free")
    shell.settle(lambda: not echoes(shell))
    shell.type("\x1a")
    shell.settle(lambda: shell.modes == shell.before)
    shell.see("Stopped")
    end_stopped_job(shell)
    assert shell.modes == shell.before


def end_stopped_job(shell: JobShell) -> None:
    shell.type("kill -9 %1; echo killed-$((1 + 1))\n")
    shell.see("killed-2")


@pytest.mark.parametrize("key", ["\x03", long("\x1a")])
def test_a_drawing_that_was_killed_leaves_no_silent_terminal(shell, tmp_path, key):
    shell.type(f"{command(tmp_path)}\n")
    shell.see(r"ben +free")
    assert not echoes(shell)
    os.kill(shell.drawing(), signal.SIGKILL)
    shell.type(key)
    shell.settle(lambda: shell.modes == shell.before and not shell.screen.hidden)
    if key == "\x1a":
        end_stopped_job(shell)
