"""`cogrip serve --workers N`: the front process of several workers (docs/scaling.md)."""

import os
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

import msgspec

from cogrip.cli.session.log_lines import LogLines
from cogrip.cli.session.server_state import front_channel_of
from cogrip.cli.session.worker import Job
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.platform import system
from cogrip.machine.server_platform import memory_file
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.network_rate import RateChoice
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.server.hosting.workers.administration import Administration
from cogrip.server.hosting.workers.front import DYING, Front, FrontChannel, shares
from cogrip.server.hosting.workers.pool import START_LIMIT_S, WorkerPool
from cogrip.server.hosting.workers.steering import Steering, open_public, replaces_safely
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.control import Control
from cogrip.server.io.metrics_feed import MetricsError, MetricsFeed, open_metrics
from cogrip.server.io.state_folder import StateError, StateFolder
from cogrip.server.io.udp_port import HostError, ServeError, cannot_listen

ORPHANS_S = 1.0  # time for which workers of a front that was killed may still have the port


class FrontJob(NamedTuple):
    """Parts and settings of a front. runs: folder of this run."""

    rooms: Sequence[Settings]
    workers: int
    host: str
    port: int
    folder: StateFolder | None
    authenticator: TokenAuthenticator | None
    encrypted: bool
    fresh: bool
    runs: Path | None
    record: bool
    report: bool
    rates: dict[str, RateChoice]  # choice of the rate of each room that asked for "auto"
    floor_bytes: int  # bytes of a disk that recordings leave free
    hand_over_s: float | None  # wait for the next server, as `LiveServer.hand_over_s`


class FrontServer:
    """Front with its workers: `open` binds and starts them, `run` serves, `end` waits for them."""

    def __init__(self, job: FrontJob, stop: Stop, lines: LogLines, stack: ExitStack) -> None:
        self._job, self._stop, self._lines = job, stop, lines
        with Problem.of(ServeError), BadInput.of(HostError):
            try:
                self._public = stack.enter_context(open_public(job.host, job.port, ORPHANS_S))
            except OSError as error:
                raise cannot_listen(job.host, job.port, error) from None
        self.bound: tuple[str, int] = self._public.getsockname()[:2]
        self._job_file = -1
        names = [room.name for room in job.rooms]
        groups = shares(names, job.workers)
        self._steering: Steering | None = None
        with suppress(OSError):  # a kernel without such programs: then each path is a socket of its own
            if replaces_safely(platform.release()):
                self._steering = Steering(self._public, len(groups), stack)
        if self._steering is None:
            lines.say(
                "each person gets a socket of the worker's: this kernel steers nobody, or not safely (docs/scaling.md)"
            )
        own = [each.fileno() for each in self._steering.own] if self._steering else []
        self._pool = WorkerPool(groups, self._start, job.fresh, self._public.fileno(), own)

    def _start(self, number: int, link_end: int) -> subprocess.Popen[bytes]:
        """Start a worker; what it says goes where this process says its own."""
        environ = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
        handles = (link_end, self._job_file)
        with system.end_signals_held():
            return subprocess.Popen(
                [sys.executable, "-P", "-m", "cogrip.cli.session.worker_process", *map(str, handles), str(number)],
                stdin=subprocess.DEVNULL, env=environ, **system.own_session(*handles),
            )  # fmt: skip

    def begin(self, metrics: int | None, stack: ExitStack) -> MetricsFeed | None:
        """Start the workers, and wait until they serve. Raises Problem."""
        job, say = self._job, self._lines.say
        for_workers = Job(
            tuple(job.rooms), str(job.folder.path) if job.folder else "", str(job.runs or ""), job.record, job.report,
            self._lines.form, metrics is not None, job.rates, job.floor_bytes, job.hand_over_s,
        )  # fmt: skip
        try:
            self._job_file = memory_file(msgspec.json.encode(for_workers))
            stack.callback(os.close, self._job_file)
            if job.authenticator is not None:  # before anybody resumes a restored seat
                self._pool.void(job.authenticator.revoked(), job.authenticator.expired())
            self._pool.begin()
            stack.callback(self._kill)
            open_channel: Callable[[Callable[[Address], bool]], FrontChannel] = lambda asks: front_channel_of(  # noqa: E731
                asks, job.rooms, job.folder if job.encrypted else None
            )
            self.front = Front(
                self._public, job.rooms, self._pool, self._stop, say, open_channel, job.authenticator, self._steering
            )
            feed = None if metrics is None else open_metrics(metrics, say)
            control = Control(job.folder) if job.folder else None
        except (MetricsError, StateError) as error:
            raise Problem(str(error)) from None
        except OSError as error:
            raise _not_started(error) from None
        self.administration = Administration(
            self.front, say, VERSION, control=control, authenticator=job.authenticator, metrics=feed,
            reload=self._stop.take_reload,
        )  # fmt: skip
        try:
            ready = self.front.await_ready(START_LIMIT_S)
        except OSError as error:
            raise _not_started(error) from None
        if not ready and not self._stop.reason:
            self.administration.end()
            how = (
                "one of the workers ended as it began"
                if self._pool.replaced
                else f"the workers did not begin within {START_LIMIT_S:g} s"
            )
            raise Problem(f"serve: {how}; see what they said above")
        return feed

    def run(self, seconds: float | None) -> int:
        """Serve until stopped, at most for `seconds`. Return the exit code: the worst of the workers'."""
        self.administration.begin()
        try:
            self.front.run(seconds)
        finally:
            codes = self._pool.end()
            self.administration.end()
        self._lines.say(self._stop.reason)
        dropped = {name: count for name, count in sorted(self.front.drops().items()) if count}
        if dropped:
            self._lines.say(f"at the front: {', '.join(f'{name}: {count}' for name, count in dropped.items())}")
        return 1 if any(codes) or self._stop.reason == DYING else 0

    def _kill(self) -> None:
        """End whoever has not ended by itself."""
        for worker in self._pool.workers:
            if worker.process.poll() is None:
                worker.process.kill()
                worker.process.wait()


def _not_started(error: OSError) -> Problem:
    return Problem(f"serve: a worker cannot be started: {error.strerror}; give fewer --workers")
