"""Real processes over real sockets. Nothing sleeps: a test waits for what a process says, or for its end."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.live.held_arms import Arm, Session, Spoken

LIMIT_S = 120.0  # for anything a process is waited for; a hang then fails with what was said


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """These come first: one worker has all of them, so no two sessions in real time take the processors from each other."""
    items.sort(key=lambda item: item.path.parent != Path(__file__).parent)


class Process:
    """A `cogrip` command whose words are read as they come."""

    def __init__(self, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-m", "cogrip.cli", *arguments],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "200", "NO_COLOR": "1"},
        )  # fmt: skip
        self.said = ""
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

    def hear(self, pattern: str) -> re.Match[str]:
        """Wait until it has said something that matches, or nothing more can come."""
        with self._news:
            self._news.wait_for(lambda: re.search(pattern, self.said) or self._silent, LIMIT_S)
            found = re.search(pattern, self.said)
        assert found, f"never said {pattern!r}, but:\n{self.said}"
        return found

    def end(self) -> int:
        """Wait for the exit code. A test is skipped where the machine itself stalled: the watchdog is right to let go then."""
        try:
            code = self.popen.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            pytest.fail(f"did not end in {LIMIT_S:g} s, but said:\n{self.said}")
        self.read_to_the_end()
        if "watchdog: the loop was away" in self.said:
            pytest.skip(
                "this machine took the processor away from a loop for 100 ms: no live session can be judged on it now"
            )
        return code

    def read_to_the_end(self) -> None:
        """Wait until the process, and whoever has its output, says no more."""
        self._listener.join(LIMIT_S)

    def signal(self, number: int) -> None:
        self.popen.send_signal(number)


@pytest.fixture
def run() -> Iterator[Callable[..., Process]]:
    """Start `cogrip ARGUMENTS`; whatever still runs at the end of the test is ended."""
    started: list[Process] = []

    def start(*arguments: str | Path) -> Process:
        process = Process(*[str(argument) for argument in arguments])
        started.append(process)
        return process

    yield start
    for process in started:
        if process.popen.poll() is None:
            process.signal(signal.SIGKILL)
        process.popen.wait()
        if process.popen.stdout:
            process.popen.stdout.close()


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
def start(tmp_path, monkeypatch) -> Iterator[Callable[..., Spoken]]:
    """Start `cogrip ARGUMENTS`; whatever still runs at the end of the test is ended."""
    monkeypatch.setenv("COGRIP_CALIBRATION", str(tmp_path / "calibration"))
    started: list[Spoken] = []

    def run(*arguments: object, stdin: int = subprocess.DEVNULL, code: str = "") -> Spoken:
        started.append(Spoken(*map(str, arguments), stdin=stdin, code=code))
        return started[-1]

    def arm(name: str, hand: str, *arguments: str, wire: str = "serial") -> Arm:
        started.append(Arm(tmp_path / name, hand, *arguments, wire=wire))
        return started[-1]

    run.arm = arm
    run.all = started
    yield run
    for process in reversed(started):
        process.stop()


@pytest.fixture
def session(start, tmp_path) -> Session:
    return Session(start, tmp_path)
