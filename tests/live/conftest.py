"""Real processes over real sockets. Nothing sleeps: a test waits for what a process says, or for its end."""

import json
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.live.held_arms import Arm, Session, Spoken
from tests.stalls import MACHINE_STALLED
from tests.terminal import Terminal


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """These come first: they wait more than they compute, and other workers have something to do meanwhile."""
    here = Path(__file__).parent
    items.sort(key=lambda item: item.path.parent != here)


class Process(Spoken):
    """A `cogrip` command whose output is searched from its beginning."""

    def __init__(self, *arguments: str, code: str = "") -> None:
        super().__init__(*arguments, stdin=subprocess.DEVNULL, code=code)

    def hear(self, pattern: str) -> re.Match[str]:
        """Wait until it has printed a match, or nothing more can come."""
        self.rewind()
        return super().hear(pattern)

    def end(self) -> int:
        """Wait for the exit code. A test is skipped where the machine itself stalled: the watchdog is right to let go then."""
        code = super().end()
        if "watchdog: the loop was away" in self.said:
            pytest.skip(f"{MACHINE_STALLED} from a loop for 100 ms: no live session can be judged on it now")
        return code

    def signal(self, number: int) -> None:
        self.popen.send_signal(number)


Relay = Callable[..., tuple[Process, tuple[str, int], Callable[[], dict]]]


@pytest.fixture
def run() -> Iterator[Callable[..., Process]]:
    """Start `cogrip ARGUMENTS`; whatever still runs at the end of the test is ended."""
    started: list[Process] = []

    def start(*arguments: str | Path, code: str = "") -> Process:
        process = Process(*map(str, arguments), code=code)
        started.append(process)
        return process

    yield start
    for process in started:
        process.stop()


@pytest.fixture
def serve(run: Callable[..., Process], tmp_path: Path) -> Callable[..., tuple[Process, int]]:
    """Start a server on a free port; gives it and the port."""

    def start(config: Path, *arguments: str) -> tuple[Process, int]:
        server = run(
            "serve", config, "--port", "0", "--seconds", "600", "--runs", tmp_path / "server", "--no-report", *arguments
        )
        return server, int(server.hear(r"listening on \S+:(\d+)")[1])

    return start


@pytest.fixture
def relay(run, tmp_path) -> Relay:
    """Start a relay; gives it, where it listens, and what ends it and gives its summary."""

    def start(to: str, *arguments: str | Path, listen: str = "127.0.0.1:0"):
        summary = tmp_path / f"relay {len(list(tmp_path.iterdir()))}.json"
        process = run("relay", "--to", to, "--listen", listen, "--json", summary, "--seconds", "600", *arguments)
        found = process.hear(r"relaying from (\S+):(\d+) ")

        def end() -> dict:
            process.signal(signal.SIGINT)
            assert process.end() == 0, process.said
            return json.loads(summary.read_text())

        return process, (found[1].strip("[]"), int(found[2])), end

    return start


@pytest.fixture
def start(tmp_path, monkeypatch) -> Iterator[Callable[..., Spoken]]:
    """Start `cogrip ARGUMENTS`; whatever still runs at the end of the test is ended."""
    monkeypatch.setenv("COGRIP_CALIBRATION", str(tmp_path / "calibration"))
    started: list[Spoken] = []

    def run(*arguments: object, stdin: int = subprocess.DEVNULL, code: str = "") -> Spoken:
        started.append(Spoken(*map(str, arguments), stdin=stdin, code=code))
        started[-1].company = started
        return started[-1]

    def arm(name: str, hand: str, *arguments: str, wire: str = "serial") -> Arm:
        started.append(Arm(tmp_path / name, hand, *arguments, wire=wire))
        started[-1].company = started
        return started[-1]

    run.arm = arm
    run.all = started
    yield run
    for process in reversed(started):
        process.stop()


@pytest.fixture
def at_terminal(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    """Start `cogrip ARGUMENTS` at a terminal of its own; whatever still runs at the end of the test is ended."""
    opened: list[Terminal] = []

    def start(*arguments: object, **size: int) -> Terminal:
        opened.append(Terminal(*arguments, "--runs", tmp_path / "runs", "--no-report", **size))
        return opened[-1]

    yield start
    for terminal in opened:
        terminal.close()


@pytest.fixture
def session(start, tmp_path) -> Session:
    return Session(start, tmp_path)
