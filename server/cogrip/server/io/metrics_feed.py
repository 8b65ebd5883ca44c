"""Server's half of its metrics: starts the metrics process and feeds it, without waiting."""

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from cogrip.machine.server_platform import POSIX, unblocked
from cogrip.server.snapshot import LENGTH_BYTES, Snapshot, encode

START_LIMIT_S = 20.0
END_LIMIT_S = 5.0
START_AGAIN_NS = 60_000_000_000
PIPE_BYTES = 1 << 20  # size of the pipe, for a server of thousands; the usual 64 KiB hold some 400 people
PROGRAM = (sys.executable, "-P", "-m", "cogrip.server.io.metrics_process")


class MetricsError(Exception):
    """The metrics cannot be served. The text says why and what to do."""


class MetricsFeed:
    """Feed of the metrics process; see `open_metrics`.

    port       where metrics are served
    answered   whether the process has answered
    not_taken  snapshots that the process could not take
    """

    def __init__(self, port: int, say: Callable[[str], None], clock: Callable[[], int], program: Sequence[str]) -> None:
        self.port = port
        self.not_taken = 0
        self._say = say
        self._clock = clock
        self._program = program
        self._rest = memoryview(b"")  # of the snapshot that found room in part
        self.answered = False
        self._complained = False
        self._process = self._start()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/metrics"

    def _start(self) -> subprocess.Popen[bytes]:
        """Raises OSError."""
        self._started_ns = self._clock()
        self._rest = memoryview(b"")
        self.answered = False
        process = subprocess.Popen(
            [*self._program, str(self.port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert process.stdin is not None
        unblocked(process.stdin, PIPE_BYTES)
        return process

    def await_answer(self, limit_s: float) -> str:
        """Return why the process cannot listen; "" where it listens, or has not answered yet."""
        stream = self._process.stdout
        assert stream is not None
        if self.answered or not select.select([stream], [], [], limit_s)[0]:
            return ""
        self.answered = True
        line = stream.readline()  # one write of its: whole, or the end
        try:
            answer = json.loads(line)
        except ValueError:
            return "its process ended before it said where it listens"
        self.port = answer.get("port", self.port)
        return str(answer.get("trouble", ""))

    def put(self, snapshot: Snapshot) -> None:
        """Hand a snapshot over, whole or not at all. Never waits, never raises.

        A process that died is started again, at most once a minute: that call alone takes 0.5 ms and more.
        """
        if self._process.poll() is not None:
            self.not_taken += 1
            self._revive()
            return
        if not self.answered:
            self._read_answer()
        if not self._flush():
            self.not_taken += 1
            return
        body = encode(snapshot)
        whole = len(body).to_bytes(LENGTH_BYTES, "big") + body
        self._rest = memoryview(whole)
        if not self._flush() and len(self._rest) == len(whole):  # what has begun goes on next time
            self._rest = memoryview(b"")
            self.not_taken += 1

    def _read_answer(self) -> None:
        """Read the answer of a process that was started again."""
        trouble = self.await_answer(0.0)
        if trouble:
            self._complain(trouble)
        elif self.answered and self._complained:
            self._complained = False
            self._say(f"/metrics and /healthz are served again, on 127.0.0.1:{self.port}")

    def _flush(self) -> bool:
        """Return whether the pipe has taken everything."""
        assert self._process.stdin is not None
        try:
            while self._rest:
                self._rest = self._rest[os.write(self._process.stdin.fileno(), self._rest) :]
        except OSError:  # full, or closed: noticed next time
            return False
        return True

    def _complain(self, why: str) -> None:
        if not self._complained:
            self._complained = True
            self._say(f"/metrics and /healthz are not served: {why}; tried again once a minute")

    def _revive(self) -> None:
        ended = self.await_answer(0.0) or f"their process ended with code {self._process.returncode}"
        self._complain(ended)
        if self._clock() - self._started_ns < START_AGAIN_NS:
            return
        self._close_pipes()
        try:
            self._process = self._start()
        except OSError as error:
            self._complain(str(error.strerror))

    def _close_pipes(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):
                stream.close()

    def close(self) -> None:
        """End the process."""
        self._close_pipes()
        try:
            self._process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def open_metrics(
    port: int,
    say: Callable[[str], None],
    clock: Callable[[], int] = time.monotonic_ns,
    program: Sequence[str] = PROGRAM,
) -> MetricsFeed:
    """Serve metrics on 127.0.0.1:`port`, 0 for a free one. Raises MetricsError.

    Call it before the loop takes real-time priority. say: reports trouble, once
    """
    if not POSIX:
        raise MetricsError("metrics are not served on Windows: leave --metrics out")
    try:
        feed = MetricsFeed(port, say, clock, program)
    except OSError as error:
        raise MetricsError(f"metrics are not served: {error.strerror or error}; leave --metrics out") from None
    trouble = feed.await_answer(START_LIMIT_S)
    if not feed.answered:
        trouble = f"its process said nothing for {START_LIMIT_S:g} s"
    if trouble:
        feed.close()
        raise MetricsError(f"metrics cannot be served on 127.0.0.1:{port}: {trouble}; choose another --metrics port")
    return feed
