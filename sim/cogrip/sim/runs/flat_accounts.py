"""Accounts at the end of a recording as rows of a table: a client's is one row, a server's one row for each seat.

A nested field is joined by `_`, a vector has a column for each axis: `link_up_lost`, `ticks_late_us_p99`, `proxy_m_x`.
Accounts stand in a recording as JSON arrays in the order of the fields of `cogrip.protocol.accounts`; null, or missing at
the end of one of an earlier cogrip, is an empty cell.
"""

import json
from collections.abc import Callable, Mapping
from types import NoneType
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import msgspec

from cogrip.protocol.accounts import ClientAccount, LinkCount, RoomAccount, SeatAccount
from cogrip.server.recorder import start_of

AXES = "xyz"
Row = list[Any]
NUMBER = "float64"
_TYPES: dict[Any, str] = {int: "int64", bool: "int64", str: "string"}  # all else is a number that may be missing
_PREFIXES = {"device": "device_port_"}  # else two columns would be called device_leak_j


class Column(NamedTuple):
    """type: as Arrow calls it."""

    name: str
    type: str


class Shape(NamedTuple):
    """Columns, and what gives the rows of a record, mostly one, with the values in their order."""

    columns: list[Column]
    rows: Callable[[Any], list[Row]]


def column_of(name: str, hint: Any) -> Column:
    """The column of a number, a flag or a text."""
    return Column(name, _TYPES.get(_plain(hint), NUMBER))


def axes_of(name: str, axes: int) -> list[Column]:
    """The columns of a vector."""
    return [Column(f"{name}_{axis}", NUMBER) for axis in AXES[:axes]]


def _plain(hint: Any) -> Any:
    """A type without its bounds and without None."""
    if get_origin(hint) is Annotated:
        return _plain(get_args(hint)[0])
    args = get_args(hint)
    return _plain(next(each for each in args if each is not NoneType)) if NoneType in args else hint


class Flat:
    """Columns of an account of one type, and its values from its JSON array."""

    def __init__(self, kind: type[msgspec.Struct], axes: int, prefix: str = "") -> None:
        self.columns: list[Column] = []
        self._parts: list[Callable[[Any], Row]] = []
        for field in msgspec.structs.fields(kind):
            hint, name = _plain(field.type), f"{prefix}{field.name}"
            if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
                link = "link_" if hint is LinkCount else ""
                inner = Flat(hint, axes, f"{prefix}{link}{_PREFIXES.get(field.name, f'{field.name}_')}")
                self.columns += inner.columns
                self._parts.append(inner.values)
            elif get_origin(hint) is tuple:
                self.columns += axes_of(name, axes)
                self._parts.append(lambda value: [*(value or ()), *[None] * axes][:axes])
            else:
                self.columns.append(column_of(name, field.type))
                self._parts.append(lambda value: [int(value) if isinstance(value, bool) else value])

    def values(self, value: Any) -> Row:
        """Values in the order of the columns; `value` may be shorter than the type, or None."""
        there = value or ()
        return [
            one for place, part in enumerate(self._parts) for one in part(there[place] if place < len(there) else None)
        ]


def account_shape(account: str, start: str) -> Shape:
    """How accounts like this one become rows. start: what the recording's core was made from, as JSON text."""
    table = json.loads(account)
    return _server_shape(start) if isinstance(table, dict) else _client_shape(len(table[0]))


def _client_shape(axes: int) -> Shape:
    flat = Flat(ClientAccount, axes)
    return Shape(flat.columns, lambda ledger: [flat.values(json.loads(ledger.account))])


def _server_shape(start: str) -> Shape:
    try:
        rooms = {room.name: room for room in start_of(start)[0]}
    except (KeyError, ValueError):  # it can be read all the same
        rooms = {}
    axes = max((room.object.axes for room in rooms.values()), default=len(AXES))
    seat, room = Flat(SeatAccount, axes), Flat(RoomAccount, axes, "room_")
    names = [Column("room", "string"), Column("user", "string")]
    counts = [Column(f"{what}{each}", kind) for what in ("limited", "room_dropped")
              for each, kind in (("", "int64"), ("_reasons", "string"))]  # fmt: skip

    def rows(ledger: Any) -> list[Row]:
        table = json.loads(ledger.account)
        users = [user.name for user in rooms[table["room"]].users] if table["room"] in rooms else []
        of_room, dropped = room.values(table["account"]), _counted(table.get("dropped", {}))
        return [
            [table["room"], users[place] if place < len(users) else str(place), *seat.values(each),
             *_counted(table["limited"][place]), *dropped, *of_room]
            for place, each in enumerate(table["seats"])
        ]  # fmt: skip

    return Shape([*names, *seat.columns, *counts, *room.columns], rows)


def _counted(counts: Mapping[str, int]) -> Row:
    """The sum, and each reason with its count."""
    return [sum(counts.values()), "; ".join(f"{reason} {count}" for reason, count in counts.items())]
