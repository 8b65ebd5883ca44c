"""`cogrip serve --cluster ray`: the front of this host, and rooms on all hosts of a Ray cluster (docs/scaling.md)."""

import re
import socket
from collections.abc import Sequence
from contextlib import ExitStack
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

import msgspec

from cogrip.cli.session.cluster_room import RoomJob
from cogrip.cli.session.log_lines import LogLines
from cogrip.cli.session.served_rooms import is_loopback
from cogrip.cli.session.server_state import front_channel_of, public_place
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.settings.network_rate import RateChoice
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.server.hosting.cluster.connection import ClusterError, RemoteRooms
from cogrip.server.hosting.cluster.front import ClusterFront
from cogrip.server.hosting.workers.administration import Administration
from cogrip.server.hosting.workers.steering import open_public
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.control import Control
from cogrip.server.io.loop import FLOOR_BYTES
from cogrip.server.io.metrics_feed import MetricsError, MetricsFeed, open_metrics
from cogrip.server.io.state_folder import StateError, StateFolder
from cogrip.server.io.udp_port import HostError, PortRange, ServeError, cannot_listen

COMMAND = ("cogrip.cli.session.cluster_room",)
PORTS = re.compile(r"(\d{1,5})-(\d{1,5})\Z")
MOST_PORT = 65535
ADDRESS = re.compile(r"ray(?:://(?P<head>[^/]+:\d+))?\Z")


class ClusterJob(NamedTuple):
    """Parts and settings of a front of a cluster. address: of the head, "" for the cluster of this machine.

    ports      range of the rooms' UDP ports, None for any
    in_memory  checkpoints are in the memory of two hosts
    """

    rooms: Sequence[Settings]
    address: str
    host: str
    port: int
    public: str | None
    folder: StateFolder | None
    authenticator: TokenAuthenticator | None
    encrypted: bool
    runs: Path
    record: bool
    report: bool
    rates: dict[str, RateChoice]  # choice of the rate of each room that asked for "auto"
    ports: PortRange | None
    in_memory: bool


def head_of(cluster: str) -> str:
    """Return HOST:PORT of `--cluster`, "" where it names none. Raises BadInput."""
    if (found := ADDRESS.match(cluster)) is None:
        raise BadInput(f"--cluster {cluster!r}: write ray, or ray://HOST:PORT as `ray start --head` prints them")
    return found["head"] or ""


def ports_of(given: str | None) -> PortRange | None:
    """Return the ports of `--room-ports`, None where it is not given. Raises BadInput."""
    if given is None:
        return None
    found = PORTS.match(given)
    ports = PortRange(int(found[1]), int(found[2])) if found else PortRange(0, 0)
    if not 1 <= ports.first <= ports.last <= MOST_PORT:
        raise BadInput(
            f"--room-ports {given!r}: write FIRST-LAST, two UDP ports from 1 to {MOST_PORT}, such as 48000-48100"
        )
    return ports


class ClusterServer:
    """Front on this host: it binds when it is made, `begin` lets the cluster serve the rooms, `run` serves."""

    def __init__(self, job: ClusterJob, stop: Stop, lines: LogLines, stack: ExitStack) -> None:
        self._job, self._stop, self._lines = job, stop, lines
        if job.folder is None:
            raise BadInput("serve --cluster: rooms that move need a folder for checkpoints; name one with --state")
        self._folder = job.folder
        with Problem.of(ServeError), BadInput.of(HostError):
            try:
                self._public = stack.enter_context(open_public(job.host, job.port))
            except OSError as error:
                raise cannot_listen(job.host, job.port, error) from None
        self.bound: tuple[str, int] = self._public.getsockname()[:2]

    def begin(self, metrics: int | None, stack: ExitStack) -> MetricsFeed | None:
        """Connect to the cluster, and hand the rooms over to it. Raises Problem."""
        job, say = self._job, self._lines.say
        loopback = is_loopback(job.host)
        try:
            guarded = job.encrypted and not loopback
            self._pool = RemoteRooms(job.address, COMMAND, loopback, self._folder, guarded)
            self._pool.begin(self._place(), {room.name: self._room_job(room, loopback) for room in job.rooms})
            channel = front_channel_of(lambda address: False, job.rooms, job.folder if job.encrypted else None)
            self._front = ClusterFront(self._public, job.rooms, self._pool, self._stop, say, channel, job.authenticator)
            feed = None if metrics is None else open_metrics(metrics, say)
            control = Control(self._folder)
        except (ClusterError, MetricsError, StateError) as error:
            raise Problem(f"serve: {error}") from None
        self.administration = Administration(
            self._front, say, VERSION, control=control, authenticator=job.authenticator, metrics=feed,
            reload=self._stop.take_reload, drain=self._pool.drain,
        )  # fmt: skip
        return feed

    def run(self, seconds: float | None) -> int:
        """Serve until stopped, at most for `seconds`. Return the exit code, of rooms that end with this front."""
        self.administration.begin()
        try:
            self._front.run(seconds)
        finally:
            code = self._pool.end(self._stop.reason)
            self.administration.end()
        self._lines.say(self._stop.reason)
        dropped = {name: count for name, count in sorted(self._front.drops().items()) if count}
        if dropped:
            self._lines.say(f"at the front: {', '.join(f'{name}: {count}' for name, count in dropped.items())}")
        return code

    def _place(self) -> str:
        """Return HOST:PORT by which people reach this front, with an address."""
        host, port = public_place(self._job.public, self.bound)
        try:
            ip_address(host)
        except ValueError:
            try:
                host = str(socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][4][0])
            except OSError as error:
                raise Problem(f"--public {host}: {error.strerror}; give an address that people reach") from None
        return place_text((host, port))

    def _room_job(self, room: Settings, loopback: bool) -> bytes:
        job = self._job
        wildcard = "::" if ":" in self.bound[0] else "0.0.0.0"
        return msgspec.json.encode(
            RoomJob(
                (room,), str(self._folder.shared), str(job.runs.absolute()), job.record, job.report, self._lines.form, True,
                job.rates, FLOOR_BYTES, None, self.bound[0] if loopback else wildcard, job.encrypted, job.ports, job.in_memory,
            )
        )  # fmt: skip
