"""A client's ways to its server: a socket and a channel each; one, or while the session resumes, a second and newer one."""

import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from ipaddress import ip_address
from typing import Any, Protocol

from cogrip.client.inputs import Connect, Poll
from cogrip.client.path_migration import PathMigration
from cogrip.protocol.channel import PEER, Channel
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.messages import MAX_DATAGRAM_BYTES
from cogrip.protocol.session import GIVE_UP_NS, ClientSession

REFUSED = "connection refused"
POLL_S = 0.002  # between two looks where nothing ticks
# Of one way in one drain: half a second of waves. A flood may not hold a tick up while the motors hold an old force.
MOST_DATAGRAMS = 64
MOST_MESSAGES = 16  # of one datagram: an honest one holds one or two
LEFT = "left for the next tick"  # counted by drain
TOO_MANY = "too many messages"  # counted by message


class JoinError(Exception):
    """No seat was had. The text says why and what to do."""


class RefusedError(JoinError):
    """The client's own judgement refuses the settings that the server gave the seat."""


@dataclass(frozen=True, slots=True)
class Server:
    """Where a server is: as it was asked for, and as a socket takes it."""

    host: str
    port: int
    family: socket.AddressFamily
    address: Any

    @property
    def loopback(self) -> bool:
        """Whether nothing of what is said to it leaves this machine."""
        return ip_address(self.address[0].partition("%")[0]).is_loopback


