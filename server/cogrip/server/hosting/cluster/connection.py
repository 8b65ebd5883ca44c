"""Connection of a front to the cluster, by a process that speaks with Ray for it: nobody waits for either.

Where that process ends, as Ray's do when their cluster has gone, another one is started, again and again. Meanwhile the rooms
are where they were told to be last, or where they announce themselves in the shared folder.
"""

import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import msgspec

from cogrip.machine.platform import system
from cogrip.protocol.io.cluster_address import ClusterError as ClusterError
from cogrip.protocol.io.cluster_address import probe
from cogrip.server.administration.orders import OrderReply
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster import pipe
from cogrip.server.hosting.cluster.announcement import AnnouncementFile
from cogrip.server.hosting.cluster.directory import Home
from cogrip.server.hosting.cluster.pipe import (
    DirectoryState,
    DrainHost,
    Failed,
    LeaveCluster,
    Left,
    OrderAnswer,
    Ordered,
    PipeEndedError,
    Silent,
)
from cogrip.server.hosting.cluster.ray_process import CALL_S, END_S, RayFront
from cogrip.server.hosting.link import Answered, Obey
from cogrip.server.io.state_folder import StateFolder
from cogrip.server.snapshot import Snapshot, decode

UNKNOWN_S = 1.0
"""Silence of the directory after which what is known of the rooms is old: they may play on, and nobody here knows."""
SILENT_S = 2.0  # silence of the directory after which the front says so, and looks into the shared folder
LOOK_S = 1.0  # time between two looks into the shared folder
PROBE_S = 1.0  # time between two looks whether the head is there
AGAIN_S = (1.0, 2.0, 5.0, 10.0, 20.0)
"""Waits between two tries to connect, the last for all that follow: each try starts a process."""
HANGS_S = 30.0  # silence of the process after which another one is started
BEGIN_S = 60.0
MODULE = "cogrip.server.hosting.cluster.ray_process"


class RemoteLink:
    """Link to a room's process, as `Administration` uses one."""

    def __init__(self, order: Callable[[Obey], None]) -> None:
        self._order = order

    def send(self, message: Obey) -> None:
        """Hand an order on."""
        self._order(message)


@dataclass(slots=True)
class RemoteRoom:
    """A room on some host, as `Administration` sees it."""

    rooms: tuple[str, ...]
    link: RemoteLink
    snapshot: Snapshot | None
    state: str = "ready"


