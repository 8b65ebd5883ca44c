"""Link between the front process and one worker: a local socket of whole messages, which never waits.

The front sends what comes of peers that have no path of their own yet; a worker sends what it answers them.
"""

import errno
import os
import socket
from collections import Counter
from collections.abc import Callable, Sequence

import msgspec

from cogrip.machine.server_platform import receive_with_descriptors, send_with_descriptors
from cogrip.protocol.io.dtls_session import SessionKeys
from cogrip.server.administration.orders import AnyOrder, OrderReply
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.events import ServerEvent

MOST_BYTES = 1 << 18  # longest message
BUFFER_BYTES = 1 << 20

PeerAddress = tuple[str | int, ...]


class ToWorker(msgspec.Struct, frozen=True, array_like=True, tag_field="kind"):
    """Message of the front."""


class Assign(ToWorker, frozen=True, tag="assign"):
    """Serve these rooms, and send by the socket that is sent with this.

    fresh: whatever checkpoints there are; revoked, expired: ids of tokens, of all so far; own: the socket is this worker's, and
    peers are steered to it
    """

    rooms: tuple[str, ...]
    fresh: bool
    revoked: tuple[str, ...]
    expired: tuple[str, ...]
    own: bool


class Ask(ToWorker, frozen=True, tag="ask"):
    """A message of a peer that has no path here, or a hello of any.

    verdict: of the authenticator on a hello; arrived_ns: when it came, on the clock of both processes
    shown: id of the token that a ticket came with, see `Authenticator`
    """

    address: PeerAddress
    message: bytes
    verdict: Grant | Denied | None
    arrived_ns: int
    shown: str | None = None


class Path(ToWorker, frozen=True, tag="path"):
    """From now on this peer's datagrams come to this worker. keys: None without encryption.

    steered: to its own socket; else by the one that is sent with this
    """

    address: PeerAddress
    keys: SessionKeys | None
    steered: bool


class Stray(ToWorker, frozen=True, tag="stray"):
    """A datagram of a peer with a path that came to the front before the kernel knew of it, or by another address."""

    address: PeerAddress
    datagram: bytes


class Forget(ToWorker, frozen=True, tag="forget"):
    """This peer's path is over: somebody has made a new DTLS association from its address."""

    address: PeerAddress


class Obey(ToWorker, frozen=True, tag="obey"):
    """An administrator's order."""

    number: int
    order: AnyOrder


class Void(ToWorker, frozen=True, tag="void"):
    """Ids of tokens that were revoked, or have expired, since the last of these."""

    revoked: tuple[str, ...]
    expired: tuple[str, ...]


class Serve(ToWorker, frozen=True, tag="serve"):
    """Prepare the room of this job. number: of the process, among those that had it; address: of this host."""

    job: bytes
    number: int
    address: str


class Begin(ToWorker, frozen=True, tag="begin"):
    """Begin the room, from the newer one of this checkpoint and that of the folder. checkpoint: b"" for none."""

    checkpoint: bytes


class DirectoryContact(ToWorker, frozen=True, tag="directory contact"):
    """Contact with the directory: while it does not answer, the room watches its announcement."""

    answers: bool


class HandOver(ToWorker, frozen=True, tag="hand over"):
    """Leave a checkpoint of this moment, and end without a goodbye: another process goes on with the rooms."""


class EndRooms(ToWorker, frozen=True, tag="end"):
    """Say goodbye to everybody and end."""

    reason: str


class ToFront(msgspec.Struct, frozen=True, array_like=True, tag_field="kind"):
    """Message of a worker."""


class Ready(ToFront, frozen=True, tag="ready"):
    """The rooms that were assigned are served. port, number: of a room of a cluster, which says it again once it has begun."""

    port: int = 0
    number: int = 0


class Say(ToFront, frozen=True, tag="say"):
    """Send this message to a peer that has no path here."""

    address: PeerAddress
    message: bytes


class HelloByPath(ToFront, frozen=True, tag="asked"):
    """A hello came by a path: ask the authenticator."""

    address: PeerAddress
    message: bytes
    arrived_ns: int


