"""Live sessions of a study: for each a server and its clients as processes, ended by time, goal or operator."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from cogrip.cli.session.children import END_LIMIT_S, end_all, how_ended, listening_port, start_child
from cogrip.cli.session.live_views import FollowedRun
from cogrip.cli.study.terminal_people import ORDERS, Keys
from cogrip.cli.terminal.problem import Problem
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.recording.records import Step
from cogrip.protocol.settings import Settings
from cogrip.sim.experiments.study.conductor import Ended, Quit
from cogrip.sim.experiments.study.study_file import Study
from cogrip.sim.experiments.study.trial import Event
from cogrip.sim.runs.folder import SETTINGS, client_log, write_settings
from cogrip.sim.runs.measures.goal import Goal, GoalWatch

LOG = "server.log"
CHILDREN = "children.json"  # processes of the session that is going on
_LOOK_EVERY_S = 0.05


class LiveSessions:
    """See `conductor.Sessions`. remote: people who join by themselves; flags: of every client."""

    def __init__(
        self, study: Study, folder: Path, keys: Keys, stop: Stop, console: Console, remote: frozenset[str], host: str,
        port: int, flags: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self._end, self._keys, self._stop, self._console = study.end, keys, stop, console
        self._remote, self._flags = remote, flags
        self._host, self._port = host, port
        self._state = folder.resolve() / "state"  # key and tokens: links stay the same through the study
        self._children = folder / CHILDREN
        end_left_over(self._children)

    def run(self, settings: Settings, folder: Path, goal: Goal, title: str) -> Ended:
        """Run one. Raises Quit where the operator quits; what was recorded stays."""
        write_settings(folder, settings)
        into = ["--into", str(folder)]
        where = ["--host", self._host, "--port", str(self._port), "--state", str(self._state)]
        children: dict[str, subprocess.Popen[bytes]] = {}
        self._start(children, "server", folder, ["serve", str(folder / SETTINGS), *where, "--fresh", *into])
        ended = Ended(Event.FAILED, "")
        try:
            port = listening_port("server", children["server"], folder / LOG, self._stop)
            for user in settings.users:
                if user.name not in self._remote:
                    who = ["--config", str(folder / SETTINGS), "--name", user.name, "--no-rearm", *self._flags, *into]
                    self._start(children, user.name, folder, ["join", self._link(folder, port), *who])
                else:
                    link = self._link(folder, port)
                    self._console.print(f"waiting for {user.name}: cogrip join '{link}' --name '{user.name}'")
            ended = self._watch(settings, folder, goal, children)
        except Problem as problem:
            if self._stop.reason:
                raise Quit from None
            ended = Ended(Event.FAILED, str(problem))
        finally:
            for name, child in children.items():
                if name != "server" and child.poll() is None:
                    child.send_signal(signal.SIGINT)
            clients = {name: child for name, child in children.items() if name != "server"}
            end_all(clients, [])
            end_all(children, ["server"])
            self._children.unlink(missing_ok=True)
        if ended.event is Event.FAILED:
            self._console.print(f"the session failed: {ended.how}")
        return ended

    def _start(
        self, children: dict[str, subprocess.Popen[bytes]], name: str, folder: Path, arguments: Sequence[str]
    ) -> None:
        """Start a process, and note its number: where this one is killed, the next one ends it."""
        children[name] = start_child(_log(folder, name), arguments)
        self._children.write_text(
            json.dumps({child.pid: _began(child.pid) for child in children.values()}), encoding="utf-8"
        )

    def _link(self, folder: Path, port: int) -> str:
        """Return by what clients join: the player's link that the server printed, else HOST:PORT."""
        for line in (folder / LOG).read_text(encoding="utf-8").splitlines():
            if line.startswith("join ") and " as player:" in line:
                return line.partition("cogrip join '")[2].rstrip("'")
        return f"{self._host}:{port}"

    def _watch(
        self, settings: Settings, folder: Path, goal: Goal, children: dict[str, subprocess.Popen[bytes]]
    ) -> Ended:
        """Wait for the end of the session, or for an order of the operator."""
        run, watch = FollowedRun(folder), GoalWatch(goal)
        began_s: float | None = None
        self._console.print("going on: e ends, r repeats, p pauses, a leaves it out, q quits (each with Enter)")
        while True:
            line = self._keys.poll(_LOOK_EVERY_S)
            if line == "q":
                raise Quit
            if line == "e":
                return Ended(Event.ENDED, "operator")
            if line in ORDERS:
                return Ended(ORDERS[line], "operator")
            for name, child in children.items():
                if child.poll() is not None:
                    return Ended(
                        Event.FAILED, f"{name}: {how_ended(child, _log(folder, name))}; see {_log(folder, name)}"
                    )
            step = run.step(settings.name)
            if step is None or not all(seat.seated for seat in step.seats):
                continue
            now_s = time.monotonic()
            if began_s is None:
                began_s = now_s
                self._console.print("everybody holds on")
            if self._end == "goal" and self._reached(watch, goal, step, settings):
                return Ended(Event.ENDED, "goal")
            if now_s - began_s >= settings.seconds and self._end != "operator":
                return Ended(Event.ENDED, "time")

    def _reached(self, watch: GoalWatch, goal: Goal, step: Step, settings: Settings) -> bool:
        """Return whether the goal is reached, as far as the recording says by now; its own time is measured afterwards."""
        if not goal.stated or any(x is None for x in step.object_m):
            return False
        return watch.look(step.step / settings.rates.network_hz, [x for x in step.object_m if x is not None])


def _log(folder: Path, name: str) -> Path:
    return folder / (LOG if name == "server" else client_log(name))


def end_left_over(file: Path) -> None:
    """End the processes in `file` that a study left which was killed, and wait for them."""
    try:
        left = {int(pid): ticks for pid, ticks in json.loads(file.read_text(encoding="utf-8")).items()}
    except (OSError, ValueError, AttributeError):
        return
    until_s = time.monotonic() + END_LIMIT_S
    for pid, ticks in left.items():
        if ticks is not None and _began(pid) == ticks:
            os.kill(pid, signal.SIGTERM)
    while any(ticks is not None and _began(pid) == ticks for pid, ticks in left.items()) and time.monotonic() < until_s:
        time.sleep(_LOOK_EVERY_S)
    file.unlink(missing_ok=True)


def _began(pid: int) -> int | None:
    """Return when a process began, in clock ticks since the machine did: no other has its number and that. None if it ended."""
    try:
        state, *fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return None
    return None if state == "Z" else int(fields[18])
