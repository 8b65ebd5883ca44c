"""What a server has to know again after it died: where the object was, and whose the seats are. No line, no spring:
a hand that comes back joins anew, with the proxy on the object (theory 3.7), so nothing that was lost can push it."""

import msgspec

from cogrip.server.seat_limits import Record

VERSION = 1


class SeatCheckpoint(msgspec.Struct, frozen=True):
    """`ticket` is the mark of the ticket, never the ticket."""

    user: str
    session: int
    nonce: int
    ticket: str
    token: str
    record: Record | None


class RoomCheckpoint(msgspec.Struct, frozen=True):
    version: int
    room: str
    digest: str
    position_m: tuple[float, ...]
    travel_m: float
    steps: int
    seats: tuple[SeatCheckpoint, ...]


class CheckpointError(ValueError):
    """Not a checkpoint of this room. The text says why."""


def encode(checkpoint: RoomCheckpoint) -> bytes:
    return msgspec.json.encode(checkpoint)


def decode(data: bytes) -> RoomCheckpoint:
    """Raises CheckpointError."""
    try:
        checkpoint = msgspec.json.decode(data, type=RoomCheckpoint)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise CheckpointError(f"it cannot be read: {error}") from None
    if checkpoint.version != VERSION:
        raise CheckpointError(f"it is of version {checkpoint.version}, this is {VERSION}")
    return checkpoint
