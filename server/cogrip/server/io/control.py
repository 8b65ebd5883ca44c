"""Control of a running server by commands: one JSON line each way over a unix socket in its state folder.

The folder's mode decides who may ask. The server's half never waits: it is polled between two ticks.
"""

import errno
import os
import socket
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol

import msgspec

from cogrip.machine.server_platform import local_socket
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.settable import RoomChange
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.io.state_folder import FILE_MODE, StateError, StateFolder

MOST_REQUEST_BYTES = 4096
MOST_ANSWER_BYTES = 65536
MOST_CALLERS = 8  # most callers at once; further ones wait in the socket's queue
CALLER_LIMIT_NS = 5_000_000_000
ASK_LIMIT_S = 5.0
_QUEUE_WAIT_S = 0.01
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)  # error numbers of a folder that may take files again
AGAIN_NS = 5_000_000_000
MOST_PATH_BYTES = 103  # longest path of a unix socket on every system: 107 bytes on Linux, 103 on macOS

MOST_WORD, MOST_REASON = 40, 200  # most characters of a word, and of a reason
Word = Annotated[str, msgspec.Meta(max_length=MOST_WORD)]
Words = Annotated[str, msgspec.Meta(max_length=MOST_REASON)]


class ControlError(StateError):
    """The server could not be asked, or did not answer. The text says why and what to do."""


class NotRunningError(ControlError):
    """There is no server."""


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="verb"):
    """Order to a server."""


class KickOrder(Order, frozen=True, tag="kick"):
    """End the sessions of this name."""

    user: Word
    room: Word = ""  # name of the room; "" whichever
    reason: Words = ""
    revoke: bool = False  # void their token too


class MarkOrder(Order, frozen=True, tag="mark"):
    """Set a marker."""

    text: Words
    room: Word = ""  # name of the room; "" every room


class SetHandOrder(Order, frozen=True, tag="set"):
    """Change somebody's hand settings."""

    user: Word
    change: HandChange
    room: Word = ""  # name of the room; "" whichever


class SetRoomOrder(Order, frozen=True, tag="set_room"):
    """Change a room's settings."""

    change: RoomChange
    room: Word = ""  # name of the room; "" where the server has one alone


class ReloadOrder(Order, frozen=True, tag="reload"):
    """Read the tokens again."""


class StatusOrder(Order, frozen=True, tag="status"):
    """Return uptime and rooms."""


class WhoOrder(Order, frozen=True, tag="who"):
    """Return the roster."""

    room: Word = ""  # name of the room; "" every room


class DrainOrder(Order, frozen=True, tag="drain"):
    """Let the rooms of a host of the cluster move to others."""

    host: Words


class OrderReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Answer to an order."""

    ok: bool
    text: str
    people: tuple[RosterEntry, ...] = ()


NO_CLUSTER = "this server is no part of a cluster (serve --cluster): it has one host, which cannot be drained"
AnyOrder = KickOrder | MarkOrder | SetHandOrder | SetRoomOrder | ReloadOrder | StatusOrder | WhoOrder | DrainOrder


@dataclass(slots=True, eq=False)
class _Caller:
    """unsent: rest of the answer; None: no answer yet."""

    socket: socket.socket
    since_ns: int
    received: bytes = b""
    asked: bool = False
    unsent: bytes | None = None


class Request(NamedTuple):
    """Order that waits for its answer. caller: as whoever takes orders knows the one who asks."""

    order: AnyOrder
    caller: object


class Orders(Protocol):
    """Source of orders. poll: new ones; answer: answers one."""

    def poll(self, now_ns: int | None = None) -> list[Request]: ...

    def answer(self, request: Request, text: str, *, ok: bool = True, people: Sequence[RosterEntry] = ()) -> None: ...

    def close(self) -> None: ...


class Control:
    """Server's half, for the holder of the folder (`one_server`). Raises ControlError.

    dropped  counts by reason
    trouble  why nobody can ask, as the folder has no room for the socket; tried again every few seconds. "" where one can
    """

    def __init__(self, folder: StateFolder) -> None:
        self.dropped: Counter[str] = Counter()
        self.trouble = ""
        self._path = _fit_path(folder)
        self._callers: list[_Caller] = []
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
        """Return new orders, each to be answered by `answer`; one system call where nobody asks."""
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
            elif not caller.asked and (order := self._receive(caller)) is not None:
                requests.append(Request(order, caller))
        return requests

    def answer(self, request: Request, text: str, *, ok: bool = True, people: Sequence[RosterEntry] = ()) -> None:
        """Answer an order; a caller that has gone is counted."""
        if isinstance(request.caller, _Caller) and request.caller in self._callers:
            self._answer(request.caller, OrderReply(ok, text, tuple(people)))
        else:
            self.dropped["nobody waits"] += 1

    def close(self) -> None:
        """Close the socket and remove its file."""
        for caller in self._callers.copy():
            self._end(caller)
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

    def _receive(self, caller: _Caller) -> AnyOrder | None:
        try:
            piece = caller.socket.recv(MOST_REQUEST_BYTES + 1 - len(caller.received))
        except BlockingIOError:
            return None
        except OSError as error:
            self._drop(caller, f"socket: {error.strerror}")
            return None
        caller.received += piece
        line, end, rest = caller.received.partition(b"\n")
        if len(line) >= MOST_REQUEST_BYTES:
            self._refuse(caller, "too long", f"an order may have {MOST_REQUEST_BYTES} bytes")
            return None
        if not end:
            if not piece:
                self._drop(caller, "cut short")
            return None
        try:
            if rest:
                raise msgspec.DecodeError("more than one line")
            order: AnyOrder = msgspec.json.decode(line, type=AnyOrder)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            self._refuse(caller, "malformed", f"that is no order: {error}")
            return None
        caller.asked = True
        return order

    def _refuse(self, caller: _Caller, reason: str, text: str) -> None:
        self.dropped[reason] += 1
        self._answer(caller, OrderReply(False, text))

    def _answer(self, caller: _Caller, answer: OrderReply) -> None:
        line = msgspec.json.encode(answer) + b"\n"
        if len(line) > MOST_ANSWER_BYTES:
            line = msgspec.json.encode(OrderReply(False, f"the answer would have {len(line)} bytes, too many")) + b"\n"
        caller.unsent = line
        self._send(caller)

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


def ask(folder: StateFolder, order: AnyOrder, limit_s: float = ASK_LIMIT_S) -> OrderReply:
    """Ask the running server, and wait for its answer. Raises NotRunningError, ControlError."""
    path = _fit_path(folder)
    received = bytearray()
    until_s = time.monotonic() + limit_s
    with local_socket(socket.SOCK_STREAM) as connection:
        try:
            _connect(connection, path, until_s)
            connection.sendall(msgspec.json.encode(order) + b"\n")
            while not received.endswith(b"\n") and len(received) <= MOST_ANSWER_BYTES:
                connection.settimeout(max(until_s - time.monotonic(), 0.001))
                if not (piece := connection.recv(MOST_ANSWER_BYTES)):
                    break
                received += piece
        except (FileNotFoundError, ConnectionRefusedError):
            raise NotRunningError(
                f"no server is running with the state in {folder.path}; start it, or name the right one by --state or --port"
            ) from None
        except TimeoutError:
            raise ControlError(
                f"the server with the state in {folder.path} did not answer within {limit_s:g} s; "
                "if it is stopped or hangs, start it again"
            ) from None
        except (ConnectionResetError, BrokenPipeError):
            received.clear()
        except OSError as error:
            raise ControlError(f"{path}: the server cannot be asked: {error.strerror}; run this as its user") from None
    try:
        return msgspec.json.decode(received, type=OrderReply)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise ControlError(
            f"the server with the state in {folder.path} broke off before it answered; look at what it says itself"
        ) from None


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
