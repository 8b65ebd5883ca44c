"""A client's paths to its server: a socket and a channel each; one, or while the session resumes, a second and newer one.

A server may redirect to another, which has the room (SPEC section 4.5): then the newer path leads there. Whoever is silent is
asked in turn with the servers that the redirect named.
"""

import socket
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any, Protocol

from cogrip.client.inputs import Connect, Poll
from cogrip.client.path_migration import PathMigration
from cogrip.machine.datagrams import open_arrivals
from cogrip.machine.platform import system, time
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import PEER, Channel, place_text
from cogrip.protocol.wire.join_link import LinkError, split_place
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES, Redirect
from cogrip.protocol.wire.session import GIVE_UP_NS, MOST_REDIRECTS, ClientSession

REFUSED = "connection refused"
POLL_S = 0.002  # time between two polls where nothing ticks
# Most datagrams of one path in one drain: half a second of waves. A flood may not hold a tick up while the motors hold
# an old force.
MOST_DATAGRAMS = 64
# Longest wait that is believed. A datagram that waited longer, while the loop was away or a device was opened, is
# passed on as if it had waited so long.
MOST_WAITED_NS = 20_000_000
MOST_MESSAGES = 16  # most messages taken from one datagram: an honest one holds one or two
LEFT = "left for the next tick"  # reason that `drain` counts where it stops at MOST_DATAGRAMS
TOO_MANY = "too many messages"  # reason under which each message beyond MOST_MESSAGES is counted


class JoinError(Exception):
    """There is no seat. The text says why and what to do."""


class RefusedError(JoinError):
    """The client itself refuses the settings that the server gave the seat."""


@dataclass(frozen=True, slots=True)
class Server:
    """Address of a server: as it was asked for, and as a socket takes it."""

    host: str
    port: int
    family: socket.AddressFamily
    address: Any

    @property
    def loopback(self) -> bool:
        """True where nothing that is sent to it leaves this machine."""
        return ip_address(self.address[0].partition("%")[0]).is_loopback


def find(host: str, port: int) -> Server:
    """Look a server's name up, once: a session is resumed at the same address. Raises JoinError."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:
        raise JoinError(f"{host}: {getattr(error, 'strerror', None) or error}; check the server's name") from None
    return Server(host, port, found[0], found[4])


def server_of(place: str) -> Server | None:
    """Return the server at HOST:PORT, None where the host is no address: nothing is looked up here."""
    try:
        host, port = split_place(place)
        address = ip_address(host)
    except (LinkError, ValueError):
        return None
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    return None if port is None else Server(host, port, family, (host, port))


def session_change(session: ClientSession, before: str, after: str) -> str:
    """Return what to tell a person of a change of the session's state, "" for nothing."""
    if after == "resuming" and session.restarting:
        return "the server restarts: held off until it is back"
    if after == "resuming":
        return "the server is silent: trying to resume"
    if before == "resuming" and after == "seated":
        return f"resumed after {session.silence_ns / 1e9:.1f} s"
    return ""


