"""A line at a terminal is waited for so that Ctrl-C interrupts it at any moment; from a pipe it is read as it is."""

import io
import os
import signal
import sys

import pytest

from cogrip.cli.terminal import platform
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
        looks.append(None)
        if len(looks) == 1:
            signal.raise_signal(signal.SIGINT)
        return [], [], []

    monkeypatch.setattr(platform.select, "select", select)
    with pytest.raises(KeyboardInterrupt):
        typed_line()
    assert len(looks) == 1


@pytest.mark.parametrize(
    ("written", "lines"), [(b"yes\nno\r\n", ["yes", "no"]), (b"one\ntwo", ["one", "two"]), (b"\n", [""]), (b"", [])]
)
def test_a_pipe_is_read_line_by_line_to_its_end(monkeypatch, written, lines):
    theirs, ours = os.pipe()
    os.write(ours, written)
    os.close(ours)
    with os.fdopen(theirs, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert [typed_line() for _ in lines] == lines
        with pytest.raises(EOFError):
            typed_line()


def test_what_is_no_file_is_read_as_it_is(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    assert typed_line() == "yes"
    with pytest.raises(EOFError):
        typed_line()
