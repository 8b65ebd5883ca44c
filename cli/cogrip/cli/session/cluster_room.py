"""Process of one room of a cluster: an ordinary server of this room, with a UDP port of its own.

Started by `cogrip.server.io.cluster.room_actor` with a descriptor, its end of the link, before it is known which room.
"""

import select
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path

import msgspec

from cogrip.cli.runs.run_folder import live_run_folder
from cogrip.cli.session.log_lines import LogLines
from cogrip.cli.session.server_state import channel_of
from cogrip.cli.session.worker import Job, conclude
from cogrip.protocol.io.platform import system
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.version import VERSION
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.housekeeping import Housekeeping
from cogrip.server.io.state_folder import find_folder
from cogrip.server.io.token_file import TokenFile
from cogrip.server.io.workers.link import End, HandOver, Link, LinkEndedError, Obey, Ready, Serve
from cogrip.server.io.workers.orders import LinkMeasures, LinkOrders
from cogrip.server.loop import LiveServer
from cogrip.sim.runs.folder import SERVER_RECORDING


class RoomJob(Job, frozen=True):
    """Job of a room's process. state: folder that all hosts share. host: to listen on."""

    host: str = "127.0.0.1"
    encrypted: bool = True


class HandedOverError(Exception):
    """Another process goes on with the room."""


def main(arguments: list[str]) -> int:
    """Serve the room once the actor says so. Return the exit code."""
    (link_end,) = map(int, arguments)
    for each in (*system.END_SIGNALS, system.HANGUP_SIGNAL):
        if each is not None:
            signal.signal(each, signal.SIG_IGN)  # the link ends this process
    link = Link(socket.socket(fileno=link_end))
    try:
        select.select([link.socket], [], [])
        first = link.take_at_worker()[0]
        if not isinstance(first, Serve):  # the end, of one that was never needed
            return 0
        return _serve(link, msgspec.json.decode(first.job, type=RoomJob), first.number)
    except HandedOverError:
        return 0
    except LinkEndedError:
        return 1


def _serve(link: Link, job: RoomJob, number: int) -> int:
    """Serve. Raises LinkEndedError or HandedOverError: then people resume elsewhere, by the checkpoint."""
    room, lines, stop = job.rooms[0], LogLines(job.log), Stop()
    run_folder = live_run_folder(Path(job.runs), f"{room.name}-{number}", lines.say)
    job = msgspec.structs.replace(job, runs=str(run_folder or ""))
    folder = find_folder(Path(job.state))
    authenticator = TokenAuthenticator(TokenFile(folder), lines.say) if job.encrypted else None
    server = LiveServer(
        [room], job.host, 0, stop, lines.say, lambda core: channel_of(core, folder if job.encrypted else None)
    )
    if authenticator is not None:
        server.authenticator = authenticator
    _, port = server.listen()
    if job.runs and job.record:
        server.record_at = Path(job.runs) / SERVER_RECORDING
    orders = LinkOrders(link)
    housekeeping = Housekeeping(
        server, lines.say, folder=folder, authenticator=authenticator, metrics=LinkMeasures(link), software=VERSION,
        orders=orders,
    )  # fmt: skip
    housekeeping.begin()
    server.chores.append(lambda now_ns: _follow(link, orders, stop, housekeeping))
    link.send(Ready(port))
    try:
        server.run()
    finally:
        housekeeping.end(said_goodbye=bool(stop.reason))
    return conclude(server, job, {**server.drops(), **server.losses(), **housekeeping.counts()}, lines)


def _follow(link: Link, orders: LinkOrders, stop: Stop, housekeeping: Housekeeping) -> None:
    """Do what the actor says."""
    with suppress(BlockingIOError):
        while True:
            match link.take_at_worker()[0]:
                case Obey() as given:
                    orders.add(given.number, given.order)
                case HandOver():
                    housekeeping.write_checkpoints()
                    raise HandedOverError
                case End() as given:
                    stop.reason = stop.reason or given.reason
                case other:
                    raise AssertionError(f"no message for a room of a cluster: {other}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