class NetworkPath:
    """One socket and its channel.

    refused  nobody listens at the other end
    met      a handshake was made, or none is needed
    """

    def __init__(self, server: Server, channel: Channel) -> None:
        self.server = server
        self.socket = socket.socket(server.family, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.arrivals = open_arrivals(self.socket)
        self.channel = channel
        self.refused = False
        self.met = self.ready

    def receive(self, now_ns: int) -> tuple[bytes, int] | None:
        """Return a datagram, and when it came as `Arrivals.poll` says; None where there is none. Raises OSError."""
        found = self.arrivals.poll(MAX_DATAGRAM_BYTES + 1, now_ns)
        return None if found is None else (found[0], found[2])

    @property
    def ready(self) -> bool:
        """True where messages can be sent."""
        return self.channel.ready(PEER)


class Core(Protocol):
    """A core that wants a seat: a person's, or an observer's."""

    session: ClientSession

    def handle(self, given: Connect | Poll, now_ns: int) -> object: ...
    def receive(self, datagram: bytes, now_ns: int) -> None: ...


class Paths:
    """`open` the first path, then `send`, `drain` and `poll` on every tick; none of them waits for anything.

    failed  why the newest path cannot be used, "" while it can
    """

    def __init__(self, server: Server, make_channel: Callable[[], Channel], roams: bool = True) -> None:
        """roams: whether a redirect may lead from this machine to another."""
        self.server = server
        self.failed = ""
        self.make_channel, self._roams = make_channel, roams
        self._counts: Counter[str] = Counter()
        self._came_ns = 0  # as which time the newest datagram was given on: it never falls, whatever path it came by
        self._migration: PathMigration
        self._opened = False
        self._hello = b""  # waits for its path to be ready
        self._newest_hello = b""
        self._known: list[Server] = []  # that are asked in turn, in a silence
        self._asked = 0  # number of the next of them
        self._redirects = 0  # since the last welcome, or the last path that was opened without one

    def open(self) -> None:
        """Open the first path. Raises JoinError."""
        self._known = [self.server]
        path = self._open_path(self.server)
        if path is None:
            raise JoinError(f"{self.server.host}:{self.server.port}: {self.failed}; check the network of this machine")
        self._migration = PathMigration(path)
        self._opened = True

    def _open_path(self, server: Server) -> NetworkPath | None:
        path = NetworkPath(server, self.make_channel())
        try:
            path.socket.connect(server.address)
        except OSError as error:  # there is no network just now
            self._count(error)
            self.failed = f"socket: {error.strerror}"
            path.socket.close()
            return None
        return path

    @property
    def paths(self) -> tuple[NetworkPath, ...]:
        """Paths that are open, the one in use first."""
        return self._migration.paths

    @property
    def attempts(self) -> int:
        """Number of times that another path was tried."""
        return self._migration.attempts

    def explained(self, failed: str) -> str:
        """Add to why a session failed what is wrong with the newest path."""
        return f"{failed}; the last path to it: {self.failed}" if failed and self.failed else failed

    def counted(self) -> dict[str, int]:
        """Count what went wrong on sockets and channels so far, by name."""
        counts = self._counts.copy()
        for path in self._migration.paths:
            counts.update(path.channel.dropped)
        return dict(counts)

    def send(self, message: bytes, hello: bool = False) -> None:
        """Send by the path in use; a hello by the newest path, as soon as it is ready."""
        path = self._migration.path
        if hello:
            self._newest_hello = message
            path = self._migration.newest
            if not path.ready:
                self._hello = message
                return
        path.channel.send(message, PEER)
        self._flush(path)

    def drain(
        self, now_ns: int, take: Callable[[bytes, int], None], answers: Callable[[bytes], bool],
        redirect: Callable[[bytes], Redirect | None] = lambda message: None,
    ) -> None:  # fmt: skip
        """Give `take` the messages that have come, and when they came, within MOST_WAITED_NS; follow redirects.

        answers: tells a welcome, whose path is used from then on; redirect: returns a redirect that is awaited.
        At most MOST_DATAGRAMS by each path: what is beyond them waits in the socket for the next drain.
        """
        path, newer = self._migration.path, self._migration.newer
        self._drain_path(path, now_ns, take, answers, redirect)
        if newer is not None and self._uses(newer):  # else it was closed just now
            self._drain_path(newer, now_ns, take, answers, redirect)

    def _uses(self, path: NetworkPath) -> bool:
        return path is self._migration.path or path is self._migration.newer

    def _drain_path(
        self, path: NetworkPath, now_ns: int, take: Callable[[bytes, int], None], answers: Callable[[bytes], bool],
        redirect: Callable[[bytes], Redirect | None],
    ) -> None:  # fmt: skip
        channel = path.channel
        for _ in range(MOST_DATAGRAMS):
            try:
                found = path.receive(now_ns)
            except OSError as error:
                path.refused = path.refused or isinstance(error, system.NOBODY_LISTENS)
                self._count(error)
                break
            if found is None:
                break
            (datagram, arrived_ns), path.refused = found, False
            self._came_ns = came_ns = max(self._came_ns, arrived_ns, now_ns - MOST_WAITED_NS)
            messages = channel.receive(datagram, PEER, now_ns)
            if len(messages) > MOST_MESSAGES:
                self._counts[TOO_MANY] += len(messages) - MOST_MESSAGES
                messages = messages[:MOST_MESSAGES]
            for message in messages:
                if (told := redirect(message)) is not None:
                    self._follow(told, now_ns)
                    continue
                if self._migration.newer is not None and answers(message):
                    self._adopt(path)
                take(message, came_ns)
            if not self._uses(path):  # a redirect has closed it
                break
        else:
            self._counts[LEFT] += 1
        if channel.outbox:
            self._flush(path)

    def _adopt(self, path: NetworkPath) -> None:
        """Use a path from now on, and ask its server first in the next silence."""
        self._close(*self._migration.adopt(path, self._migration.newest.ready))
        self.failed, self._redirects, self._hello = "", 0, b""
        if path.server not in self._known:
            self._known[:0] = [path.server]

    def _follow(self, redirect: Redirect, now_ns: int) -> None:
        """Open a path to the server that a redirect names."""
        migration, place = self._migration, server_of(redirect.place)
        if place is None or (self.server.loopback and not place.loopback and not self._roams):
            self._counts["redirect not followed"] += 1
        elif place == migration.newest.server:
            pass  # a repeated hello was answered again
        elif self._redirects >= MOST_REDIRECTS:
            self._counts["too many redirects"] += 1
        else:
            self._redirects += 1
            fronts = [front for front in map(server_of, redirect.fronts) if front is not None]
            self._known = list(dict.fromkeys([self.server, *fronts]))
            self._asked, self._hello = 0, self._newest_hello
            another = self._open_path(place)
            self._close(migration.tried(another, now_ns))

    def poll(self, now_ns: int, resuming: bool) -> bool:
        """Go on with handshakes; try another path where one is due. Returns whether the server has just made a handshake."""
        migration = self._migration
        self._asked = self._asked if resuming else 0
        newest: NetworkPath = migration.path
        self._run_timers(newest, now_ns)
        if migration.newer is not None:
            newest = migration.newer
            self._run_timers(newest, now_ns)
        ready = newest.channel.ready(PEER)
        just_met, newest.met = ready and not newest.met, newest.met or ready
        if migration.due(now_ns, resuming, ready, newest.refused):
            self.failed = newest.channel.failed or self.failed
            server = self._known[self._asked % len(self._known)]
            self._asked, self._redirects = self._asked + 1, 0
            another = self._open_path(server)
            self._close(migration.tried(another, now_ns))
            if another is not None:
                another.channel.poll(now_ns)
                self._flush(another)
        elif self._hello and ready:
            message, self._hello = self._hello, b""
            self.send(message, hello=True)
        if migration.newer is not None:
            self._close(migration.spare(now_ns, resuming))
        return just_met

    def _run_timers(self, path: NetworkPath, now_ns: int) -> None:
        channel = path.channel
        channel.poll(now_ns)
        if channel.outbox:
            self._flush(path)

    def close(self) -> None:
        """Tell the other end, where it can be reached, and close all paths."""
        if self._opened:
            self._opened = False
            self._close(*self._migration.paths)

    def _close(self, *paths: NetworkPath | None) -> None:
        for path in filter(None, paths):
            path.channel.close(PEER)
            self._flush(path)
            self._counts.update(path.channel.dropped)
            path.socket.close()

    def _flush(self, path: NetworkPath) -> None:
        """Send everything that a channel leaves; the last error is counted."""
        outbox, failure = path.channel.outbox, None
        while outbox:
            try:
                path.socket.send(outbox.popleft()[1])
            except OSError as error:
                failure = error
        if failure is not None:
            path.refused = path.refused or isinstance(failure, system.NOBODY_LISTENS)
            self._count(failure)

    def _count(self, error: OSError) -> None:
        self._counts[REFUSED if isinstance(error, system.NOBODY_LISTENS) else f"socket: {error.strerror}"] += 1

    def connect(self, core: Core, stop: Stop) -> None:
        """Open the first path, and ask for a seat until the server has answered. Raises JoinError."""
        self.open()
        session, asked = core.session, False
        begun_ns = time.monotonic_ns()
        while session.state in ("idle", "connecting"):
            now_ns = time.monotonic_ns()
            path = self._migration.path
            failed = path.channel.failed
            if failed or stop.reason:
                raise JoinError(self._placed(failed or f"{stop.reason} before a seat was had"))
            if asked:
                core.handle(Poll(), now_ns)
            elif path.ready:
                asked = True
                core.handle(Connect(), now_ns)
            elif self._counts[REFUSED] and now_ns - begun_ns >= GIVE_UP_NS:
                raise JoinError(self._placed(f"no server answered within {GIVE_UP_NS / 1e9:g} s"))
            while session.outbox:
                self.send(session.outbox.popleft(), hello=True)
            self.drain(now_ns, core.receive, session.is_welcome, session.redirect)
            self.poll(now_ns, resuming=False)
            time.sleep(POLL_S)
        if session.state == "closed":
            raise JoinError(self._placed(session.failed))

    def _placed(self, text: str) -> str:
        """Add the server's address, with a hint where the network refused."""
        place = place_text((self.server.host, self.server.port))
        if self._counts[REFUSED]:
            return f"{text}; nothing listens on {place}: is the server running there?"
        return f"{text} (server {place})"
