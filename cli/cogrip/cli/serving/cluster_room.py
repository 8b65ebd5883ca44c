"""Process of one room of a cluster: an ordinary server of this room, with a UDP port of its own.

`cogrip.server.hosting.cluster.host_actor` starts the template of these processes with a descriptor; each gets its end of a link
before it is known which room. It ends with that link only where nobody is seated, or once another process has the room.
"""

import select
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec

from cogrip.cli.runs.run_folder import live_run_folder
from cogrip.cli.serving.log_lines import NOTICE, LogLines
from cogrip.cli.serving.server_state import channel_of
from cogrip.cli.serving.worker import WorkerJob, conclude
from cogrip.machine.platform import system
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.version import VERSION
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.guard import Guard
from cogrip.server.hosting.cluster.room_checkpoints import RoomCheckpoints
from cogrip.server.hosting.cluster.template import serve_forks
from cogrip.server.hosting.link import (
    AnyToWorker,
    Begin,
    DirectoryContact,
    EndRooms,
    HandOver,
    LinkEndedError,
    Obey,
    ProcessEnded,
    ProcessLink,
    Ready,
    Said,
    Saved,
    Serve,
)
from cogrip.server.hosting.orders import LinkMeasures, LinkOrders
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.housekeeping import Housekeeping
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.state_folder import find_folder
from cogrip.server.io.token_file import TokenFile
from cogrip.server.io.udp_socket import ServeError, UdpRange

DESERTED_S = 10.0  # time after which a process that nobody answers ends: whoever was there may be resuming


class RoomJob(WorkerJob, frozen=True):
    """Job of a room's process. state: folder that all hosts share. host: to listen on.

    ports      range of its UDP port, None for any
    in_memory  checkpoints are in the memory of two hosts
    """

    host: str = "127.0.0.1"
    encrypted: bool = True
    ports: UdpRange | None = None
    in_memory: bool = False


class HandedOverError(Exception):
    """Another process goes on with the room."""


class RoomLines(LogLines):
    """Lines of a room: they go to the log here, and to the fronts."""

    def __init__(self, job: RoomJob, link: ProcessLink) -> None:
        super().__init__(job.log)
        self._room, self._link = job.rooms[0].name, link

    def say(self, what: ServerEvent | str) -> None:
        """Write one line, and send it to the fronts."""
        event = what if isinstance(what, ServerEvent) else ServerEvent(NOTICE, what, self._room)
        if event.event != "reloaded":  # every room says that; the front has said it
            self._link.send(Said(event))
        super().say(what)


def main(arguments: list[str]) -> int:
    """Fork a process for each room. Return the exit code, of the template or of a room."""
    for each in (*system.END_SIGNALS, system.HANGUP_SIGNAL):
        if each is not None:
            signal.signal(each, signal.SIG_IGN)  # the link ends this process
    return serve_forks(int(arguments[0]), _room)


def _room(end: socket.socket) -> int:
    """Serve the room that the actor names. Return the exit code."""
    link = ProcessLink(end)
    try:
        first = _awaited(link)
        if not isinstance(first, Serve):
            return 0
        code = RoomServer(link, msgspec.json.decode(first.job, type=RoomJob), first).run()
    except HandedOverError:
        code = 0
    except LinkEndedError:
        code = 1
    link.send(ProcessEnded(code))
    return code


def _awaited(link: ProcessLink) -> AnyToWorker:
    """Return the next message. Raises LinkEndedError."""
    select.select([link.socket], [], [])
    return link.take_at_worker()[0]


