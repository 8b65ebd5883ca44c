"""Actor of a host: it has the processes of the rooms there, tells the directory of them, and hands orders on.

One actor a host, and not one a room: an actor is a process of Ray's, whose start takes longer than anyone should wait. A
room's process is forked (`template`), is an ordinary server with one room and a UDP port of its own, and does not need the
actor to go on: where Ray dies and the host does not, its people stay, until another process claims the room (`announcement`).
"""

import os
import threading
import time
from collections.abc import Mapping, Sequence, Set
from contextlib import suppress
from typing import Any

import msgspec

from cogrip.server.administration.orders import AnyOrder, OrderReply
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.directory import ProcessStart, Report
from cogrip.server.hosting.cluster.lines import Lines
from cogrip.server.hosting.cluster.replicas import Kept, Replicas, gather, next_host
from cogrip.server.hosting.cluster.room_process import RoomProcess
from cogrip.server.hosting.cluster.template import Template, TemplateError

NAMESPACE, DIRECTORY = "cogrip", "directory"
EVERY_S = 0.25  # time between two reports
HEAR_S = 1.0  # time between two looks whether the directory has answered
GIVE_UP_S = 10.0  # time without an answer after which the directory is asked anew
SILENT_S = 3.0  # time without an answer of the directory after which the rooms are told
HAND_OVER_S = 10.0
LINGER_S = 1.0  # time that the actor stays after all rooms have ended: somebody may wait for the answer
AT_ONCE = 64  # most calls of a host's actor at once
ORDER = msgspec.json.Decoder(AnyOrder)


def actor_of(host: str) -> str:
    """Return the name of a host's actor."""
    return f"host {host}"


