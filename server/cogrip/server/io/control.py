"""Administration of a running server: HTTP with JSON over a unix socket in its state folder (docs/administration.md).

The folder's mode decides who may ask. The server's half never waits: it is polled between two ticks.
"""

import errno
import os
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

import msgspec

from cogrip.machine.server_platform import local_socket
from cogrip.server.administration.connection import (
    MOST_ANSWER_BYTES,
    MOST_BODY_BYTES,
    HttpAsker,
    HttpCaller,
    HttpRequest,
    RefusedError,
)
from cogrip.server.administration.operations import (
    METRICS,
    Answer,
    AskedOrder,
    EventFilter,
    UnknownError,
    order_of,
)
from cogrip.server.administration.orders import AnyOrder, OrderReply, Request
from cogrip.server.events import ServerEvent
from cogrip.server.io.state_folder import FILE_MODE, StateError, StateFolder

MOST_CALLERS = 8  # most callers at once; further ones wait in the socket's queue
MOST_STREAMS = 8  # most streams of events at once, beside the callers
MOST_KEPT = 256  # most events that are kept for a stream that begins later
MOST_UNSENT_BYTES = (
    65536  # most bytes that wait for one stream's reader; events beyond them are counted, and told as "lost"
)
CALLER_LIMIT_NS = 5_000_000_000
ALIVE_NS = 15_000_000_000  # time between two comments in a stream
ASK_LIMIT_S = 5.0
_QUEUE_WAIT_S = 0.01
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)  # error numbers of a folder that may take files again
AGAIN_NS = 5_000_000_000
MOST_PATH_BYTES = 103  # longest path of a unix socket on every system: 107 bytes on Linux, 103 on macOS
LOST = "lost_events"  # event of a stream that tells how many its reader was too slow for


class ControlError(StateError):
    """The server could not be asked, or did not answer. The text says why and what to do."""


class NotRunningError(ControlError):
    """There is no server."""


@dataclass(slots=True, eq=False)
class _Caller:
    """unsent: rest of the answer; None: no answer yet."""

    socket: socket.socket
    since_ns: int
    http: HttpCaller = field(default_factory=HttpCaller)
    asked: bool = False
    unsent: bytes | None = None


@dataclass(slots=True, eq=False)
class _Stream:
    """Reader of events. lost: those that found no room since it was told last."""

    socket: socket.socket
    http: HttpCaller
    takes: EventFilter
    next_alive_ns: int
    unsent: bytes
    lost: int = 0


