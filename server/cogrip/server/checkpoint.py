"""State of a room that the next server goes on from: where things are, and seats with the hash of their tickets.

Lines and springs are not kept: a hand that resumes joins anew, with the proxy on the object (theory section 3.7), so that
nothing that was lost can push it.
"""

import msgspec

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.settings.hand import UNSET, HandChange
from cogrip.protocol.settings.settable import RoomChange
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.server.ports.seat_limits import ClaimedRecord

VERSION = 1


class SeatCheckpoint(msgspec.Struct, frozen=True):
    """One seat. ticket: hash of the session ticket, never the ticket; tool, line: told last, None for those of the settings."""

    user: str
    session: int
    nonce: int
    ticket: str
    token: str
    record: ClaimedRecord | None
    tool: ToolFrame | None = None
    line: HandChange = UNSET


class RoomCheckpoint(msgspec.Struct, frozen=True):
    """One room. scene: digest of its scene of rigid bodies, coordinates: of all of them; both empty where it has none.

    progress: measures of its contacts and its task so far (`World.progress`); empty where it has none
    changes: what was set of it since it began
    called, labels: of a room on demand that is open
    """

    version: int
    room: str
    digest: str
    position_m: tuple[float, ...]
    travel_m: float
    steps: int
    seats: tuple[SeatCheckpoint, ...]
    scene: str = ""
    coordinates: tuple[float, ...] = ()
    progress: tuple[float, ...] = ()
    changes: RoomChange = RoomChange()
    called: str = ""
    labels: dict[str, str] = {}


class CheckpointError(ForeignFileError, ValueError):
    """Not a checkpoint of this room. The text says why."""


encode = msgspec.json.Encoder().encode


def decode(data: bytes) -> RoomCheckpoint:
    """Read a checkpoint. Raises CheckpointError."""
    try:
        checkpoint = msgspec.json.decode(data, type=RoomCheckpoint)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise CheckpointError(f"it cannot be read: {error}") from None
    if checkpoint.version != VERSION:
        raise CheckpointError(f"it is of version {checkpoint.version}, this is {VERSION}")
    return checkpoint
