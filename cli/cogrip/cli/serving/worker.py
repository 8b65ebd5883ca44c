"""Process of one worker: an ordinary server of its rooms, whose people a front process hands over.

Started by `cogrip.cli.serving.workers` with two descriptors: its end of the link, and a file with the job.
"""

import os
import secrets
import select
import socket
from pathlib import Path
from typing import Literal

import msgspec

from cogrip.cli.serving.log_lines import LogLines
from cogrip.machine.server_platform import content_of
from cogrip.machine.stop import Stop
from cogrip.protocol.settings.network_rate import RateChoice
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.results.reading.folder import SERVER_RECORDING, write_settings
from cogrip.server.hosting.link import Assign, LinkEndedError, ProcessLink, Ready, RoomOnDemand
from cogrip.server.hosting.orders import LinkMeasures, LinkOrders
from cogrip.server.hosting.workers.channel import WorkerChannel
from cogrip.server.hosting.workers.paths import WorkerSockets
from cogrip.server.hosting.workers.verdicts import FrontVerdicts
from cogrip.server.io.housekeeping import Housekeeping
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.rooms_on_demand import EMPTY_S
from cogrip.server.io.state_folder import StateFolder
from cogrip.server.rate_limit import RateLimiter, limits_for
from cogrip.server.room import Room


class WorkerJob(msgspec.Struct, frozen=True):
    """Settings that all workers of a server get. rooms: all of them; state, runs: folders, "" for none."""

    rooms: tuple[Settings, ...]
    state: str
    runs: str
    record: bool
    report: bool
    log: Literal["text", "json"]
    metrics: bool
    rates: dict[str, RateChoice]  # choice of the rate of each room that asked for "auto"
    floor_bytes: int  # bytes of a disk that recordings leave free
    hand_over_s: float | None  # wait for the next server, as `LiveServer.hand_over_s`
    templates: dict[str, tuple[str, ...]] = {}  # names of the spare rooms of each template
    empty_s: float = EMPTY_S  # how long a room on demand may be empty


def main(arguments: list[str]) -> int:
    """Serve the rooms that the front assigns. Return the exit code."""
    link_end, job_file, number = map(int, arguments)
    job = msgspec.json.decode(content_of(job_file), type=WorkerJob)
    os.close(job_file)
    link = ProcessLink(socket.socket(fileno=link_end))
    for kind in {room.object.kind: room for room in job.rooms}.values():
        Room(kind)  # all that is imported for such rooms is there before they are assigned
    try:
        return _serve(link, job, number)
    except LinkEndedError:
        return 1


def _serve(link: ProcessLink, job: WorkerJob, number: int) -> int:
    """Serve until the front says so. Raises LinkEndedError: then people resume at the next server, by the checkpoints."""
    select.select([link.socket], [], [])
    first, descriptors = link.take_at_worker()
    if not isinstance(first, Assign):  # the end, of one that was never needed
        return 0
    shared = socket.socket(fileno=descriptors[0]) if descriptors else None
    rooms = [room for room in job.rooms if room.name in first.rooms]
    lines, stop = LogLines(job.log), Stop()
    verdicts, orders = FrontVerdicts(link), LinkOrders(link)
    verdicts.void(first.revoked, first.expired)
    sockets = WorkerSockets(link, stop, verdicts, orders, shared, first.own)
    rate_limiter = RateLimiter(secrets.token_bytes(16), limits_for(max(room.rates.network_hz for room in rooms)))
    server = LiveServer(
        rooms, "", 0, stop, lines.say, lambda core: WorkerChannel(link, sockets, rate_limiter, core.knows),
        authenticator=verdicts, floor_bytes=job.floor_bytes, hand_over_s=job.hand_over_s,
    )  # fmt: skip
    server.serve_at(sockets)
    runs = Path(job.runs) if job.runs else None
    if runs is not None:
        server.record_at = runs / f"worker-{number}" / SERVER_RECORDING if job.record else None
    own = {name: tuple(filter(first.rooms.__contains__, spare)) for name, spare in job.templates.items()}
    folder = StateFolder(Path(job.state)) if job.state else None
    housekeeping = Housekeeping(
        server, lines.say, folder=folder, authenticator=verdicts, metrics=LinkMeasures(link) if job.metrics else None,
        software=VERSION, fresh=first.fresh, orders=orders, templates={name: spare for name, spare in own.items() if spare},
        empty_s=job.empty_s,
        room_changed=lambda room, is_open: link.send(RoomOnDemand(room.called, room.template, is_open)),
    )  # fmt: skip
    housekeeping.begin()
    for room in server.core.rooms:
        if room.template and room.is_open:  # by its checkpoint
            link.send(RoomOnDemand(room.called, room.template, True))
    link.send(Ready())
    try:
        server.run()
    finally:
        housekeeping.end(said_goodbye=bool(stop.reason))
    return conclude(server, job, {**server.drops(), **server.losses(), **housekeeping.counts()}, lines)


def conclude(server: LiveServer, job: WorkerJob, losses: dict[str, int], lines: LogLines) -> int:
    """Leave a summary for each room that somebody was in. Return the exit code."""
    from cogrip.cli.runs.run_folder import leave_files  # people who lost their server wait for a worker's start
    from cogrip.cli.session.network_rate import write_choice
    from cogrip.cli.terminal.output import make_console
    from cogrip.results.verdict.verdict import came, succeeded
    from cogrip.results.writing.summary import of_room

    if lines.lost:
        losses["log line"] = lines.lost
    well = True
    console = make_console(soft_wrap=True, stderr=True)
    for room in server.core.rooms:
        if room.template:  # whatever was opened under it, and more than once
            continue
        summary = of_room(room, server.elapsed_s, losses)
        well = well and (succeeded(summary) or not came(summary))
        if job.runs and came(summary):
            folder = Path(job.runs) / room.name
            try:
                write_settings(folder, room.settings)
                write_choice(folder, job.rates.get(room.name))
            except OSError as error:
                lines.say(f"warning: {folder}: {error.strerror}; no settings are left there")
            leave_files(folder, summary, console, shown=False, report=job.report)
    return 0 if well else 1