class Astray(ToFront, frozen=True, tag="astray"):
    """A datagram of a handshake came by a path."""

    address: PeerAddress
    datagram: bytes


class Released(ToFront, frozen=True, tag="released"):
    """A path is closed: its seat has ended."""

    address: PeerAddress


class SeatGiven(ToFront, frozen=True, tag="admitted"):
    """A seat was given by this grant."""

    grant: Grant


class RevokeToken(ToFront, frozen=True, tag="revoke"):
    """Revoke a token."""

    token: str


class Answered(ToFront, frozen=True, tag="answered"):
    """Answer to an order."""

    number: int
    answer: OrderReply


class RoomOnDemand(ToFront, frozen=True, tag="on demand"):
    """A room of this template is open under this name, or is about to be closed."""

    called: str
    template: str
    is_open: bool


class NewSnapshot(ToFront, frozen=True, tag="measured"):
    """Newest snapshot of the worker, encoded."""

    snapshot: bytes


class Said(ToFront, frozen=True, tag="said"):
    """Line that a room said."""

    line: ServerEvent


class Saved(ToFront, frozen=True, tag="saved"):
    """Checkpoint of a room; b"" where nobody resumes. last: the process has ended with it, and another one goes on."""

    checkpoint: bytes
    last: bool = False


class ProcessEnded(ToFront, frozen=True, tag="ended"):
    """The process ends with this exit code."""

    code: int


AnyToWorker = (
    Assign | Ask | Path | Stray | Forget | Obey | Void | Serve | Begin | DirectoryContact | HandOver | EndRooms
)
AnyToFront = (
    Ready
    | Say
    | HelloByPath
    | Astray
    | Released
    | SeatGiven
    | RevokeToken
    | Answered
    | RoomOnDemand
    | NewSnapshot
    | Said
    | Saved
    | ProcessEnded
)

_encode = msgspec.msgpack.Encoder().encode
_to_worker: Callable[[bytes], AnyToWorker] = msgspec.msgpack.Decoder(AnyToWorker).decode
_to_front: Callable[[bytes], AnyToFront] = msgspec.msgpack.Decoder(AnyToFront).decode


class LinkEndedError(Exception):
    """The other end has gone."""


class ProcessLink:
    """One end. dropped: counts of messages that found no room, by reason."""

    def __init__(self, end: socket.socket) -> None:
        self.socket = end
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self.dropped: Counter[str] = Counter()

    def send(self, message: AnyToWorker | AnyToFront, descriptors: Sequence[int] = ()) -> bool:
        """Send a message and copies of descriptors. False, and counted, where there is no room or nobody."""
        data = _encode(message)
        try:
            if len(data) > MOST_BYTES:  # the other end would get a part of it
                raise OSError(errno.EMSGSIZE, os.strerror(errno.EMSGSIZE))
            if descriptors:
                send_with_descriptors(self.socket, [data], descriptors)
            else:
                self.socket.send(data)
        except OSError as error:  # full, too long, or gone: its end is noticed where the link is read
            self.dropped[f"worker's link: {error.strerror}"] += 1
            return False
        return True

    def take_at_worker(self) -> tuple[AnyToWorker, list[int]]:
        """Return the next message of the front and the descriptors with it. Raises BlockingIOError, LinkEndedError."""
        data, descriptors = self._receive()
        return _to_worker(data), descriptors

    def take_at_front(self) -> AnyToFront:
        """Return the next message of a worker. Raises BlockingIOError, LinkEndedError."""
        return _to_front(self._receive()[0])

    def _receive(self) -> tuple[bytes, list[int]]:
        try:
            data, descriptors, _, _ = receive_with_descriptors(self.socket, MOST_BYTES, 1)
        except ConnectionResetError:
            raise LinkEndedError from None
        if not data:
            raise LinkEndedError
        return data, list(descriptors)

    def close(self) -> None:
        """Close this end."""
        self.socket.close()