class Control:
    """Server's half, for the holder of the folder (`one_server`). Raises ControlError.

    dropped  counts by reason
    trouble  why nobody can ask, as the folder has no room for the socket; tried again every few seconds. "" where one can
    """

    def __init__(self, folder: StateFolder) -> None:
        self.dropped: Counter[str] = Counter()
        self.trouble = ""
        self._path = _fit_path(folder)
        self.metrics_at = ""  # address of the metrics' page, where there is one
        self._callers: list[_Caller] = []
        self._streams: list[_Stream] = []
        self._events: deque[tuple[int, ServerEvent]] = deque(maxlen=MOST_KEPT)
        self._number = 0  # of the newest event
        self._again_ns = 0
        self._listen()

    def _listen(self) -> None:
        """Raises ControlError, but where the folder has no room."""
        self._socket = local_socket(socket.SOCK_STREAM)
        self.trouble = ""
        try:
            with suppress(FileNotFoundError):
                os.unlink(self._path)  # a killed server left it
            self._socket.bind(self._path)
            os.chmod(self._path, FILE_MODE)
            self._socket.listen(MOST_CALLERS)
        except OSError as error:
            self._socket.close()
            self.trouble = f"{self._path}: cannot be listened on: {error.strerror}"
            if error.errno not in NO_ROOM:
                raise ControlError(f"{self.trouble}; name another --state") from None
            return
        self._socket.setblocking(False)

    def poll(self, now_ns: int | None = None) -> list[Request]:
        """Return new orders, each to be answered by `answer`; one system call where nobody asks or reads events."""
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        if self.trouble:
            if now_ns < self._again_ns:
                return []
            self._again_ns = now_ns + AGAIN_NS
            with suppress(ControlError):  # another reason now: still a trouble that is shown
                self._listen()
            return []
        self._accept(now_ns)
        requests = []
        for caller in self._callers.copy():
            if now_ns - caller.since_ns > CALLER_LIMIT_NS:
                self._drop(caller, "silent" if not caller.asked else "slow")
            elif caller.unsent is not None:
                self._send(caller)
            elif not caller.asked and (order := self._receive(caller, now_ns)) is not None:
                requests.append(Request(order, caller))
        for stream in self._streams.copy():
            if now_ns >= stream.next_alive_ns:
                stream.next_alive_ns = now_ns + ALIVE_NS
                stream.unsent = stream.unsent or stream.http.alive()
            self._send_on(stream)
        return requests

    def publish(self, event: ServerEvent) -> None:
        """Give an event to whoever reads events; sent by the next `poll`."""
        self._number += 1
        self._events.append((self._number, event))
        for stream in self._streams:
            self._tell(stream, self._number, event)

    def _tell(self, stream: _Stream, number: int, event: ServerEvent) -> None:
        if not stream.takes.takes(event):
            return
        if len(stream.unsent) > MOST_UNSENT_BYTES:
            stream.lost += 1
            self.dropped["event without a reader"] += 1
            return
        if stream.lost:
            text = f"{stream.lost} events were not told: read faster"
            stream.unsent += stream.http.event(number - 1, ServerEvent(LOST, text))
            stream.lost = 0
        stream.unsent += stream.http.event(number, event)

    def publishing(self, say: Callable[[ServerEvent], None]) -> Callable[[ServerEvent], None]:
        """Return what says an event, and publishes it."""

        def both(event: ServerEvent) -> None:
            say(event)
            self.publish(event)

        return both

    def answer(self, request: Request, reply: OrderReply) -> None:
        """Answer an order; a caller that has gone is counted."""
        if isinstance(request.caller, _Caller) and request.caller in self._callers:
            self._answer(request.caller, 200 if reply.ok else 409, reply)
        else:
            self.dropped["nobody waits"] += 1

    def close(self) -> None:
        """Close the socket and remove its file."""
        for caller in self._callers.copy():
            self._end(caller)
        for stream in self._streams.copy():
            self._send_on(stream)
            stream.socket.close()
        self._streams.clear()
        self._socket.close()
        with suppress(OSError):
            os.unlink(self._path)

    def _accept(self, now_ns: int) -> None:
        while len(self._callers) < MOST_CALLERS:
            try:
                connection, _ = self._socket.accept()
            except BlockingIOError:
                return
            except OSError as error:  # out of descriptors, or gone before it was taken
                self.dropped[f"socket: {error.strerror}"] += 1
                return
            connection.setblocking(False)
            self._callers.append(_Caller(connection, now_ns))

    def _receive(self, caller: _Caller, now_ns: int) -> AnyOrder | None:
        try:
            piece = caller.socket.recv(MOST_BODY_BYTES)
        except BlockingIOError:
            return None
        except OSError as error:
            self._drop(caller, f"socket: {error.strerror}")
            return None
        try:
            request = caller.http.receive(piece)
            return None if request is None else self._obey(caller, request, now_ns)
        except RefusedError as error:
            if not piece:
                self._drop(caller, error.reason)
            else:
                self._refuse(caller, error.reason, str(error), error.status)
        except UnknownError as error:
            self._refuse(caller, "unknown", str(error), error.status)
        except (msgspec.DecodeError, UnicodeError, RecursionError, ValueError) as error:
            self._refuse(caller, "malformed", f"that is no order: {error}", 400)
        return None

    def _obey(self, caller: _Caller, request: HttpRequest, now_ns: int) -> AnyOrder | None:
        """Return the order of a request; what needs none is answered here."""
        caller.asked = True
        asked = order_of(*request)
        if isinstance(asked, EventFilter):
            self._begin_stream(caller, asked, now_ns)
        elif not isinstance(asked, Answer):
            return asked
        elif request.target != METRICS:
            self._answer(caller, asked.status, asked.value)
        elif self.metrics_at:
            self._answer(caller, 307, {"ok": True, "text": self.metrics_at}, self.metrics_at)
        else:
            self._answer(caller, 404, OrderReply(False, "this server has no metrics; start it with --metrics PORT"))
        return None

    def _begin_stream(self, caller: _Caller, takes: EventFilter, now_ns: int) -> None:
        if len(self._streams) == MOST_STREAMS:
            text = f"{MOST_STREAMS} programs read events already; end one of them"
            self._answer(caller, 503, OrderReply(False, text))
            return
        self._callers.remove(caller)
        stream = _Stream(caller.socket, caller.http, takes, now_ns + ALIVE_NS, caller.http.begin_stream())
        self._streams.append(stream)
        for number, event in self._events if takes.after >= 0 else ():
            if number > takes.after:
                self._tell(stream, number, event)

    def _refuse(self, caller: _Caller, reason: str, text: str, status: int) -> None:
        self.dropped[reason] += 1
        self._answer(caller, status, OrderReply(False, text))

    def _answer(self, caller: _Caller, status: int, value: object, place: str = "") -> None:
        caller.asked = True
        caller.unsent = caller.http.answer(status, value, place)
        self._send(caller)

    def _send_on(self, stream: _Stream) -> None:
        """Send what waits for a stream's reader; end the stream where the reader is gone."""
        try:
            while stream.unsent:
                stream.unsent = stream.unsent[stream.socket.send(stream.unsent) :]
        except BlockingIOError:
            return
        except OSError:
            self._streams.remove(stream)
            stream.socket.close()

    def _send(self, caller: _Caller) -> None:
        assert caller.unsent is not None
        try:
            caller.unsent = caller.unsent[caller.socket.send(caller.unsent) :]
        except BlockingIOError:
            return
        except OSError:
            self._drop(caller, "nobody waits")
            return
        if not caller.unsent:
            self._end(caller)

    def _drop(self, caller: _Caller, reason: str) -> None:
        self.dropped[reason] += 1
        self._end(caller)

    def _end(self, caller: _Caller) -> None:
        self._callers.remove(caller)
        caller.socket.close()


