"""`cogrip serve` with all rooms in this process."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from cogrip.cli.runs.run_folder import leave_files
from cogrip.cli.serving.kept_runs import Keeping
from cogrip.cli.serving.log_lines import LogLines
from cogrip.cli.serving.server_state import channel_of
from cogrip.cli.session.live_views import ServeView, drawing
from cogrip.cli.session.network_rate import write_choice
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.screen import LiveScreen, may_draw
from cogrip.machine.stop import Stop
from cogrip.protocol.version import VERSION
from cogrip.results.reading.folder import SERVER_RECORDING, write_settings, write_warnings
from cogrip.results.verdict.verdict import came, succeeded
from cogrip.results.writing.summary import of_room
from cogrip.server.hosting.placement import Served
from cogrip.server.io.housekeeping import Housekeeping
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.metrics_feed import MetricsFeed
from cogrip.server.io.state_folder import StateError
from cogrip.server.io.trigger import Trigger
from cogrip.server.io.udp_socket import HostError, ServeError


class ServerHere:
    """Placement of all rooms in this process."""

    def __init__(
        self, served: Served, keeping: Keeping, fresh: bool, hand_over_s: float | None, trigger: Trigger | None, quiet: bool,
        stop: Stop, lines: LogLines, stack: ExitStack,
    ) -> None:  # fmt: skip
        """Listen. quiet: draw no table. Raises Problem."""
        self._served, self._keeping, self._fresh, self._trigger, self._quiet = served, keeping, fresh, trigger, quiet
        self._lines, self._stack = lines, stack
        self._server = LiveServer(
            served.rooms, served.host, served.port, stop, lines.say, lambda core: channel_of(core, served.key_folder),
            floor_bytes=keeping.floor_bytes, hand_over_s=hand_over_s,
        )  # fmt: skip
        if served.authenticator is not None:
            self._server.authenticator = served.authenticator
        with Problem.of(ServeError), BadInput.of(HostError):
            self.bound = self._server.listen()
        stack.callback(self._server.close)

    def begin(self, feed: MetricsFeed | None, told: Mapping[str, Sequence[str]]) -> Housekeeping:
        """See `Placement`."""
        served, say = self._served, self._lines.say
        self._run_folder = self._keeping.begin(served.standing or served.rooms[:1], say, self._stack)
        if self._run_folder and served.record:
            self._server.record_at = self._run_folder / SERVER_RECORDING
        self._folders = self._write_settings()
        if self._keeping.into is None:  # the owner of a folder has the warnings in its log
            with suppress(OSError):  # which was said already
                for name, folder in self._folders.items():
                    write_warnings(folder, told[name])
        with Problem.of(StateError):
            self._housekeeping = Housekeeping(
                self._server, say, folder=served.folder, authenticator=served.authenticator, metrics=feed,
                trigger=self._trigger, software=VERSION, fresh=self._fresh, templates=served.templates,
                empty_s=served.empty_s,
            )  # fmt: skip
        return self._housekeeping

    def run(self, seconds: float | None) -> int:
        """See `Placement`."""
        server, housekeeping = self._server, self._housekeeping
        server.seconds = seconds
        with LiveScreen(self._lines.say) as screen:
            if not self._quiet:
                self._draw(screen)
            try:
                server.run()
            finally:
                screen.close()
                housekeeping.end(said_goodbye=bool(server.stop.reason))
        self._lines.say(server.stop.reason)
        return self._conclude({**server.drops(), **server.losses(), **housekeeping.counts()})

    def _write_settings(self) -> dict[str, Path]:
        """Leave each room's settings in its own folder of the run. Returns the folders by room."""
        run_folder, rooms = self._run_folder, self._served.standing or self._served.rooms[:1]
        if run_folder is None:
            return {}
        folders = {room.name: run_folder if len(rooms) == 1 else run_folder / room.name for room in rooms}
        try:
            for room in rooms:
                write_settings(folders[room.name], room)
                write_choice(folders[room.name], self._served.rates.get(room.name))
        except OSError as error:  # the session continues; the recorder reports by itself
            self._lines.say(f"warning: {run_folder}: {error.strerror}; no settings are left there")
        return folders

    def _draw(self, screen: LiveScreen) -> None:
        """Show the rooms below the lines, at a terminal where people read them."""
        if self._lines.form != "text" or not may_draw(make_console()):
            return
        if self._run_folder is None or not self._served.record:
            self._lines.say("no live table without a recording")
            return
        self._lines.above = screen.passed
        seats = {room.name: tuple(user.name for user in room.users) for room in self._served.standing}
        state = self._served.folder
        screen.draw(*drawing(ServeView(str(self._run_folder), seats, str(state.path) if state else "")))

    def _conclude(self, losses: dict[str, int]) -> int:
        """Leave a summary for each room, printed on standard error beside a log for programs. Return the exit code."""
        server, lines = self._server, self._lines
        programs, alone = lines.form == "json", self._keeping.into is None
        console = make_console(soft_wrap=True, stderr=programs)
        if lines.lost:
            losses["log line"] = lines.lost
        well = True
        for room in server.core.rooms:
            if room.template:  # whatever was opened under it, and more than once
                continue
            summary = of_room(room, server.elapsed_s, losses)
            well = well and (succeeded(summary) or not came(summary))
            folder, report = self._folders.get(room.name), alone and self._served.report
            leave_files(folder, summary, console, shown=alone and not programs, report=report)
        return 0 if well else 1
