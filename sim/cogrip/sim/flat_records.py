"""Records of a recording as rows of a table, a number a column.

A vector `position_m` becomes `position_m.0`, `position_m.1` ...; a seat's numbers stand under its person
(`anna.proxy_m.0`). What a record does not tell is None.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec

from cogrip.protocol.recording.records import Datagram, Record, SeatStep, Step, Tick
from cogrip.protocol.recording.records import Row as Vector
from cogrip.server.recorded import address_of

Row = list[Any]
NUMBER = "float64"
_TYPES: dict[Any, str] = {int: "int64", bool: "int64", str: "string"}  # all else is a number that may be missing


class Column(NamedTuple):
    """type: as Arrow calls it."""

    name: str
    type: str


class Shape(NamedTuple):
    """Columns, and what gives a record's values in their order."""

    columns: list[Column]
    values: Callable[[Any], Row]


def shape_of(first: Record) -> Shape:
    """How records like this one, the first of its topic, become rows."""
    if isinstance(first, Tick):
        shape = _fields_shape(Tick, len(first.force_n))
        return Shape(shape.columns, lambda tick: shape.values(_as_read(tick) if tick.unfit else tick))
    if isinstance(first, Step):
        return _step_shape(first)
    if isinstance(first, Datagram):
        return Shape(
            [Column("address", "string"), Column("data_hex", "string")],
            lambda datagram: [_host_port(datagram.address), datagram.data.hex()],
        )
    return _fields_shape(type(first), 0)


def _fields_shape(record: type[Record], axes: int) -> Shape:
    """Of the numbers, words and vectors of a record; the fields that are neither are left out."""
    columns: list[Column] = []
    plan: list[tuple[str, bool]] = []
    for field in msgspec.structs.fields(record):
        vector = field.type in (Vector, Vector | None)
        if field.name in ("unfit", "seats"):
            continue
        plan.append((field.name, vector))
        if vector:
            columns += [Column(f"{field.name}.{axis}", NUMBER) for axis in range(axes)]
        else:
            columns.append(Column(field.name, _TYPES.get(field.type, NUMBER)))
    missing = (None,) * axes

    def values(one: Record) -> Row:
        row: Row = []
        for name, vector in plan:
            value = getattr(one, name)
            if vector:
                row += missing if value is None else value
            else:
                row.append(value)
        return row

    return Shape(columns, values)


def _step_shape(first: Step) -> Shape:
    axes = len(first.object_m)
    room, seat = _fields_shape(Step, axes), _fields_shape(SeatStep, axes)
    columns = room.columns + [
        Column(f"{each.user}.{name}", kind) for each in first.seats for name, kind in seat.columns if name != "user"
    ]

    def values(step: Step) -> Row:
        row = room.values(step)
        for each in step.seats:
            _, seated, *others = seat.values(each)
            row += (int(seated), *others)
        return row

    return Shape(columns, values)


def _as_read(tick: Tick) -> Tick:
    """With the sample's numbers that are not finite, which JSON keeps as words, in their places."""
    assert tick.unfit is not None
    position, velocity = tick.unfit
    return msgspec.structs.replace(
        tick, position_m=tuple(map(float, position)), given_mps=tuple(map(float, velocity)) if velocity else None
    )


def _host_port(text: str) -> str | None:
    """A datagram's address as one types it; a client's has none."""
    if not text:
        return None
    address = address_of(text)
    if not isinstance(address, tuple) or len(address) < 2:
        return str(address)
    host, port = str(address[0]), address[1]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
