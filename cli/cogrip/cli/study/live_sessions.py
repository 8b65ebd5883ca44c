"""Live sessions of a study: for each a server and its clients as processes, ended by time, goal or operator."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rich.console import Console

from cogrip.cli.session.children import END_LIMIT_S, end_all, how_ended, listening_at, start_child
from cogrip.cli.session.join_target import target_of
from cogrip.cli.session.live_views import FollowedRun
from cogrip.cli.session.view_child import linked_device
from cogrip.cli.study.pages import Pages
from cogrip.cli.study.terminal_people import ORDERS, Keys
from cogrip.cli.terminal.problem import Problem
from cogrip.client.io.paths import JoinError
from cogrip.experiments.study.conductor import Quit, TrialEnded
from cogrip.experiments.study.phases import Phase, PhaseWatch, phase_begun
from cogrip.experiments.study.study_file import Study
from cogrip.experiments.study.trial import TrialEvent, TrialState, begun_by, ended_by
from cogrip.experiments.study.trigger_codes import codes_of_run
from cogrip.machine.stop import Stop
from cogrip.protocol.recording.records import Step
from cogrip.protocol.settings.sections import Settings, User
from cogrip.protocol.wire.session import ClientSession
from cogrip.results.measures.goal import Goal, GoalWatch
from cogrip.results.reading.folder import SETTINGS, client_log, write_settings
from cogrip.server.administration.orders import MarkOrder
from cogrip.server.io.control import ask
from cogrip.server.io.state_folder import StateError, find_folder
from cogrip.view.io.feed import LiveFeed
from cogrip.view.panel import Prompt

Children = dict[str, subprocess.Popen[bytes]]

LOG = "server.log"
ENDS = {**ORDERS, "e": TrialEvent.ENDED}  # orders that end a session
BUTTON = "or press a button of your device"
CHILDREN = "children.json"  # file that names the processes of the session that is going on
_LOOK_EVERY_S = 0.05


class LiveSessions:
    """See `conductor.Sessions`. remote: people who join by themselves; flags: of every client; serving: of the server."""

    def __init__(
        self, study: Study, folder: Path, keys: Keys, stop: Stop, console: Console, remote: frozenset[str], host: str,
        port: int, flags: Sequence[str] = (), serving: Sequence[str] = (), pages: Pages | None = None,
    ) -> None:  # fmt: skip
        self._pages, self._start_by = pages or Pages(), study.start
        self._end, self._keys, self._stop, self._console = study.end, keys, stop, console
        self._remote, self._flags, self._serving = remote, flags, serving
        self._triggers = study.triggers if any(flag == "--trigger" for flag in serving) else {}
        self._host, self._port = host, port
        self._state = folder.resolve() / "state"  # key and tokens: links stay the same through the study
        self._children = folder / CHILDREN
        end_left_over(self._children)

    def run(self, settings: Settings, folder: Path, goal: Goal, phases: Sequence[Phase]) -> TrialEnded:
        """Run one. Raises Quit where the operator quits; what was recorded stays."""
        write_settings(folder, settings)
        into = ["--into", str(folder)]
        where = ["--host", self._host, "--port", str(self._port), "--state", str(self._state)]
        children: Children = {}
        codes = [f"--trigger-code={text}={code}" for text, code in codes_of_run(self._triggers, folder.name).items()]
        serving = ["--fresh", *self._serving, *codes, *into]
        self._start(children, "server", folder, ["serve", str(folder / SETTINGS), *where, *serving])
        ended = TrialEnded(TrialEvent.FAILED, "")
        try:
            port = listening_at("server", children["server"], folder / LOG, self._stop)
            link = self._link(folder, port)
            self._show(link)
            for user in settings.users:
                if user.name not in self._remote:
                    self._join(children, user, folder, link, into)
                else:
                    self._console.print(f"waiting for {user.name}: cogrip join '{link}' --name '{user.name}'")
            ended = self._watch(settings, folder, goal, PhaseWatch(phases), children)
            if ended.event is not TrialEvent.FAILED:
                self._mark(ended_by(folder.name, ended.how))
        except Problem as problem:
            if self._stop.reason:
                raise Quit from None
            ended = TrialEnded(TrialEvent.FAILED, str(problem))
        finally:
            if self._pages.page is not None:
                self._pages.page.rest()
                for user in settings.users:
                    self._pages.show(user.name, "waiting")
            for name, child in children.items():
                if name != "server" and child.poll() is None:
                    child.send_signal(signal.SIGINT)
            clients = {name: child for name, child in children.items() if name != "server"}
            end_all(clients, [])
            end_all(children, ["server"])
            self._children.unlink(missing_ok=True)
        if ended.event is TrialEvent.FAILED:
            self._console.print(f"the session failed: {ended.how}")
        return ended

    def _join(self, children: Children, user: User, folder: Path, link: str, into: Sequence[str]) -> None:
        """Start a participant's client. One whose device is their page's pointer is handed the link to it."""
        who = ["--config", str(folder / SETTINGS), "--name", user.name, "--no-rearm", *self._flags, *into]
        if self._start_by == "button":
            who.append("--clutched")
        pointer = None if self._pages.page is None else self._pages.page.hand(user.name)
        if pointer is not None:
            who += ["--device", linked_device(user.device, pointer)]
        self._start(children, user.name, folder, ["join", link, *who], *(() if pointer is None else (pointer,)))

    def _show(self, link: str) -> None:
        """Show the session on the pages; without a place for an observer they have no picture of it."""
        if self._pages.page is None:
            return
        target = target_of(link, "", False, "", "")
        paths = target.paths(False)
        feed = LiveFeed(ClientSession(target.observer()), paths, self._console.print)
        try:
            feed.connect()
        except JoinError as error:
            paths.close()
            self._console.print(f"no picture on the pages: {error}")
        else:
            self._pages.page.follow(feed)

    def _mark(self, text: str) -> None:
        """Set a marker in the session, in every recording of it and for whoever observes it."""
        try:
            ask(find_folder(self._state), MarkOrder(text))
        except StateError as error:
            self._console.print(f"no marker {text!r}: {error}")

    def _start(self, children: Children, name: str, folder: Path, arguments: Sequence[str], *handles: int) -> None:
        """Start a process, and note its number: where this one is killed, the next one ends it."""
        children[name] = start_child(_log(folder, name), arguments, *handles)
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
        self, settings: Settings, folder: Path, goal: Goal, phases: PhaseWatch, children: Children
    ) -> TrialEnded:
        """Wait for the end of the session, or for an order of the operator."""
        run, watch, people = FollowedRun(folder), GoalWatch(goal), [user.name for user in settings.users]
        start = TrialState(1, people)
        began_s: float | None = None
        self._console.print("going on: e ends, r repeats, p pauses, a leaves it out, q quits (each with Enter)")
        self._ask_ready(people)
        while True:
            wait_s = _LOOK_EVERY_S
            if began_s is not None:
                wait_s = max(0.0, min(wait_s, began_s + phases.next_s - time.monotonic()))
            line = self._keys.poll(wait_s)
            if began_s is not None:
                self._begin_phases(phases, time.monotonic() - began_s, folder.name, people)
            if line == "q":
                raise Quit
            if line in ENDS:
                return TrialEnded(ENDS[line], "operator")
            if failed := _failed(children, folder):
                return TrialEnded(TrialEvent.FAILED, failed)
            fresh = run.steps(settings.name)
            if start.state == "waiting":
                self._take_ready(start, people, fresh, line)
            steps = [step for step in fresh if all(seat.seated for seat in step.seats)]
            if not steps or start.state == "waiting":
                continue
            now_s = time.monotonic()
            if began_s is None:
                began_s = now_s
                self._begin(folder.name, goal, steps[0], people, children)
                self._begin_phases(phases, 0.0, folder.name, people)
            if self._end == "goal" and any(self._reached(watch, goal, step, settings) for step in steps):
                return TrialEnded(TrialEvent.ENDED, "goal")
            if now_s - began_s >= settings.seconds and self._end != "operator":
                return TrialEnded(TrialEvent.ENDED, "time")

    def _ask_ready(self, people: Sequence[str]) -> None:
        """Ask everybody to say that they are ready, where that is done with the device in the hand."""
        if self._start_by != "button":
            return
        self._console.print(f"{' and '.join(people)}: press a button of your device (or Enter here) when you are ready")
        for person in people:
            self._pages.show(person, "waiting", Prompt(kind="go", text="I am ready", low=BUTTON))

    def _take_ready(self, start: TrialState, people: Sequence[str], steps: Sequence[Step], line: str | None) -> None:
        """Take who is ready: by a button of the device, on the page, by Enter for the next one; else all of them."""
        if self._start_by != "button":
            start.handle(TrialEvent.READY)
            return
        said = {seat.user for step in steps for seat in step.seats if any(edge > 0 for edge in seat.edges)}
        said |= {person for person in people if self._pages.take(person) is not None}
        waits = [person for person in people if person not in start.readied]
        said |= set(waits[:1]) if line == "" else set()
        for person in waits:
            if person in said:
                self._console.print(f"{person} is ready")
                self._pages.show(person, "waiting")
                start.ready(person)

    def _begin(self, run: str, goal: Goal, step: Step, people: Sequence[str], children: Children) -> None:
        """Mark the beginning, then let the hands engage that were held off, and show it."""
        self._mark(begun_by(run))
        if self._start_by == "button":
            for name, child in children.items():
                if name != "server" and child.stdin is not None:
                    with suppress(OSError):  # it has ended, which is found out
                        child.stdin.write(b"c\n")
                        child.stdin.flush()
        self._console.print("everybody holds on")
        for person in people:
            self._pages.show(person, "running")
        if goal.stated and goal.within_m is not None and None not in step.object_m:
            start = [x for x in step.object_m if x is not None]
            self._pages.aim(people, [x + far for x, far in zip(start, goal.place_m, strict=False)], goal.within_m)

    def _begin_phases(self, phases: PhaseWatch, time_s: float, run: str, people: Sequence[str]) -> None:
        """Show and mark the phases that have begun by now."""
        for phase in phases.look(time_s):
            self._pages.cue(people, phase.cue)
            self._mark(phase_begun(run, phase.name))
            self._console.print(f"{phase.name}: {phase.cue}" if phase.cue else phase.name)

    def _reached(self, watch: GoalWatch, goal: Goal, step: Step, settings: Settings) -> bool:
        """Return whether the goal is reached, as far as the recording says by now; its own time is measured afterwards."""
        if not goal.stated or any(x is None for x in step.object_m):
            return False
        return watch.look(step.step / settings.rates.network_hz, [x for x in step.object_m if x is not None])


def _failed(children: Children, folder: Path) -> str:
    """Return which process of a session ended before its time, and how; "" while all go on."""
    for name, child in children.items():
        if child.poll() is not None:
            return f"{name}: {how_ended(child, _log(folder, name))}; see {_log(folder, name)}"
    return ""


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
