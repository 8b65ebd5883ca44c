"""Commands of cogrip and emulated arms as processes, heard and asked."""

import functools
import json
import os
import re
import select
import signal
import subprocess
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import hypot
from pathlib import Path

import msgspec
import pytest

from cogrip.protocol.recording.reader import Follower, RecordingError
from cogrip.protocol.recording.records import Tick

from tests import forked
from tests.fair_time import FairTime
from tests.stalls import MACHINE_STALLED

LIMIT_S = 60.0  # for anything that is waited for, in time as the machine gives it
CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DEMO = CONFIGS / "demo.toml"
WITHIN = ()  # the impedance follows each arm: the 2DIY carries the least
AWAY = (
    r"encoder \w jumped by|no reply for 50 ms"  # says a driver whose arm's process, or itself, was away for 10, 50 ms
)
STALLED = (
    "the loop was away", "device stall", "its guard process did not start within",
    "the loop must not wait for a device",  # no arm here blocks: the loop lost its processor within a read, or a write
)  # fmt: skip
FREE = "push&force_n=0"  # nobody holds it


OWN_TERMINAL = (
    "import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    "from cogrip.cli.main import main; sys.exit(main(sys.argv[1:]))"
)
WITHOUT_PLOTS = (  # its report is a page of tables
    "import sys; from cogrip.results.report import page; page.draw_plots = lambda run: []\n"
    "from cogrip.cli.main import main; sys.exit(main())"
)
BROKEN_LAW = """
import sys
from cogrip.client.core import ClientCore
whole = ClientCore.act
def act(self, now_ns):
    if self.tick > 1024 and abs(self.force_n[0]) > 0.05:
        raise ZeroDivisionError("a bug in the law, as it pushes")
    return whole(self, now_ns)
ClientCore.act = act
from cogrip.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


class Spoken:
    """A `cogrip` command that can be told something, and whose words are read as they come.

    runs: the folder of its recordings, set by whoever starts one that records
    """

    runs: Path

    def __init__(self, *arguments: str, stdin: int = subprocess.PIPE, code: str = "") -> None:
        self.popen = forked.start(
            *arguments, code=code, stdin=stdin, env={**os.environ, "COLUMNS": "200", "NO_COLOR": "1"}
        )
        self.said = ""
        self.expected_stalls = 0
        self.company: list[Spoken] = []  # whose stall would make what is waited for here never come
        self._heard = 0
        self._silent = False  # it says no more
        self._news = threading.Condition()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            with self._news:
                self.said += line
                self._news.notify_all()
        with self._news:
            self._silent = True
            self._news.notify_all()
        with suppress(OSError):  # Whoever fails before it ends leaves nobody else to close them.
            for stream in filter(None, (self.popen.stdout, self.popen.stdin)):
                stream.close()

    def tell(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(f"{line}\n")
        self.popen.stdin.flush()

    @property
    def stalled(self) -> bool:
        """Return whether the machine took the processor away from it for too long, as it says itself."""
        return sum(self.said.count(words) for words in STALLED) > self.expected_stalls

    def hear(self, pattern: str) -> re.Match[str]:
        """Wait until it says something that matches, after what was heard before."""

        def said() -> bool:
            return self._silent or re.search(pattern, self.said[self._heard :]) is not None

        given = FairTime()
        with self._news:
            while given.spent_s() < LIMIT_S:
                if self._news.wait_for(said, 1.0) or any(process.stalled for process in self.company):
                    break
            found = re.search(pattern, self.said[self._heard :])
            assert found, f"never said {pattern!r} any more, but:\n{self.said}"
            self._heard += found.end()
        return found

    def rewind(self) -> None:
        """Search all output again, from its beginning."""
        self._heard = 0

    def read_to_the_end(self) -> None:
        """Wait until the process, and whoever has its output, prints no more."""
        self._listener.join(LIMIT_S)

    def end(self) -> int:
        """Return its exit code."""
        given = FairTime()
        while given.spent_s() < LIMIT_S:
            with suppress(subprocess.TimeoutExpired):
                code: int = self.popen.wait(1.0)
                self.read_to_the_end()
                return code
            if any(process.stalled for process in self.company):
                break
        pytest.fail(f"did not end in {LIMIT_S:g} s, or somebody stalled, but said:\n{self.said}")

    def stop(self) -> None:
        """End it, whatever it does."""
        self.popen.kill()
        self.popen.wait()
        self.read_to_the_end()
        for stream in (self.popen.stdin, self.popen.stdout):
            if stream is not None:
                stream.close()


class Arm(Spoken):
    """An emulated arm, a vintage Phantom or a Haply 2DIY. Its address with the keys it needs, and what it truly does."""

    def __init__(self, link: Path, hand: str, *arguments: str, wire: str = "serial") -> None:
        super().__init__("devices", "emulate", wire, "--link", str(link), "--hand", hand, *arguments)
        forked.never_late(self.popen)
        self.link = link
        self.hear(f"behind {wire}:")
        self.port = f"{wire}:{link}"
        self.address = self.port + ("?pose=home" if wire == "serial" else "?model=2diy&pose=home")

    def force_n(self) -> float:
        """Return the force with which it pushes now [N]."""
        self.tell("status")
        return hypot(*map(float, self.hear(r"pushes with \(([^)]*)\) N")[1].split(", ")))

    def fault(self, verb: str) -> None:
        self.tell(verb)
        self.hear(f"fault {verb}")

    def pushes(self, wanted: bool) -> None:
        """Wait until it pushes, or until it does not."""
        until(lambda: (self.force_n() > 0.02) is wanted, f"{self.port} pushes: {wanted}", company=self.company)


def until(good: Callable[[], bool], what: str, every_s: float = 0.02, company: Sequence[Spoken] = ()) -> None:
    """Look fifty times a second: a process that is asked without a pause has no time for its wire and its loop.

    company: processes of which none may stall meanwhile.
    """
    given = FairTime()
    while not good():
        assert given.spent_s() < LIMIT_S, f"never: {what}"
        assert not any(process.stalled for process in company), f"stalled before: {what}"
        select.select([], [], [], every_s)


def fairly(test: Callable[..., None]) -> Callable[..., None]:
    """A test is skipped where the machine itself stalled: then a watchdog is right to let go."""

    @functools.wraps(test)
    def judged(start, **fixtures) -> None:
        try:
            test(start=start, **fixtures)
        except (AssertionError, pytest.fail.Exception):
            for process in start.all:
                if process.stalled:
                    pytest.skip(f"{MACHINE_STALLED} for too long: {process.said}")
            raise

    return judged


class Session:
    """A server, and people who join it with their arms."""

    def __init__(self, start, folder: Path) -> None:
        self._start = start
        self._folder = folder
        self.server = start(
            "serve", DEMO, "--port", "0", "--seconds", "600", "--runs", folder / "server", "--no-report", *WITHIN
        )
        self.port = self.server.hear(r"listening on \S+:(\d+)")[1]

    def join(self, name: str, device: str, *arguments: str, **how) -> Spoken:
        person = self._start(
            "join", f"127.0.0.1:{self.port}", "--name", name, "--device", device, "--runs", self._folder / name,
            "--no-report", *arguments, **how,
        )  # fmt: skip
        person.hear(f"{name} holds cube")
        return person

    def state(self, name: str) -> str:
        """The newest one in the recording of a person."""
        try:
            (path,) = (self._folder / name).glob(f"*/client-{name}.mcap")
            newest = Follower(path).look().get(f"/{name}/tick")
        except (ValueError, OSError, RecordingError):
            return ""
        return msgspec.json.decode(newest.payload, type=Tick).state if newest else ""

    def until_state(self, name: str, state: str) -> None:
        """Wait until the recording of a person says so, or somebody has stalled, who was not to."""
        until(lambda: self.state(name) == state, f"{name}'s recording says {state}", company=self._start.all)

    def summary(self, name: str) -> dict:
        (path,) = (self._folder / name).glob("*/summary.json")
        return json.loads(path.read_text())

    def close(self, *people: Spoken) -> None:
        """Everyone leaves as they should; the whole was passive."""
        for person in people:
            person.popen.send_signal(signal.SIGINT)
        for person in people:
            assert person.end() == 0, person.said
        self.server.popen.send_signal(signal.SIGINT)
        assert self.server.end() == 0, self.server.said
        assert self.summary("server")["passive"] is not False  # not known where a client was killed
