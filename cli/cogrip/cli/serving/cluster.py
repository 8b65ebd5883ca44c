"""`cogrip serve --cluster ray`: the front of this host, and rooms on all hosts of a Ray cluster (docs/scaling.md)."""

import re
import socket
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

import msgspec

from cogrip.cli.serving.cluster_room import RoomJob
from cogrip.cli.serving.front_socket import front_socket, say_drops
from cogrip.cli.serving.log_lines import LogLines
from cogrip.cli.serving.server_state import front_channel_of, public_place
from cogrip.cli.session.loopback import is_loopback
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.server.hosting.administration import Administration
from cogrip.server.hosting.cluster.connection import ClusterError, RemoteRooms
from cogrip.server.hosting.cluster.front import ClusterFront
from cogrip.server.hosting.placement import Served
from cogrip.server.io.control import Control
from cogrip.server.io.loop import FLOOR_BYTES
from cogrip.server.io.metrics_feed import MetricsFeed
from cogrip.server.io.state_folder import StateError
from cogrip.server.io.udp_socket import UdpRange

COMMAND = ("cogrip.cli.serving.cluster_room",)
PORTS = re.compile(r"(\d{1,5})-(\d{1,5})\Z")
MOST_PORT = 65535
ADDRESS = re.compile(r"ray(?:://(?P<head>[^/]+:\d+))?\Z")


class ClusterFlags(NamedTuple):
    """Flags of a cluster.

    head       address of its head, "" for the cluster of this machine
    public     HOST or HOST:PORT by which people reach this front; None: guessed
    ports      range of the rooms' UDP ports, None for any
    in_memory  checkpoints are in the memory of two hosts
    runs       folder in which each room makes a folder of its own
    """

    head: str
    public: str | None
    ports: UdpRange | None
    in_memory: bool
    runs: Path


def head_of(cluster: str) -> str:
    """Return HOST:PORT of `--cluster`, "" where it names none. Raises BadInput."""
    if (found := ADDRESS.match(cluster)) is None:
        raise BadInput(f"--cluster {cluster!r}: write ray, or ray://HOST:PORT as `ray start --head` prints them")
    return found["head"] or ""


def udp_range_of(given: str | None) -> UdpRange | None:
    """Return the ports of `--room-ports`, None where it is not given. Raises BadInput."""
    if given is None:
        return None
    found = PORTS.match(given)
    ports = UdpRange(int(found[1]), int(found[2])) if found else UdpRange(0, 0)
    if not 1 <= ports.first <= ports.last <= MOST_PORT:
        raise BadInput(
            f"--room-ports {given!r}: write FIRST-LAST, two UDP ports from 1 to {MOST_PORT}, such as 48000-48100"
        )
    return ports


class ClusterServer:
    """Placement of the rooms on the hosts of a cluster: a front listens here, `begin` lets the cluster serve the rooms."""

    def __init__(self, served: Served, flags: ClusterFlags, stop: Stop, lines: LogLines, stack: ExitStack) -> None:
        """Listen. Raises Problem."""
        self._served, self._flags, self._stop, self._lines = served, flags, stop, lines
        if served.folder is None:
            raise BadInput("serve --cluster: rooms that move need a folder for checkpoints; name one with --state")
        self._folder = served.folder
        self._public = front_socket(served, stack)
        self.bound: tuple[str, int] = self._public.getsockname()[:2]

    def begin(self, feed: MetricsFeed | None, told: Mapping[str, Sequence[str]]) -> Administration:
        """Connect to the cluster, and hand the rooms over to it. Raises Problem."""
        served, say = self._served, self._lines.say
        loopback = is_loopback(served.host)
        with Problem.of(ClusterError, StateError, where="serve: "):
            guarded = served.encrypted and not loopback
            self._pool = RemoteRooms(self._flags.head, COMMAND, loopback, self._folder, guarded)
            self._pool.begin(self._place(), {room.name: self._room_job(room, loopback) for room in served.rooms})
            channel = front_channel_of(lambda address: False, served.rooms, served.key_folder)
            self._front = ClusterFront(
                self._public, served.rooms, self._pool, self._stop, say, channel, served.authenticator
            )
            control = Control(self._folder)
        self._administration = Administration(
            self._front, say, VERSION, control=control, authenticator=served.authenticator, metrics=feed,
            reload=self._stop.take_reload, drain=self._pool.drain,
        )  # fmt: skip
        return self._administration

    def run(self, seconds: float | None) -> int:
        """See `Placement`. The exit code is that of the rooms that end with this front."""
        try:
            self._front.run(seconds)
        finally:
            code = self._pool.end(self._stop.reason)
            self._administration.end()
        self._lines.say(self._stop.reason)
        say_drops(self._front, self._lines.say)
        return code

    def _place(self) -> str:
        """Return HOST:PORT by which people reach this front, with an address."""
        host, port = public_place(self._flags.public, self.bound)
        try:
            ip_address(host)
        except ValueError:
            try:
                host = str(socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][4][0])
            except OSError as error:
                raise Problem(f"--public {host}: {error.strerror}; give an address that people reach") from None
        return place_text((host, port))

    def _room_job(self, room: Settings, loopback: bool) -> bytes:
        served, flags = self._served, self._flags
        wildcard = "::" if ":" in self.bound[0] else "0.0.0.0"
        return msgspec.json.encode(
            RoomJob(
                (room,), str(self._folder.shared), str(flags.runs.absolute()), served.record, served.report, self._lines.form,
                True, dict(served.rates), FLOOR_BYTES, None, host=self.bound[0] if loopback else wildcard,
                encrypted=served.encrypted, ports=flags.ports, in_memory=flags.in_memory,
            )
        )  # fmt: skip
