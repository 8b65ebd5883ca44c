"""Connection between a front and the process that speaks with Ray for it: whole messages of any size.

Ray ends a process whose cluster has gone, and has threads of its own: so a front has it in a process beside it.
"""

import socket
import struct
from collections.abc import Callable

import msgspec

from cogrip.server.administration.orders import AnyOrder
from cogrip.server.hosting.cluster.directory import ClusterState

SIZE = struct.Struct("<I")


class Ordered(msgspec.Struct, frozen=True, array_like=True, tag="ordered"):
    """Order for a room, at the actor that has it."""

    number: int
    actor: str
    room: str
    order: AnyOrder


class DrainHost(msgspec.Struct, frozen=True, array_like=True, tag="drain"):
    """Let the rooms of a host move."""

    host: str


class LeaveCluster(msgspec.Struct, frozen=True, array_like=True, tag="leave"):
    """Leave the cluster; the last front ends the rooms."""

    reason: str


class DirectoryState(msgspec.Struct, frozen=True, array_like=True, tag="state"):
    """Newest answer of the directory."""

    told: ClusterState


class Silent(msgspec.Struct, frozen=True, array_like=True, tag="silent"):
    """The directory has not answered."""


class Failed(msgspec.Struct, frozen=True, array_like=True, tag="failed"):
    """The cluster cannot be used. text: why, and what to do."""

    text: str


class OrderAnswer(msgspec.Struct, frozen=True, array_like=True, tag="answer"):
    """Answer to an order, of a room or to drain."""

    number: int
    ok: bool
    answer: bytes


class Left(msgspec.Struct, frozen=True, array_like=True, tag="left"):
    """The cluster is left. code: worst exit code of the rooms that have ended with this front."""

    code: int


ToRay = Ordered | DrainHost | LeaveCluster
FromRay = DirectoryState | Silent | Failed | OrderAnswer | Left
encode = msgspec.msgpack.Encoder().encode
to_ray: Callable[[bytes], ToRay] = msgspec.msgpack.Decoder(ToRay).decode
from_ray: Callable[[bytes], FromRay] = msgspec.msgpack.Decoder(FromRay).decode


class PipeEndedError(Exception):
    """The other end has gone."""


def put(end: socket.socket, message: msgspec.Struct) -> None:
    """Send a message; wait while the other end does not read. Raises PipeEndedError."""
    data = encode(message)
    try:
        end.sendall(SIZE.pack(len(data)) + data)
    except OSError:
        raise PipeEndedError from None


def take(end: socket.socket) -> bytes:
    """Wait for a message. Raises PipeEndedError."""
    return _read(end, SIZE.unpack(_read(end, SIZE.size))[0])


def _read(end: socket.socket, size: int) -> bytes:
    data = bytearray()
    while len(data) < size:
        try:
            piece = end.recv(size - len(data))
        except OSError:
            raise PipeEndedError from None
        if not piece:
            raise PipeEndedError
        data += piece
    return bytes(data)
