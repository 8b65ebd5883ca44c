"""`cogrip lsl`: a running session as streams of the Lab Streaming Layer."""

import csv
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from cogrip.cli.session.join_target import target_of, typed
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import Problem, above_zero
from cogrip.client.io.paths import JoinError
from cogrip.client.observer import ObserverCore
from cogrip.client.observer_loop import LiveObserver
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.wire.session import ClientSession
from cogrip.view.io.lab_outlet import LabOutlet, OutletError
from cogrip.view.lab_streams import LabStreams

CLOCK_EVERY_NS = 1_000_000_000


def lsl(
    server: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *more: Annotated[str, Parameter(show=False)],
    room: str = "",
    insecure: Annotated[bool, Parameter(negative="")] = False,
    seconds: float | None = None,
    clock: Path | None = None,
) -> int:
    """Offer a running session to the Lab Streaming Layer: its state and its markers, beside EEG, gaze and motion capture.

    Two streams, `cogrip ROOM state` and `cogrip ROOM markers`, for LabRecorder or any inlet. Each sample has the time at which
    the server made it. Exit code 1 where the session breaks off. Needs the extra `lsl`.

    Parameters
    ----------
    server
        A join link, for observing will do, or HOST:PORT of a server without encryption; - reads it from standard input.
    room
        Room to offer; any if not given.
    insecure
        Observe a HOST:PORT that is not this machine without encryption.
    seconds
        End after this time.
    clock
        Write the offset of the server's clock against this machine's into this CSV file, once a second.
    """
    above_zero("--seconds", seconds)
    say = make_console(soft_wrap=True).print
    target = target_of(typed(server, more), room, insecure, "", "")
    stop = Stop()
    with on_signals(stop), closing(target.paths(insecure)) as paths, ExitStack() as files:
        core = ObserverCore(ClientSession(target.observer()))
        with Problem.of(JoinError):
            paths.connect(core, stop)
        welcome = core.session.welcome
        if welcome is None:
            raise Problem(core.session.failed or stop.reason or "the server gave no place to observe")
        with Problem.of(OutletError):
            outlet = LabOutlet(welcome.settings, f"{target.host}:{target.port}")
        rows = _ClockFile(clock, files) if clock else None
        streams = LabStreams(welcome.settings)
        say(
            f"room {welcome.settings.room} is offered: cogrip {welcome.settings.room} state, and markers; Ctrl-C ends it"
        )

        def push(seen: ObserverCore, now_ns: int) -> None:
            outlet.push(streams.state(seen), streams.markers(seen))
            if rows is not None:
                rows.write(seen, now_ns)

        with Problem.of(JoinError):
            failed = LiveObserver(core, paths, stop, say, push, seconds).run()
    if failed:
        say(f"the session broke off: {failed}")
    return 1 if failed else 0


class _ClockFile:
    """The offset of both clocks over time."""

    def __init__(self, path: Path, files: ExitStack) -> None:
        with Problem.of_files(path, doing="cannot be written: "):
            file = files.enter_context(path.open("w", newline="", encoding="utf-8", buffering=1))
        self._writer: Any = csv.writer(file)
        self._writer.writerow(["lsl_s", "server_s", "uncertainty_s"])
        self._next_ns = 0

    def write(self, core: ObserverCore, now_ns: int) -> None:
        """Write a row where one is due."""
        offset_ns, uncertainty_ns = core.session.clock.offset_ns, core.session.clock.uncertainty_ns
        if offset_ns is None or uncertainty_ns is None or now_ns < self._next_ns:
            return
        self._next_ns = now_ns + CLOCK_EVERY_NS
        self._writer.writerow([f"{each * 1e-9:.6f}" for each in (now_ns, now_ns + offset_ns, uncertainty_ns)])
