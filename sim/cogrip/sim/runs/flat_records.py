"""Records of a recording as rows of a table, a number a column.

A vector `position_m` becomes `position_m_x`, `position_m_y` ...; a seat's numbers stand under its person
(`anna.proxy_m_x`); how a loop ran, which is JSON text in a record, is spread out (`ticks_late_us_p99`). What a record does
not tell is None.
"""

import json

import msgspec

from cogrip.protocol.accounts import TickCount
from cogrip.protocol.recording.records import Datagram, Ledger, Record, SeatStep, Step, Tick
from cogrip.protocol.recording.records import Row as Vector
from cogrip.server.recorder import address_of
from cogrip.sim.runs.flat_accounts import Column, Flat, Row, Shape, account_shape, axes_of, column_of

_TICKS = Flat(TickCount, 0, "ticks_")


def shape_of(first: Record, start: str = "{}") -> Shape:
    """How records like this one, the first of its topic, become rows. start: that of the recording's header."""
    if isinstance(first, Tick):
        shape = _Fields(Tick, len(first.force_n))
        return Shape(shape.columns, lambda tick: [shape.values(_as_read(tick) if tick.unfit else tick)])
    if isinstance(first, Step):
        return _step_shape(first)
    if isinstance(first, Ledger):
        return account_shape(first.account, start)
    if isinstance(first, Datagram):
        return Shape(
            [Column("address", "string"), Column("data_hex", "string")],
            lambda datagram: [[_host_port(datagram.address), datagram.data.hex()]],
        )
    shape = _Fields(type(first), 0)
    return Shape(shape.columns, lambda record: [shape.values(record)])


class _Fields:
    """Of the numbers, words and vectors of a record; the fields that are neither are left out."""

    def __init__(self, record: type[Record], axes: int) -> None:
        self.columns: list[Column] = []
        self._plan: list[tuple[str, str]] = []
        self._missing = (None,) * axes
        for field in msgspec.structs.fields(record):
            if field.name in ("unfit", "seats"):
                continue
            if field.type in (Vector, Vector | None):
                self._plan.append((field.name, "vector"))
                self.columns += axes_of(field.name, axes)
            elif field.name == "ticks":
                self._plan.append((field.name, "ticks"))
                self.columns += _TICKS.columns
            else:
                self._plan.append((field.name, ""))
                self.columns.append(column_of(field.name, field.type))

    def values(self, one: Record) -> Row:
        row: Row = []
        for name, kind in self._plan:
            value = getattr(one, name)
            if not kind:
                row.append(value)
            elif kind == "vector":
                row += self._missing if value is None else value
            else:
                row += _TICKS.values(json.loads(value) if value else None)
        return row


def _step_shape(first: Step) -> Shape:
    axes = len(first.object_m)
    room, seat = _Fields(Step, axes), _Fields(SeatStep, axes)
    columns = room.columns + [
        Column(f"{each.user}.{name}", kind) for each in first.seats for name, kind in seat.columns if name != "user"
    ]

    def rows(step: Step) -> list[Row]:
        row = room.values(step)
        for each in step.seats:
            _, seated, *others = seat.values(each)
            row += (int(seated), *others)
        return [row]

    return Shape(columns, rows)


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