def find(host: str, port: int) -> Server:
    """Look a server's name up, once: whoever comes back comes back to the same address. Raises JoinError."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:
        raise JoinError(f"{host}: {getattr(error, 'strerror', None) or error}; check the server's name") from None
    return Server(host, port, found[0], found[4])


class NetworkPath:
    """One way."""

    def __init__(self, server: Server, channel: Channel) -> None:
        self.socket = socket.socket(server.family, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.channel = channel
        self.refused = False  # nobody listens there

    def put(self) -> OSError | None:
        """Everything that the channel leaves goes out; the last trouble with that."""
        outbox, trouble = self.channel.outbox, None
        while outbox:
            try:
                self.socket.send(outbox.popleft()[1])
            except OSError as error:
                trouble = error
        return trouble


class Core(Protocol):
    """What is called: a person's core, or an observer's."""

    session: ClientSession

    def handle(self, given: Connect | Poll, now_ns: int) -> object: ...
    def receive(self, datagram: bytes, now_ns: int) -> None: ...


@dataclass(slots=True)
class Paths:
    """`open` the first way, then `send`, `drain` and `poll` on every tick; none of them waits for anything."""

    server: Server
    make_channel: Callable[[], Channel]
    counts: dict[str, int] = field(default_factory=dict)
    failed: str = ""  # why the newest way cannot be used, "" while it can
    _migration: PathMigration[NetworkPath] = field(init=False)
    _opened: bool = False
    _asked: bytes = b""  # a hello that waits for its way to open

    def open(self) -> None:
        """The first way. Raises JoinError."""
        call = self._dial()
        if call is None:
            raise JoinError(f"{self.server.host}:{self.server.port}: {self.failed}; check the network of this machine")
        self._migration = PathMigration(call)
        self._opened = True

    def _dial(self) -> NetworkPath | None:
        call = NetworkPath(self.server, self.make_channel())
        try:
            call.socket.connect(self.server.address)
        except OSError as error:  # there is no network just now
            self._note(error)
            self.failed = f"socket: {error.strerror}"
            call.socket.close()
            return None
        return call

    @property
    def ready(self) -> bool:
        """Whether messages can be sent by the way in use."""
        return self._migration.path.channel.ready(PEER)

    @property
    def dials(self) -> int:
        """How often another way was dialled."""
        return self._migration.dials

    def counted(self) -> dict[str, int]:
        """What went wrong on sockets and channels so far, by name."""
        counts = dict(self.counts)
        for call in self._migration.paths:
            _add(counts, call.channel.dropped)
        return counts

    def send(self, message: bytes, hello: bool = False) -> None:
        """By the way in use; a hello by the newest way, as soon as it is open."""
        call = self._migration.path
        if hello:
            call = self._migration.asking
            if not call.channel.ready(PEER):
                self._asked = message
                return
        call.channel.send(message, PEER)
        self._put(call)

    def drain(self, now_ns: int, take: Callable[[bytes, int], None], answers: Callable[[bytes], bool]) -> None:
        """Give `take` the messages that have come. answers: whether it is a welcome; by its way it goes on then.

        At most MOST_DATAGRAMS by each way: what is beyond them waits in the socket for the next drain.
        """
        for call in self._migration.paths:
            if call not in self._migration.paths:
                continue  # it was closed just now
            receive, channel = call.socket.recv, call.channel
            for _ in range(MOST_DATAGRAMS):
                try:
                    datagram = receive(MAX_DATAGRAM_BYTES + 1)
                except BlockingIOError:
                    break
                except OSError as error:
                    call.refused = call.refused or isinstance(error, ConnectionRefusedError)
                    self._note(error)
                    break
                call.refused = False
                messages = channel.receive(datagram, PEER, now_ns)
                if len(messages) > MOST_MESSAGES:
                    _add(self.counts, {TOO_MANY: len(messages) - MOST_MESSAGES})
                    messages = messages[:MOST_MESSAGES]
                for message in messages:
                    if self._migration.newer is not None and answers(message):
                        self._close(*self._migration.adopt(call))
                        self.failed = ""
                    take(message, now_ns)
            else:
                _add(self.counts, {LEFT: 1})
            if channel.outbox:
                self._put(call)

    def poll(self, now_ns: int, resuming: bool) -> None:
        """Handshakes go on; another way is dialled where one is needed."""
        migration = self._migration
        for call in migration.paths:
            call.channel.poll(now_ns)
            if call.channel.outbox:
                self._put(call)
        newest = migration.asking
        ready = newest.channel.ready(PEER)
        if migration.due(now_ns, resuming, ready, newest.refused):
            self.failed = newest.channel.failed or self.failed
            fresh = self._dial()
            self._close(migration.dialled(fresh, now_ns))
            if fresh is not None:
                fresh.channel.poll(now_ns)
                self._put(fresh)
        elif self._asked and ready:
            message, self._asked = self._asked, b""
            self.send(message, hello=True)
        if migration.newer is not None:
            self._close(migration.spare(now_ns, resuming))

    def close(self) -> None:
        """Tell the other end, where there is a way to, and let go."""
        if self._opened:
            self._opened = False
            self._close(*self._migration.paths)

    def _close(self, *calls: NetworkPath | None) -> None:
        for call in calls:
            if call is None:
                continue
            call.channel.close(PEER)
            self._put(call)
            _add(self.counts, call.channel.dropped)
            call.socket.close()

    def _put(self, call: NetworkPath) -> None:
        trouble = call.put()
        if trouble is not None:
            call.refused = call.refused or isinstance(trouble, ConnectionRefusedError)
            self._note(trouble)

    def _note(self, error: OSError) -> None:
        _add(self.counts, {REFUSED if isinstance(error, ConnectionRefusedError) else f"socket: {error.strerror}": 1})

    def call(self, core: Core, stop: Stop) -> None:
        """Open the first way and call until the server has answered. Raises JoinError."""
        self.open()
        session, called = core.session, False
        begun_ns = time.monotonic_ns()
        while session.state in ("idle", "calling"):
            now_ns = time.monotonic_ns()
            failed = self._migration.path.channel.failed
            if failed or stop.reason:
                raise JoinError(self._placed(failed or f"{stop.reason} before a seat was had"))
            if not called and self.ready:
                called = True
                core.handle(Connect(), now_ns)
            elif called:
                core.handle(Poll(), now_ns)
            elif self.counts.get(REFUSED) and now_ns - begun_ns >= GIVE_UP_NS:
                raise JoinError(self._placed(f"no server answered within {GIVE_UP_NS / 1e9:g} s"))
            while session.outbox:
                self.send(session.outbox.popleft(), hello=True)
            self.drain(now_ns, core.receive, session.answers)
            self.poll(now_ns, resuming=False)
            time.sleep(POLL_S)
        if session.state == "closed":
            raise JoinError(self._placed(session.failed))

    def _placed(self, words: str) -> str:
        """With where that was, and what the network said of it."""
        place = f"{self.server.host}:{self.server.port}"
        hint = f"; nothing listens on {place}: is the server running there?" if self.counts.get(REFUSED) else ""
        return f"{words}{hint} (server {place})"


def _add(counts: dict[str, int], more: Mapping[str, int]) -> None:
    for name, count in more.items():
        counts[name] = counts.get(name, 0) + count
