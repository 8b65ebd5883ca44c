"""Orders to a running server, and its answer: what an administrator's command, program or experiment asks of it."""

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple, Protocol

import msgspec

from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.settable import RoomChange
from cogrip.server.admission.roster import RosterEntry

MOST_WORD, MOST_REASON = 40, 200  # most characters of a word, and of a reason
Word = Annotated[str, msgspec.Meta(max_length=MOST_WORD)]
Words = Annotated[str, msgspec.Meta(max_length=MOST_REASON)]


Labels = Annotated[dict[Word, Word], msgspec.Meta(max_length=8)]


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
    """Change somebody's settings."""

    user: Word
    change: HandChange
    room: Word = ""  # name of the room; "" whichever


class SetRoomOrder(Order, frozen=True, tag="set_room"):
    """Change a room's settings."""

    change: RoomChange
    room: Word = ""  # name of the room; "" where the server has one alone


class NewRoomOrder(Order, frozen=True, tag="new_room"):
    """Open a spare room of a template."""

    template: Word
    name: Word = ""  # "" draws one
    labels: Labels = {}


class CloseRoomOrder(Order, frozen=True, tag="close_room"):
    """Close a room that was opened on demand; whoever is in it is sent out."""

    room: Word


class ReloadOrder(Order, frozen=True, tag="reload"):
    """Read the tokens again."""


class StatusOrder(Order, frozen=True, tag="status"):
    """Return uptime, rooms, and what cannot be written now."""


class WhoOrder(Order, frozen=True, tag="who"):
    """Return the roster."""

    room: Word = ""  # name of the room; "" every room


class DrainOrder(Order, frozen=True, tag="drain"):
    """Let the rooms of a host of the cluster move to others."""

    host: Words


AnyOrder = (
    KickOrder | MarkOrder | SetHandOrder | SetRoomOrder | NewRoomOrder | CloseRoomOrder | ReloadOrder | StatusOrder
    | WhoOrder | DrainOrder
)  # fmt: skip
NO_CLUSTER = "this server is no part of a cluster (serve --cluster): it has one host, which cannot be drained"


class RoomEntry(msgspec.Struct, frozen=True):
    """One room of a running server. What moves in it is as of its newest step."""

    name: str
    seats: int
    seated: int
    observers: int
    steps: int
    position_m: tuple[float, ...]  # place of the object
    speed_mps: float  # speed of the object's places
    changed: str = ""  # what was set of it since it began
    template: str = ""  # of a room on demand
    labels: Mapping[str, str] = {}


class OrderReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Answer to an order.

    degraded: what cannot be written now, and why, of `StatusOrder`
    """

    ok: bool
    text: str
    people: tuple[RosterEntry, ...] = ()
    rooms: tuple[RoomEntry, ...] = ()
    degraded: Mapping[str, str] = {}


class Request(NamedTuple):
    """Order that waits for its answer. caller: as whoever takes orders knows the one who asks."""

    order: AnyOrder
    caller: object


class Orders(Protocol):
    """Source of orders. poll: new ones; answer: answers one."""

    def poll(self, now_ns: int | None = None) -> Sequence[Request]: ...

    def answer(self, request: Request, reply: OrderReply) -> None: ...

    def close(self) -> None: ...