class RemoteRooms:
    """Rooms of a cluster as the directory told them last.

    homes, fronts  where the rooms are; places of all fronts
    refused        rooms that the cluster has with other settings
    lines          what rooms said, and what there is to say of the cluster itself
    """

    replaced = 0  # always 0: the directory counts the processes that it replaces
    templates: Mapping[str, Sequence[str]] = MappingProxyType({})  # there are no rooms on demand

    def __init__(
        self, address: str, command: Sequence[str], loopback: bool, folder: StateFolder, guarded: bool = False
    ) -> None:  # fmt: skip
        """address: HOST:PORT of the head, "" for $RAY_ADDRESS, or the cluster of this machine. guarded: see `RayFront`."""
        self._front = RayFront(address, tuple(command), loopback, "", {}, guarded)
        self._folder = folder
        self.homes: dict[str, Home] = {}
        self.fronts: tuple[str, ...] = ()
        self.refused: tuple[str, ...] = ()
        self.counts: dict[str, int] = {}
        self.lines: deque[ServerEvent] = deque()
        self._silences = 0
        self._answers: deque[Answered] = deque()
        self._drained: deque[tuple[str, bool]] = deque()
        self._news = threading.Condition()
        self._process: subprocess.Popen[bytes] | None = None
        self._end: socket.socket | None = None
        self._answered_s = self._word_s = self._looked_s = time.monotonic()
        self._silent = self._closing = False
        self._failed, self._code = "", 0
        self._thread = threading.Thread(target=self._run, name="cluster", daemon=True)

    def begin(self, place: str, jobs: Mapping[str, bytes]) -> None:
        """Let the cluster serve rooms, by their names. Raises ClusterError."""
        self._front = msgspec.structs.replace(self._front, place=place, jobs=dict(jobs))
        self._thread.start()
        with self._news:
            answered = self._news.wait_for(lambda: self.fronts or self._failed, BEGIN_S)
        try:
            if self._failed:
                raise ClusterError(self._failed)
            if not answered:
                raise ClusterError(
                    f"the directory of the cluster did not answer within {BEGIN_S:g} s; see `ray status`"
                )
            if self.refused:
                names = ", ".join(self.refused)
                raise ClusterError(
                    f"the cluster has {names} with other settings or another front's flags; give the same, or rename the room"
                )
        except ClusterError:
            self.end("")
            raise

    @property
    def rereads(self) -> bool:
        """Return whether there are rooms: each reads the shared tokens by itself."""
        return bool(self.homes)

    @property
    def unknown(self) -> str:
        """Return why what is known of the rooms is old; "" where it is not."""
        return SILENCE if time.monotonic() - self._answered_s > UNKNOWN_S else ""

    @property
    def workers(self) -> list[RemoteRoom]:
        """Return the rooms that are served."""
        return [
            RemoteRoom(
                (room,),
                RemoteLink(partial(self._order, room, home.actor)),
                decode(home.snapshot) if home.snapshot else None,
            )
            for room, home in self.homes.items()
        ]

    def spare(self, template: str) -> Sequence[tuple[RemoteRoom, int]]:
        """Return none: see `templates`."""
        return ()

    def home(self, room: str) -> RemoteRoom | None:
        """Return a room; None while nobody serves it."""
        return next((each for each in self.workers if room in each.rooms), None)

    def void(self, revoked: set[str], expired: set[str]) -> None:
        """Do nothing: every room reads the shared tokens."""

    def answers(self) -> list[Answered]:
        """Return the answers that have come since the last call."""
        return [self._answers.popleft() for _ in range(len(self._answers))]

    def drain(self, host: str) -> tuple[str, bool]:
        """Let the rooms of a host move. Returns what to tell, and whether it is done."""
        silent = "the directory of the cluster has not answered; try again", False
        with self._news:
            self._drained.clear()
            if not self._send(DrainHost(host)):
                return silent
            self._news.wait_for(lambda: self._drained, CALL_S + 1.0)
            return self._drained.popleft() if self._drained else silent

    def poll(self, now_s: float) -> None:
        """Note a silence of the directory, and its end; find the rooms without it meanwhile."""
        silent = now_s - self._answered_s > SILENT_S
        if silent != self._silent:
            self._silent = silent
            self.lines.append(ServerEvent("trouble", SILENCE) if silent else ServerEvent("notice", ANSWERS))
        if silent and now_s - self._looked_s > LOOK_S:
            self._looked_s = now_s
            self.homes = found_homes(self._folder, self._front.jobs, self.homes)
        if self._process is not None and now_s - self._word_s > HANGS_S:
            self._word_s = now_s
            self._process.kill()

    def end(self, reason: str) -> int:
        """Leave the cluster; the last front ends the rooms. Returns the worst exit code of those."""
        self._closing = True
        if self._send(LeaveCluster(reason)):
            self._thread.join(CALL_S + END_S)
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        return self._code

    def _run(self) -> None:
        """Have a process that speaks with Ray, again and again."""
        tries = 0
        while not self._closing:
            ours, theirs = socket.socketpair()
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", MODULE, str(theirs.fileno())],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,  # Ray says much of each death
                **system.own_session(theirs.fileno()),
            )  # fmt: skip
            theirs.close()
            self._word_s = time.monotonic()
            with ours, suppress(PipeEndedError):
                pipe.put(ours, self._front)
                self._end = ours
                while True:
                    tries = 0 if self._take(ours) else tries
            self._end = None
            self._process.wait()
            if self._failed or self._closing:
                return
            time.sleep(AGAIN_S[min(tries, len(AGAIN_S) - 1)])
            tries += 1
            self._await_head()

    def _await_head(self) -> None:
        """Wait until somebody listens at the address of the head, where it is known: that costs nothing."""
        while self.fronts and not self._closing:
            self._word_s = time.monotonic()
            try:
                probe(self._front.address)
                return
            except ClusterError:
                time.sleep(PROBE_S)

    def _take(self, end: socket.socket) -> bool:
        """Take in a message. Returns whether the directory has told something."""
        message = pipe.from_ray(pipe.take(end))
        self._word_s = time.monotonic()
        with self._news:
            match message:
                case DirectoryState() as given:
                    told = given.told
                    self.refused, self.fronts = told.refused, told.fronts
                    if told.homes or not self._silent:  # a directory that has just begun knows of none yet
                        self.homes = told.homes
                    self.counts = {**told.counts, "directory silent": self._silences}
                    self.lines.extend(told.lines)
                    self._answered_s = self._word_s
                case Silent():
                    self._silences += 1
                case Failed() as given if not self.fronts:
                    self._failed = given.text
                case OrderAnswer() as given:
                    if given.number:
                        self._answers.append(Answered(given.number, msgspec.json.decode(given.answer, type=OrderReply)))
                    else:
                        self._drained.append((given.answer.decode(), given.ok))
                case Left() as given:
                    self._code = given.code
            self._news.notify_all()
        return isinstance(message, DirectoryState)

    def _send(self, message: pipe.ToRay) -> bool:
        end = self._end
        with suppress(PipeEndedError):
            if end is not None:
                pipe.put(end, message)
                return True
        return False

    def _order(self, room: str, actor: str, order: Obey) -> None:
        if not self._send(Ordered(order.number, actor, room, order.order)):
            self._answers.append(Answered(order.number, OrderReply(False, f"room {room}: {ALONE}")))


ALONE = "the cluster is silent: nobody can ask the room; try again once it answers"
SILENCE = (
    "the directory of the cluster is silent: rooms and their people go on, and new ones may join; until it answers no room "
    "is moved, started again or administered"
)
ANSWERS = "the directory of the cluster answers again"


def found_homes(folder: StateFolder, rooms: Iterable[str], known: Mapping[str, Home]) -> dict[str, Home]:
    """Return where rooms announce themselves in the shared folder, where that is newer than what is known."""
    homes = dict(known)
    for room in rooms:
        found = AnnouncementFile(folder, room).read()
        if found is None or found.state not in ("served", "alone"):
            continue
        before = homes.get(room)
        if before is None or found.number > before.number:
            homes[room] = Home("", found.place, before.taken if before else (), b"", found.number)
    return homes
