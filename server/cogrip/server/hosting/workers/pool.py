"""Worker processes as the front sees them: one for each group of rooms, and a spare that waits to replace one that dies.

The spare is started once all rooms are served: people who lost their server wait for these, and starting a process takes a
second of a processor.
"""

import subprocess
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from cogrip.machine.server_platform import message_pair
from cogrip.server.hosting.link import Assign, ProcessLink, Void
from cogrip.server.snapshot import Snapshot

START_LIMIT_S = 30.0
END_LIMIT_S = 15.0

Start = Callable[[int, int], subprocess.Popen[bytes]]
"""Function that starts a process by its number, which is to have the descriptor of its end of the link."""


@dataclass(eq=False, slots=True)
class Worker:
    """One process. rooms: those that it serves; none of a spare. state: "ready" once it serves them.

    group: number of these rooms, whoever serves them; told: rooms on demand that it has said to be open
    """

    number: int
    process: subprocess.Popen[bytes]
    link: ProcessLink
    rooms: tuple[str, ...] = ()
    group: int = -1
    state: Literal["spare", "assigned", "ready", "ended"] = "spare"
    snapshot: Snapshot | None = None
    told: set[str] = field(default_factory=set)


class WorkerPool:
    """Workers of the rooms in `groups`, and one spare, which `add` starts: a start takes longer than anyone should wait.

    workers   those that are alive, the spare among them
    replaced  count of workers that died
    templates names of the spare rooms of each template
    opened    group and template of each room that was opened on demand, by the name that it has now
    """

    unknown = ""  # nothing that is known of the rooms is old: the links are local
    rereads = False  # the front reads the tokens for all

    def __init__(
        self, groups: Sequence[Sequence[str]], start: Start, fresh: bool, public: int | None = None,
        own: Sequence[int] = (), templates: Mapping[str, Sequence[str]] = MappingProxyType({}),
    ) -> None:  # fmt: skip
        """fresh: what `--fresh` says, for the first workers; public: descriptor of the front's socket, to send by.

        own: of sockets that peers are steered to, one for each group
        """
        self.workers: list[Worker] = []
        self.replaced = 0
        self.templates = templates
        self.opened: dict[str, tuple[int, str]] = {}
        self._start = start
        self._number = 0
        self._voided: tuple[set[str], set[str]] = (set(), set())
        self._groups = [tuple(group) for group in groups]
        self._fresh = fresh
        self._public = () if public is None else (public,)
        self._own = tuple(own)

    def begin(self) -> None:
        """Start all workers. Raises OSError."""
        for _ in self._groups:
            self.add()
        for number, (worker, rooms) in enumerate(zip(self.workers, self._groups, strict=False)):
            self.assign(worker, rooms, number, self._fresh)

    def add(self) -> Worker:
        """Start a spare. Raises OSError."""
        self._number += 1
        ours, theirs = message_pair()
        try:
            process = self._start(self._number, theirs.fileno())
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        worker = Worker(self._number, process, ProcessLink(ours))
        self.workers.append(worker)
        return worker

    def assign(self, worker: Worker, rooms: tuple[str, ...], group: int, fresh: bool = False) -> None:
        """Let a spare serve these rooms."""
        worker.rooms, worker.group, worker.state = rooms, group, "assigned"
        revoked, expired = self._voided
        own = bool(self._own)
        sockets = (self._own[group],) if own else self._public
        worker.link.send(Assign(rooms, fresh, tuple(sorted(revoked)), tuple(sorted(expired)), own), sockets)

    def void(self, revoked: set[str], expired: set[str]) -> None:
        """Tell the workers of void tokens, those that are assigned later as well."""
        self._voided[0].update(revoked)
        self._voided[1].update(expired)
        for worker in self.workers:
            if worker.rooms:
                worker.link.send(Void(tuple(sorted(revoked)), tuple(sorted(expired))))

    def home(self, room: str) -> Worker | None:
        """Return the worker that serves a room, by its name or the one that it was opened under; None while none does."""
        group, _ = self.opened.get(room, (-1, ""))
        ready = [worker for worker in self.workers if worker.state == "ready"]
        return next((worker for worker in ready if worker.group == group or (group < 0 and room in worker.rooms)), None)

    def spare(self, template: str) -> Sequence[tuple[Worker, int]]:
        """Return each worker that is ready, and how many rooms of a template it has left."""
        names = {*self.templates.get(template, ())}
        used = Counter(group for group, each in self.opened.values() if each == template)
        ready = [worker for worker in self.workers if worker.state == "ready"]
        return [(worker, len(names.intersection(worker.rooms)) - used[worker.group]) for worker in ready]

    def replace(self, dead: Worker) -> tuple[str, ...]:
        """Let the spare serve the rooms of a worker that has ended, and start another spare. Returns the rooms."""
        self.workers.remove(dead)
        dead.state = "ended"
        dead.link.close()
        if dead.process.poll() is None:  # it has closed its link: it can serve nobody any more
            dead.process.kill()
        dead.process.wait()
        self.replaced += 1
        spare = next((worker for worker in self.workers if worker.state == "spare"), None) or self.add()
        if dead.rooms:
            self.assign(spare, dead.rooms, dead.group)
            self.add()
        return dead.rooms

    def end(self) -> list[int]:
        """Wait for the end of all; return the exit codes of those that had rooms."""
        codes = []
        for worker in self.workers:
            try:
                code = worker.process.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired:
                worker.process.kill()
                code = worker.process.wait()
            if worker.rooms:
                codes.append(code)
            worker.link.close()
        return codes
