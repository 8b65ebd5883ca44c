"""A line at a terminal is waited for so that Ctrl-C interrupts it at any moment; from a pipe it is read as it is."""

import io
import os
import signal
import sys
import time

import pytest

from cogrip.cli.terminal import typed_line as module
from cogrip.cli.terminal.typed_line import typed_line

pty = pytest.importorskip("pty", reason="pseudo terminals are of POSIX systems")


@pytest.fixture
def keyboard(monkeypatch):
    """The other end of the terminal that standard input is."""
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "r") as stdin, os.fdopen(ours, "wb", buffering=0) as typed:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield typed


def test_lines_of_a_terminal_come_one_by_one(keyboard):
    keyboard.write(b"first\nsecond\n")
    assert [typed_line(), typed_line()] == ["first", "second"]


def test_ctrl_c_just_before_the_terminal_is_looked_at_interrupts(keyboard, monkeypatch):
    """The signal's handler has run, and nothing was raised yet, when the wait begins: as where Python looks too early."""
    looks = []

    def select(*_):
        looks.append(time.monotonic())
        if len(looks) == 1:
            signal.raise_signal(signal.SIGINT)
        return [], [], []

    monkeypatch.setattr(module.select, "select", select)
    with pytest.raises(KeyboardInterrupt):
        typed_line()
    assert len(looks) == 1


def test_a_pipe_is_read_to_its_end(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    assert typed_line() == "yes"
    with pytest.raises(EOFError):
        typed_line()