class RoomServer:
    """Server of one room: prepared, then begun from a checkpoint, until the actor or another process ends it."""

    def __init__(self, link: ProcessLink, job: RoomJob, given: Serve) -> None:
        self._link, self._job = link, job
        self._lines, self._stop = RoomLines(job, link), Stop()
        self._room, self._address = job.rooms[0], given.address
        self._folder = find_folder(Path(job.state))
        self._guard = Guard(self._folder, self._room.name, given.number)
        self._lost_link = False
        self._deserted_s = time.monotonic()

    def run(self) -> int:
        """Serve. Return the exit code. Raises LinkEndedError or HandedOverError: then people resume elsewhere."""
        job, lines, link, number = self._job, self._lines, self._link, self._guard.number
        folder = self._folder if job.encrypted else None
        run_folder = live_run_folder(Path(job.runs), f"{self._room.name}-{number}", lines.say)
        job = msgspec.structs.replace(job, runs=str(run_folder or ""))
        server = LiveServer([self._room], job.host, 0, self._stop, lines.say, lambda core: channel_of(core, folder))
        authenticator: TokenAuthenticator | None = None
        if folder is not None:
            from cogrip.protocol.io.certificate import load  # OpenSSL takes a while

            fingerprint = load(folder.shared).fingerprint
            authenticator = TokenAuthenticator(TokenFile(folder), lines.say, watch=True, fingerprint=fingerprint)
            server.authenticator = authenticator
        try:
            port = server.listen(job.ports)[1]
        except ServeError as error:
            lines.say(ServerEvent("trouble", f"room {self._room.name}: {error}", self._room.name))
            return 1
        link.send(Ready(port, number))
        checkpoint = self._begun()
        self._server = server
        if job.runs and job.record:
            server.record_at = Path(job.runs) / SERVER_RECORDING
        self._guard.claim()
        self._checkpoints: RoomCheckpoints | None = None
        self._orders = LinkOrders(link)
        self._housekeeping = Housekeeping(
            server, lines.say, authenticator=authenticator, metrics=LinkMeasures(link), software=VERSION,
            orders=self._orders, checkpoints=lambda room, say: self._open(say, checkpoint),
        )  # fmt: skip
        self._housekeeping.begin()
        server.chores.append(self._chore)
        self._guard.serve(place_text((self._address, port)))
        link.send(Ready(port, number))
        try:
            server.run()
        finally:
            self._guard.close(remove=bool(self._stop.reason))
            self._housekeeping.end(said_goodbye=bool(self._stop.reason))
        return conclude(server, job, {**server.drops(), **server.losses(), **self._housekeeping.counts()}, lines)

    def _begun(self) -> bytes:
        """Return the checkpoint to begin from, once the room is to. Raises LinkEndedError, HandedOverError."""
        while True:
            match _awaited(self._link):
                case Begin() as given:
                    return given.checkpoint
                case EndRooms() | HandOver():
                    raise HandedOverError
                case DirectoryContact() as given:
                    self._guard.note_directory(given.answers)

    def _open(self, say: Callable[[str], None], checkpoint: bytes) -> RoomCheckpoints:
        path, in_memory = self._folder.checkpoint(self._room.name), self._job.in_memory
        self._checkpoints = RoomCheckpoints(path, say, self._link, checkpoint, in_memory)
        return self._checkpoints

    def _chore(self, now_ns: int) -> None:
        """Do what the actor says, or what another process claims."""
        if not self._lost_link:
            try:
                self._follow()
            except LinkEndedError:
                self._lost_link = True
                self._guard.note_directory(False)
        if self._checkpoints is not None:
            self._checkpoints.in_memory = self._job.in_memory and not self._guard.alone
        if self._guard.claimed:
            self._lose(self._guard.claimed == "hand over")
        if self._lost_link:
            now_s = now_ns * 1e-9
            if not self._server.core.rooms[0].deserted:
                self._deserted_s = now_s
            elif now_s - self._deserted_s > DESERTED_S:
                self._lose(True)

    def _follow(self) -> None:
        """Do what the actor says. Raises LinkEndedError, HandedOverError."""
        with suppress(BlockingIOError):
            while True:
                match self._link.take_at_worker()[0]:
                    case Obey() as given:
                        self._orders.add(given.number, given.order)
                    case DirectoryContact() as given:
                        self._guard.note_directory(given.answers)
                    case HandOver():
                        self._link.send(Saved(self._housekeeping.last_checkpoint(), last=True))
                        raise HandedOverError
                    case EndRooms() as given:
                        self._stop.reason = self._stop.reason or given.reason
                    case other:
                        raise AssertionError(f"no message for a room of a cluster: {other}")

    def _lose(self, hands_over: bool) -> None:
        """End without a goodbye. hands_over: leave a checkpoint of this moment, for the next process."""
        if hands_over and self._checkpoints is not None:
            self._checkpoints.in_memory = False
            self._housekeeping.write_checkpoints()
            self._checkpoints.close()
            self._guard.ended()
        raise HandedOverError


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