def ask(folder: StateFolder, order: AskedOrder, limit_s: float = ASK_LIMIT_S) -> OrderReply:
    """Ask the running server, and wait for its answer. Raises NotRunningError, ControlError."""
    until_s = time.monotonic() + limit_s
    with asking(folder, order, until_s, limit_s) as (connection, asker):
        while not asker.ended:
            connection.settimeout(max(until_s - time.monotonic(), 0.001))
            asker.receive(connection.recv(MOST_ANSWER_BYTES))
        return asker.reply()


def events_of(
    folder: StateFolder, takes: EventFilter, until_s: float | None = None
) -> Iterator[tuple[int, ServerEvent]]:
    """Give the events of the running server as they come, each with its number, until it ends. until_s: of the monotonic clock.

    Raises TimeoutError at that time, NotRunningError, ControlError.
    """
    with asking(folder, takes, time.monotonic() + ASK_LIMIT_S, ASK_LIMIT_S, late=TimeoutError) as (connection, asker):
        while not asker.ended:
            connection.settimeout(None if until_s is None else max(until_s - time.monotonic(), 0.001))
            yield from asker.receive(connection.recv(MOST_ANSWER_BYTES))


@contextmanager
def asking(
    folder: StateFolder, asked: AskedOrder | EventFilter, until_s: float, limit_s: float,
    late: type[Exception] | None = None,
) -> Iterator[tuple[socket.socket, HttpAsker]]:  # fmt: skip
    """Send a request, and give the connection that the answer comes on. Raises NotRunningError, ControlError.

    late: is raised where nothing comes in time, in place of a ControlError
    """
    path = _fit_path(folder)
    asker = HttpAsker(asked)
    broken = f"the server with the state in {folder.path} broke off before it answered; look at what it says itself"
    with local_socket(socket.SOCK_STREAM) as connection:
        try:
            _connect(connection, path, until_s)
            connection.sendall(asker.request)
            yield connection, asker
        except (FileNotFoundError, ConnectionRefusedError):
            raise NotRunningError(
                f"no server is running with the state in {folder.path}; start it, or name the right one by --state or --port"
            ) from None
        except TimeoutError:
            if late is not None:
                raise late from None
            raise ControlError(
                f"the server with the state in {folder.path} did not answer within {limit_s:g} s; "
                "if it is stopped or hangs, start it again"
            ) from None
        except (ConnectionResetError, BrokenPipeError, ValueError):
            raise ControlError(broken) from None
        except OSError as error:
            raise ControlError(f"{path}: the server cannot be asked: {error.strerror}; run this as its user") from None


def _connect(connection: socket.socket, path: str, until_s: float) -> None:
    """Connect; wait while the server's queue is full. Raises OSError, TimeoutError among them."""
    connection.settimeout(max(until_s - time.monotonic(), 0.001))
    while True:
        with suppress(BlockingIOError):  # Linux does not wait for a unix socket's full queue
            return connection.connect(path)
        if time.monotonic() >= until_s:
            raise TimeoutError
        time.sleep(_QUEUE_WAIT_S)


def _fit_path(folder: StateFolder) -> str:
    path = os.fspath(folder.control)
    size = len(os.fsencode(path))
    if size > MOST_PATH_BYTES:
        raise ControlError(
            f"{path}: {size} bytes are more than a unix socket's path may have ({MOST_PATH_BYTES}); give a shorter --state"
        )
    return path
