"""`cogrip serve --workers N`: the front process of several workers (docs/scaling.md)."""

import os
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress

import msgspec

from cogrip.cli.serving.front_socket import front_socket, say_drops
from cogrip.cli.serving.kept_runs import Keeping
from cogrip.cli.serving.log_lines import LogLines
from cogrip.cli.serving.server_state import front_channel_of
from cogrip.cli.serving.worker import WorkerJob
from cogrip.cli.terminal.problem import Problem
from cogrip.machine.platform import system
from cogrip.machine.server_platform import memory_file
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.version import VERSION
from cogrip.server.hosting.administration import Administration
from cogrip.server.hosting.placement import Served
from cogrip.server.hosting.workers.front import DYING, Front, FrontChannel, shares
from cogrip.server.hosting.workers.pool import START_LIMIT_S, WorkerPool
from cogrip.server.hosting.workers.steering import Steering, replaces_safely
from cogrip.server.io.control import Control
from cogrip.server.io.metrics_feed import MetricsFeed
from cogrip.server.io.state_folder import StateError

ORPHANS_S = 1.0  # time for which workers of a front that was killed may still have the port


class WorkerServer:
    """Placement of the rooms in worker processes: a front listens, `begin` starts the workers, `run` waits for their end."""

    def __init__(
        self, served: Served, workers: int, keeping: Keeping, fresh: bool, hand_over_s: float | None, stop: Stop,
        lines: LogLines, stack: ExitStack,
    ) -> None:  # fmt: skip
        """Listen. Raises Problem."""
        self._served, self._keeping, self._hand_over_s = served, keeping, hand_over_s
        self._stop, self._lines, self._stack = stop, lines, stack
        self._public = front_socket(served, stack, ORPHANS_S)
        self.bound: tuple[str, int] = self._public.getsockname()[:2]
        self._job_file = -1
        groups = shares([room.name for room in served.rooms], workers)
        self._steering: Steering | None = None
        with suppress(OSError):  # a kernel without such programs: then each path is a socket of its own
            if replaces_safely(platform.release()):
                self._steering = Steering(self._public, len(groups), stack)
        if self._steering is None:
            lines.say(
                "each person gets a socket of the worker's: this kernel steers nobody, or not safely (docs/scaling.md)"
            )
        own = [each.fileno() for each in self._steering.own] if self._steering else []
        self._pool = WorkerPool(groups, self._start, fresh, self._public.fileno(), own, served.templates)

    def _start(self, number: int, link_end: int) -> subprocess.Popen[bytes]:
        """Start a worker; what it says goes where this process says its own."""
        environ = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
        handles = (link_end, self._job_file)
        with system.end_signals_held():
            return subprocess.Popen(
                [sys.executable, "-P", "-m", "cogrip.cli.serving.worker_process", *map(str, handles), str(number)],
                stdin=subprocess.DEVNULL, env=environ, **system.own_session(*handles),
            )  # fmt: skip

    def begin(self, feed: MetricsFeed | None, told: Mapping[str, Sequence[str]]) -> Administration:
        """Start the workers, and wait until they serve. Raises Problem."""
        served, say, keeping = self._served, self._lines.say, self._keeping
        run_folder = keeping.begin(served.standing or served.rooms, say, self._stack)
        for_workers = WorkerJob(
            tuple(served.rooms), str(served.folder.path) if served.folder else "", str(run_folder or ""), served.record,
            served.report, self._lines.form, feed is not None, dict(served.rates), keeping.floor_bytes, self._hand_over_s,
            {name: tuple(spare) for name, spare in served.templates.items()}, served.empty_s,
        )  # fmt: skip
        authenticator, by_name = served.authenticator, {room.name: room for room in served.rooms}
        try:
            self._job_file = memory_file(msgspec.json.encode(for_workers))
            self._stack.callback(os.close, self._job_file)
            if authenticator is not None:  # before anybody resumes a restored seat
                self._pool.void(authenticator.revoked(), authenticator.expired())
            self._pool.begin()
            self._stack.callback(self._kill)
            open_channel: Callable[[Callable[[Address], bool]], FrontChannel] = lambda asks: front_channel_of(  # noqa: E731
                asks, served.rooms, served.key_folder
            )
            of_template = {name: by_name[spare[0]] for name, spare in served.templates.items()}
            self._front = Front(
                self._public, served.standing, self._pool, self._stop, say, open_channel, authenticator, self._steering,
                of_template,
            )  # fmt: skip
            control = Control(served.folder) if served.folder else None
        except StateError as error:
            raise Problem(str(error)) from None
        except OSError as error:
            raise _not_started(error) from None
        self._administration = Administration(
            self._front, say, VERSION, control=control, authenticator=authenticator, metrics=feed,
            reload=self._stop.take_reload,
        )  # fmt: skip
        try:
            ready = self._front.await_ready(START_LIMIT_S)
        except OSError as error:
            raise _not_started(error) from None
        if not ready and not self._stop.reason:
            self._administration.end()
            how = (
                "one of the workers ended as it began"
                if self._pool.replaced
                else f"the workers did not begin within {START_LIMIT_S:g} s"
            )
            raise Problem(f"serve: {how}; see what they said above")
        return self._administration

    def run(self, seconds: float | None) -> int:
        """See `Placement`. The exit code is the worst of the workers'."""
        try:
            self._front.run(seconds)
        finally:
            codes = self._pool.end()
            self._administration.end()
        self._lines.say(self._stop.reason)
        say_drops(self._front, self._lines.say)
        return 1 if any(codes) or self._stop.reason == DYING else 0

    def _kill(self) -> None:
        """End whoever has not ended by itself."""
        for worker in self._pool.workers:
            if worker.process.poll() is None:
                worker.process.kill()
                worker.process.wait()


def _not_started(error: OSError) -> Problem:
    return Problem(f"serve: a worker cannot be started: {error.strerror}; give fewer --workers")
