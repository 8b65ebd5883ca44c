"""A terminal of some size with a command in it: what it shows, keys, how it was left."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
from collections.abc import Callable

from tests import forked
from tests.fair_time import FairTime

LIMIT_S = 60.0
_CONTROL = re.compile(r"\x1b\[([?0-9;]*)([A-Za-z])")
_SHELL = """
import fcntl, os, signal, sys, termios
from cogrip.cli.main import main
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
command = os.fork()
if not command:
    sys.exit(main())
signal.signal(signal.SIGINT, signal.SIG_IGN)
sys.exit(abs(os.waitstatus_to_exitcode(os.waitpid(command, 0)[1])))
"""  # it has the terminal, as a shell has: the command's end is not the terminal's


_JOBS = """
import fcntl, os, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.environ["PS1"] = "$ "
os.execvp("sh", ["sh", "-i"])
"""


class Screen:
    """Lines as a terminal shows them, of what rich writes: text, line ends, cursor up, erase line, colours."""

    def __init__(self, columns: int) -> None:
        self.columns = columns
        self.lines = [""]
        self.row = self.column = 0
        self.hidden = False  # the cursor

    def feed(self, text: str) -> None:
        at = 0
        while at < len(text):
            if found := _CONTROL.match(text, at):
                self._control(found[1], found[2])
            else:
                self._put(text[at])
            at = found.end() if found else at + 1

    def _control(self, numbers: str, letter: str) -> None:
        if letter == "A":
            self.row = max(0, self.row - int(numbers or 1))
        elif letter == "K":
            self.lines[self.row] = "" if numbers == "2" else self.lines[self.row][: self.column]
        elif letter in "hl" and numbers == "?25":
            self.hidden = letter == "l"

    def _put(self, letter: str) -> None:
        if letter == "\r":
            self.column = 0
        elif letter == "\n":
            self._down()
        else:
            if self.column == self.columns:
                self.column = 0
                self._down()
            line = self.lines[self.row].ljust(self.column)
            self.lines[self.row] = line[: self.column] + letter + line[self.column + 1 :]
            self.column += 1

    def _down(self) -> None:
        self.row += 1
        if self.row == len(self.lines):
            self.lines.append("")

    @property
    def text(self) -> str:
        return "\n".join(line.rstrip() for line in self.lines)


class Terminal:
    """A `cogrip` command at a terminal of its own."""

    _program = _SHELL

    def __init__(self, *arguments: object, columns: int = 80, lines: int = 24) -> None:
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        self._theirs = theirs  # kept, so that one can still ask how the terminal was left
        self.before = termios.tcgetattr(theirs)
        environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "LINES", "NO_COLOR")}
        self.process = forked.start(
            *arguments, code=self._program, stdin=theirs, stdout=theirs, stderr=theirs,
            env={**environment, "TERM": "xterm-256color"},
        )  # fmt: skip
        self.screen = Screen(columns)
        self.written = ""

    def see(self, wanted: str | Callable[[str], bool]) -> str:
        """Wait until the screen shows something that matches; gives the screen."""
        fits = wanted if callable(wanted) else lambda text: re.search(wanted, text) is not None
        given = FairTime()
        while not fits(self.screen.text):
            assert given.spent_s() < LIMIT_S, f"never showed {wanted!r}, but:\n{self.screen.text}"
            assert self._take(0.2) or self.process.poll() is None, f"ended without {wanted!r}:\n{self.screen.text}"
        return self.screen.text

    def settle(self, good: Callable[[], bool]) -> None:
        """Wait until something holds, taking what is still written."""
        given = FairTime()
        while not good():
            assert given.spent_s() < LIMIT_S, self.screen.text
            self._take(0.05)

    def _take(self, limit_s: float) -> bool:
        """Take what is written by then; return whether anything was."""
        if not select.select([self._ours], [], [], limit_s)[0]:
            return False
        text = os.read(self._ours, 1 << 16).decode("utf-8", "replace")
        self.written += text
        self.screen.feed(text)
        return True

    def kill(self) -> None:
        """End the command at once, not its shell."""
        os.kill(forked.child_of(self.process.pid), signal.SIGKILL)

    def type(self, keys: str) -> None:
        os.write(self._ours, keys.encode())

    @property
    def modes(self) -> list:
        return termios.tcgetattr(self._theirs)

    def end(self) -> int:
        """Wait for the exit code, taking all that is still written."""
        self.settle(lambda: self.process.poll() is not None)
        while self._take(0.0):
            pass
        return self.process.returncode

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        os.close(self._ours)
        os.close(self._theirs)


class JobShell(Terminal):
    """A shell at a terminal of its own, with jobs: a line typed is a command."""

    _program = _JOBS

    def drawing(self) -> int:
        """Return the process id of what draws the live table of the only command here."""
        return forked.child_of(forked.child_of(self.process.pid), "live_views")