class HostActor:
    """Rooms of this host. command: module of the template of their processes, and its arguments."""

    def __init__(self, command: Sequence[str], host: str, address: str) -> None:
        """host: its identity; address: by which people reach it."""
        self._host, self._address = host, address
        self._template, self._forking = Template(command), threading.Lock()
        self._rooms: dict[tuple[str, int], RoomProcess] = {}
        self._lines, self._lines_taken = Lines(), 0
        self._replicas, self._turn = Replicas(), 0
        self._hosts: tuple[str, ...] = ()
        self._news = threading.Event()
        self._ending = False
        for loop in (self._run, self._replicate):
            threading.Thread(target=loop, daemon=True).start()

    def serve(self, start: tuple[Any, ...], hosts: Sequence[str]) -> None:
        """Serve a room. hosts: all that may have its checkpoint."""
        threading.Thread(target=self._begin, args=(ProcessStart(*start), tuple(hosts)), daemon=True).start()

    def obey(self, room: str, order: bytes) -> bytes:
        """Return the answer to an order."""
        process = self._process(room)
        answer = (
            process.obey(ORDER.decode(order)) if process else OrderReply(False, f"room {room} is not here any more")
        )
        return msgspec.json.encode(answer)

    def hand_over(self, room: str) -> bytes:
        """End a room's process without a goodbye. Returns its last checkpoint, b"" where there is none."""
        process = self._process(room)
        return process.hand_over() if process else b""

    def keep(self, kept: Mapping[str, Kept]) -> None:
        """Keep checkpoints of rooms of another host."""
        self._replicas.keep(kept)

    def kept(self, room: str) -> Kept:
        """Return the newest checkpoint of a room that is here."""
        return self._replicas.get(room)

    def end(self, reason: str) -> int:
        """Say goodbye to everybody, and end. Returns the worst exit code of the rooms."""
        codes: list[int] = []
        ending = [
            threading.Thread(target=lambda each=each: codes.append(each.end(reason))) for each in self._rooms.values()
        ]
        for each in ending:
            each.start()
        for each in ending:
            each.join()
        self._ending = True
        self._news.set()
        return max(codes, default=0)

    def _process(self, room: str) -> RoomProcess | None:
        there = [key for key in self._rooms.copy() if key[0] == room]
        return self._rooms.get(max(there)) if there else None

    def _begin(self, start: ProcessStart, hosts: Sequence[str]) -> None:
        """Prepare a process, then take the room over: the one before serves meanwhile."""
        report = Report(actor_of(self._host), start.room, start.number, self._host, start.job)
        try:
            with self._forking:
                process = RoomProcess(
                    self._template, report, self._address, self._news.set, self._lines.add, self._save
                )
        except TemplateError:
            self._lines.add(ServerEvent("trouble", f"room {start.room}: no process could be started", start.room))
            return  # the directory misses it
        self._rooms[start.room, start.number] = process
        if process.prepare():
            process.begin(self._handed_over(start) or self._found(start.room, hosts))
        self._news.set()

    def _handed_over(self, start: ProcessStart) -> bytes:
        """Return the last checkpoint of the process that has the room, b"" where it does not answer."""
        import ray
        from ray.exceptions import RayError

        if start.after:
            with suppress(RayError, ValueError):  # it has died: its newest checkpoint is somewhere
                other = ray.get_actor(start.after, NAMESPACE)
                return bytes(ray.get(other.hand_over.remote(start.room), timeout=HAND_OVER_S))
        return b""

    def _found(self, room: str, hosts: Sequence[str]) -> bytes:
        """Return the newest checkpoint that any host keeps, b"" for none."""
        import ray
        from ray.exceptions import RayError

        asked: list[Any] = []
        for host in hosts:
            with suppress(RayError, ValueError):
                if host != self._host:
                    asked.append(ray.get_actor(actor_of(host), NAMESPACE).kept.remote(room))

        def come(limit_s: float) -> tuple[list[Kept], int]:
            nonlocal asked
            done, asked = ray.wait(asked, num_returns=len(asked), timeout=limit_s) if asked else ([], [])
            answers = []
            for each in done:
                with suppress(RayError):
                    answers.append(Kept(*ray.get(each)))
            return answers, len(asked)

        return gather(self._replicas.get(room), come).data

    def _save(self, room: str, number: int, checkpoint: bytes) -> None:
        self._turn += 1
        self._replicas.keep({room: Kept(number, self._turn, checkpoint)})

    def _run(self) -> None:
        """Report until the end of all, or of Ray here."""
        import ray
        from ray.exceptions import RayError

        raylet, answered_s, noted = os.getppid(), time.monotonic(), True
        directory: Any = None
        asked_s = answered_s
        told: list[Report] = []  # in a call that has no answer yet: no other one is made meanwhile
        asked: Any = None
        while os.getppid() == raylet and not self._ending:  # without it the cluster takes this host for dead
            self._news.wait(EVERY_S)
            self._news.clear()
            try:
                directory = directory or ray.get_actor(DIRECTORY, NAMESPACE)
                if asked is None:
                    told = [process.report for process in list(self._rooms.values())]
                    asked_s, asked = time.monotonic(), self._report(directory, told)
                if ray.wait([asked], timeout=HEAR_S)[0]:
                    answer, asked = asked, None
                    self._obey_directory(told, *ray.get(answer))
                    answered_s = time.monotonic()
                elif time.monotonic() - asked_s > GIVE_UP_S:
                    directory = asked = None
            except (RayError, ValueError):
                directory = asked = None
            answers = time.monotonic() - answered_s < SILENT_S
            if answers != noted:
                noted = answers
                for process in list(self._rooms.values()):
                    process.note_directory(answers)
        if self._ending:
            time.sleep(LINGER_S)
            self._template.close()
        os._exit(0)  # no other thread of Ray's may keep the actor

    def _report(self, directory: Any, told: Sequence[Report]) -> Any:
        """Tell the directory. Returns the call."""
        first, lines = self._lines.since(self._lines_taken)
        return directory.report.remote(self._host, list(map(tuple, told)), first, lines)

    def _obey_directory(
        self, told: Sequence[Report], forbidden: Set[tuple[str, int]], lines_taken: int, hosts: tuple[str, ...]
    ) -> None:
        """Do what the directory answers to what it was told."""
        self._lines_taken, self._hosts = lines_taken, hosts
        ended = {(report.room, report.number) for report in told if report.ended}
        for at, process in list(self._rooms.items()):  # threads begin others meanwhile
            key = process.report.room, process.report.number
            if key in forbidden:
                process.kill()
                if key in ended:
                    self._rooms.pop(at)

    def _replicate(self) -> None:
        """Send new checkpoints to another host, again and again; no report waits for one that has died."""
        import ray
        from ray.exceptions import RayError

        while True:
            time.sleep(EVERY_S)
            peer = next_host(self._host, self._hosts)
            rooms = list({room for room, _ in self._rooms.copy()})
            if peer and (news := self._replicas.to_send(peer, rooms)):
                with suppress(RayError, ValueError):
                    ray.get(ray.get_actor(actor_of(peer), NAMESPACE).keep.remote(news), timeout=HEAR_S)
                    self._replicas.sent(news)
