"""Inputs of a server core as values, each a tagged struct: `ServerCore.handle` takes it, a recording holds it as JSON text,
replay feeds it back. Datagrams and steps have entries of their own, `ServerCore.receive` and `ServerCore.tick`.
"""

from typing import Annotated

import msgspec

from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.settable import RoomChange
from cogrip.server.checkpoint import RoomCheckpoint


class Stop(msgspec.Struct, frozen=True, tag_field="kind", tag="stop"):
    """End every seat and observer slot; the clients' accounts may still come (`ServerCore.awaits_accounts`)."""

    reason: str


class Restart(msgspec.Struct, frozen=True, tag_field="kind", tag="restart"):
    """Tell everybody that the server restarts, and for how long to wait for it: the seats are the next server's."""

    wait_ms: int


class SocketFailed(msgspec.Struct, frozen=True, tag_field="kind", tag="socket_failed"):
    """Count one refusal of the socket to send or receive as a drop."""

    reason: str


class Kick(msgspec.Struct, frozen=True, tag_field="kind", tag="kick"):
    """End the seats and observer slots of this name. room: "" for any."""

    user: str
    room: str = ""
    reason: str = ""


class Revoke(msgspec.Struct, frozen=True, tag_field="kind", tag="revoke"):
    """End what was taken with one of these tokens. tokens: public ids, sorted."""

    tokens: tuple[str, ...]


class Expire(msgspec.Struct, frozen=True, tag_field="kind", tag="expire"):
    """Void the session tickets that were given for these tokens, which have expired. tokens: public ids, sorted."""

    tokens: tuple[str, ...]


class UnbindAddress(msgspec.Struct, frozen=True, tag_field="kind", tag="unbind_address"):
    """Release an address where another DTLS association speaks now: its holder keeps the seat and has to resume."""

    address: str | tuple[str | int, ...]


class Restore(msgspec.Struct, frozen=True, tag_field="kind", tag="restore"):
    """Continue a room from the state of the server before; given before anybody joins."""

    checkpoint: RoomCheckpoint


class Idle(msgspec.Struct, frozen=True, tag_field="kind", tag="idle"):
    """Step a room where nobody holds the object, so often: a recording holds steps of a deserted room as one input."""

    room: str
    steps: Annotated[int, msgspec.Meta(ge=1)]


class Mark(msgspec.Struct, frozen=True, tag_field="kind", tag="mark"):
    """Set a marker. room: "" for every room."""

    text: str
    room: str = ""


class SetHand(msgspec.Struct, frozen=True, tag_field="kind", tag="set_hand"):
    """Change hand settings of the seats of this name. room: "" for any."""

    user: str
    change: HandChange
    room: str = ""


class SetRoom(msgspec.Struct, frozen=True, tag_field="kind", tag="set_room"):
    """Change settings of a room. room: "" for every one that can have the change."""

    change: RoomChange
    room: str = ""


class SpareRooms(msgspec.Struct, frozen=True, tag_field="kind", tag="spare_rooms"):
    """Keep these rooms closed, as spare ones of a template; given before anybody joins."""

    template: str
    rooms: tuple[str, ...]


class OpenRoom(msgspec.Struct, frozen=True, tag_field="kind", tag="open_room"):
    """Open a spare room under a name of its own, its object at its start."""

    room: str
    called: str
    labels: dict[str, str] = {}


class CloseRoom(msgspec.Struct, frozen=True, tag_field="kind", tag="close_room"):
    """End all sessions of an open room, which is a spare one again."""

    room: str
    reason: str


class TriggerWritten(msgspec.Struct, frozen=True, tag_field="kind", tag="trigger_written"):
    """A marker reached the trigger line as this code, so long after it was asked for, and so long before this input."""

    marker: str
    code: int
    after_ns: int
    ago_ns: int


class CloseLedger(msgspec.Struct, frozen=True, tag_field="kind", tag="close_ledger"):
    """End the session: a recorder writes the accounts of all rooms and seats."""


ServerInput = (
    Stop
    | Restart
    | SocketFailed
    | Kick
    | Revoke
    | Expire
    | UnbindAddress
    | Restore
    | Idle
    | Mark
    | SetHand
    | SetRoom
    | SpareRooms
    | OpenRoom
    | CloseRoom
    | TriggerWritten
    | CloseLedger
)

decode = msgspec.json.Decoder(ServerInput).decode
"""Read an input from a recording. Raises msgspec.DecodeError (a ValueError)."""
