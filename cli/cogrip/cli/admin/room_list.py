"""`cogrip room list`: the rooms of a running server."""

from typing import Annotated

import msgspec
from cyclopts import Parameter

from cogrip.cli.admin.room_labels import labels_of
from cogrip.cli.admin.state_folder import Port, State, answer_of
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.tables import Fitted, columns_table
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import RoomEntry, StatusOrder

_HEADINGS = ("room", "template", "seated", "observers", "labels", "changed")


def room_list(
    *, label: Annotated[tuple[str, ...], Parameter(negative="")] = (), state: State = None, port: Port = DEFAULT_PORT,
    json: Json = None,
) -> int:  # fmt: skip
    """List the rooms of a running server.

    Parameters
    ----------
    label
        KEY=VALUE: only rooms with this label; repeatable.
    """
    wanted = labels_of(label, "room list")
    answer, _ = answer_of("room list", StatusOrder(), state, port)
    rooms = [room for room in answer.rooms if wanted.items() <= dict(room.labels).items()]
    if json is not None:
        write_json({"rooms": msgspec.to_builtins(rooms), "said": answer.text}, json)
        return 0
    console = make_console(soft_wrap=True)
    if not rooms:
        console.print("no room has these labels" if label else "no room is open")
        return 0
    rows = [dict(zip(_HEADINGS, _cells(room), strict=True)) for room in rooms]
    console.print(
        Fitted(
            lambda: [columns_table(_HEADINGS, rows)],
            lambda: [columns_table(_HEADINGS[:4], rows), columns_table(("room", *_HEADINGS[4:]), rows)],
        )
    )
    return 0


def _cells(room: RoomEntry) -> tuple[str, ...]:
    labels = " ".join([f"{shown(key)}={shown(value)}" for key, value in room.labels.items()])
    seated = f"{room.seated} of {room.seats}"
    return room.name, room.template or "-", seated, f"{room.observers}", labels or "-", room.changed or "-"
