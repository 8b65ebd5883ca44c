"""Records as columns: the one place that knows which columns the records of a topic fill, and how their values are read.

A vector has a column for each axis (`position_m_x`); the fields of a seat stand under its person (`anna.proxy_m_x`); accounts,
which are JSON arrays in the order of the fields of `cogrip.protocol.wire.accounts`, are spread out (`link_up_lost`,
`ticks_late_us_p99`). Values that are null, or missing at the end of an account, are None.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter, itemgetter
from types import NoneType
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import msgspec
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.axes import GRIP_AXES, PLACES
from cogrip.protocol.recording.records import Datagram, Ledger, Poses, Record, Row, SeatStep, Sensors, Step, Tick
from cogrip.protocol.recording.schema import unit_of
from cogrip.protocol.settings.room import seat_axes
from cogrip.protocol.wire.accounts import ClientAccount, LinkCount, RoomAccount, SeatAccount
from cogrip.server.recorder import address_of, start_of

Array = NDArray[Any]
AXES = ("x", "y", "z", "rx", "ry", "rz")  # names of the axes; the last three are a rotation vector
GRIP = "opening"  # name of the axis of a gripper's opening, which stands behind the places where there are four axes
_TURNING = {"m": "rad", "m/s": "rad/s", "N": "N m"}  # units of the axes that turn, by those of the axes that do not
_QUATERNION = ("qw", "qx", "qy", "qz")
_POSE = (*AXES[:PLACES], *_QUATERNION)
NUMBER = "float64"
_TYPES: dict[Any, str] = {int: "int64", bool: "int64", str: "string"}
"""Types of columns by the type of the field; any other is a number that may be missing."""
_PREFIXES = {"device": "device_port_"}  # prefixes by field, without which two columns would be called device_leak_j
_UNEVEN = "not all messages have as many axes or seats as the first"


class Column(NamedTuple):
    """type: as Arrow calls it; unit: as `schema` has it, "" for none."""

    name: str
    type: str
    unit: str = ""


class Field(NamedTuple):
    """A field with its columns, one for each axis of a vector; read: row sources to the values of each column."""

    name: str
    columns: list[Column]
    read: Callable[[Sequence[Any]], Sequence[Sequence[Any]]]

    def array(self, sources: Sequence[Any]) -> Array:
        """Return the values, shape (n,), or (n, axes) for a vector; numbers that are null or not finite are nan."""
        found = [_array(column.type, values) for column, values in zip(self.columns, self.read(sources), strict=True)]
        return found[0] if self.columns[0].name == self.name else np.stack(found, axis=1)


def _array(kind: str, values: Sequence[Any]) -> Array:
    if kind == "string" or (kind != NUMBER and None not in values):
        return np.array(values)
    numbers = np.array(values, dtype=float)
    numbers[~np.isfinite(numbers)] = np.nan
    return numbers


Times = Sequence[float]
Rows = tuple[Times, Sequence[Any]]  # time of each row, and the record that its fields are read from


class TopicLayout(NamedTuple):
    """The fields of one topic's records; rows: times and records to rows, mostly the same."""

    fields: list[Field]
    rows: Callable[[Times, Sequence[Any]], Rows] = lambda times, records: (times, records)

    @property
    def columns(self) -> list[Column]:
        """All columns in their order, `time_s` first."""
        return [Column("time_s", NUMBER, "s"), *(column for field in self.fields for column in field.columns)]

    def table(self, times: Times, records: Sequence[Record]) -> list[Sequence[Any]]:
        """Return the values of each of `columns`. Raises ValueError, LookupError or TypeError for other records."""
        times, sources = self.rows(times, records)
        return [times, *(values for field in self.fields for values in field.read(sources))]

    def arrays(self, times: Times, records: Sequence[Record], names: Sequence[str] = ()) -> dict[str, Array]:
        """Return fields as arrays with `time_s`; all fields if none is named. Raises KeyError for an unknown name."""
        times, sources = self.rows(times, records)
        known = {field.name: field for field in self.fields}
        for name in names:
            if name not in known:
                raise KeyError(f"there is no field {name!r}; there is: {', '.join(known)}")
        return {"time_s": np.array(times), **{name: known[name].array(sources) for name in names or known}}


def layout_of(first: Record, start: str = "{}", *, numbered: bool = False) -> TopicLayout:
    """Return the layout of the records of one topic by the first of them.

    start: that of the recording's header. numbered: seats stand under their number, not their person.
    """
    if isinstance(first, Tick):
        return TopicLayout(_fields(Tick, len(first.force_n)), lambda times, ticks: (times, list(map(_as_read, ticks))))
    if isinstance(first, Step):
        return _step_layout(first, numbered)
    if isinstance(first, Poses):
        return TopicLayout([_scalar("step", int, attrgetter("step")), _poses(len(first.poses) // len(_POSE))])
    if isinstance(first, Sensors):
        return TopicLayout([_scalar("step", int, attrgetter("step")), _sensors(first.names, len(first.sensors))])
    if isinstance(first, Ledger):
        return _account_layout(first.account, start)
    if isinstance(first, Datagram):
        address = _scalar("address", str, lambda datagram: _endpoint(datagram.address))
        return TopicLayout([address, _scalar("data_hex", str, lambda datagram: datagram.data.hex())])
    return TopicLayout(_fields(type(first), 0))


def _fields(record: type[Record], axes: int, prefix: str = "", of: Callable[[Any], Any] | None = None) -> list[Field]:
    """Return the numbers, texts and vectors of a record, which is `of` a row source, or that itself."""
    found = []
    for field in msgspec.structs.fields(record):
        get: Callable[[Any], Any] = attrgetter(field.name)
        if of is not None:
            get = _chain(of, get)
        if field.name in ("unfit", "seats"):
            continue
        if field.name == "orientation":
            found.append(_vector(field.name, len(_QUATERNION), get, prefix, _QUATERNION))
        elif field.type == tuple[int, ...]:
            found.append(_scalar(field.name, str, _chain(get, lambda values: " ".join(map(str, values))), prefix))
        elif field.type in (Row, Row | None):
            found.append(_vector(field.name, axes, get, prefix))
        elif field.name == "ticks":
            found += _account_fields(TickCount, 0, lambda one, get=get: json.loads(get(one) or "null"), "ticks_")  # type: ignore[misc]
        else:
            found.append(_scalar(field.name, field.type, get, prefix))
    return found


def _chain(of: Callable[[Any], Any], get: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda source: get(of(source))


def _scalar(name: str, hint: Any, get: Callable[[Any], Any], prefix: str = "") -> Field:
    """Return the field of a number, a flag (as 0 or 1) or a text."""
    plain = _plain(hint)
    column = Column(f"{prefix}{name}", _TYPES.get(plain, NUMBER), unit_of(name))
    if plain is bool:
        return Field(column.name, [column], lambda sources: [[_flag(get(one)) for one in sources]])
    return Field(column.name, [column], lambda sources: [list(map(get, sources))])


def _flag(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


def axes_named(axes: int, unit: str, turning: Mapping[str, str]) -> tuple[Sequence[str], Sequence[str]]:
    """Return names and units of so many axes. turning: unit of a place to that of the same of an axis that turns."""
    if axes == GRIP_AXES:
        return (*AXES[:PLACES], GRIP), [unit] * axes
    return AXES[:axes], [unit] * PLACES + [turning.get(unit, unit)] * (axes - PLACES)


def _vector(name: str, axes: int, get: Callable[[Any], Any], prefix: str = "", parts: Sequence[str] = ()) -> Field:
    missing = (None,) * axes

    def read(sources: Sequence[Any]) -> list[Sequence[Any]]:
        rows = [missing if value is None else value for value in map(get, sources)]
        if any(len(row) != axes for row in rows):
            raise ValueError(_UNEVEN)
        return list(zip(*rows, strict=True))

    name, unit = f"{prefix}{name}", unit_of(name)
    names, units = axes_named(axes, unit, _TURNING)
    columns = [Column(f"{name}_{axis}", NUMBER, unit) for axis, unit in zip(parts or names, units, strict=False)]
    return Field(name, columns, read)


def _poses(bodies: int) -> Field:
    """Return the poses of a scene's bodies: `poses_0_x` ... of the first."""
    columns = [
        Column(f"poses_{body}_{name}", NUMBER, "m" if name in AXES[:PLACES] else "")
        for body in range(bodies)
        for name in _POSE
    ]

    def read(sources: Sequence[Poses]) -> list[Sequence[Any]]:
        if any(len(each.poses) != len(columns) for each in sources):
            raise ValueError(_UNEVEN)
        return list(zip(*[each.poses for each in sources], strict=True))

    return Field("poses", columns, read)


def _sensors(names: Sequence[str], count: int) -> Field:
    """Return the values of a scene's sensors under their names; under numbers where a cut recording has none."""
    columns = [
        Column(f"sensors_{name}", NUMBER, "") for name in (names if len(names) == count else map(str, range(count)))
    ]

    def read(sources: Sequence[Sensors]) -> list[Sequence[Any]]:
        if any(len(each.sensors) != len(columns) for each in sources):
            raise ValueError(_UNEVEN)
        return list(zip(*[each.sensors for each in sources], strict=True))

    return Field("sensors", columns, read)


def _plain(hint: Any) -> Any:
    """Return a type without its bounds and without None."""
    if get_origin(hint) is Annotated:
        return _plain(get_args(hint)[0])
    args = get_args(hint)
    return _plain(next(each for each in args if each is not NoneType)) if NoneType in args else hint


def _step_layout(first: Step, numbered: bool) -> TopicLayout:
    axes, seats = len(first.object_m), len(first.seats)
    fields = _fields(Step, axes)
    for number, seat in enumerate(first.seats):
        prefix = f"{number if numbered else seat.user}."
        of_seat = _fields(SeatStep, axes, prefix, _chain(attrgetter("seats"), itemgetter(number)))
        fields += [field for field in of_seat if field.name != f"{prefix}user"]

    def rows(times: Times, steps: Sequence[Step]) -> Rows:
        if any(len(step.seats) != seats for step in steps):
            raise ValueError(_UNEVEN)
        return times, steps

    return TopicLayout(fields, rows)


def _as_read(tick: Tick) -> Tick:
    """Return a tick with the sample's numbers that are not finite, which JSON keeps as text, in their places."""
    if tick.unfit is None:
        return tick
    position, velocity = tick.unfit
    return msgspec.structs.replace(
        tick, position_m=tuple(map(float, position)), given_mps=tuple(map(float, velocity)) if velocity else None
    )


def _endpoint(text: str) -> str | None:
    """Return a datagram's address as one types it; a client's has none."""
    if not text:
        return None
    address = address_of(text)
    if not isinstance(address, tuple) or len(address) < 2:
        return str(address)
    host, port = str(address[0]), address[1]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _account_fields(kind: type[msgspec.Struct], axes: int, of: Callable[[Any], Any], prefix: str = "") -> list[Field]:
    """Return the fields of an account; of: the JSON array of a row source, which may be short or None."""
    found = []
    for place, field in enumerate(msgspec.structs.fields(kind)):
        hint, get = _plain(field.type), _chain(of, _item(place))
        if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
            link = "link_" if hint is LinkCount else ""
            found += _account_fields(hint, axes, get, f"{prefix}{link}{_PREFIXES.get(field.name, f'{field.name}_')}")
        elif get_origin(hint) is tuple:
            padded = _chain(get, lambda value: [*(value or ()), *[None] * axes][:axes])
            found.append(_vector(field.name, axes, padded, prefix))
        else:
            found.append(_scalar(field.name, field.type, get, prefix))
    return found


def _item(place: int) -> Callable[[Any], Any]:
    def item(value: Any) -> Any:
        there = value or ()
        return there[place] if place < len(there) else None

    return item


def _account_layout(account: str, start: str) -> TopicLayout:
    """A client's account is one row, a server's a row for each seat of the room."""
    table = json.loads(account)
    if isinstance(table, dict):
        return _server_layout(start)
    client = _account_fields(ClientAccount, len(table[0]), lambda account: account)
    return TopicLayout(client, lambda times, ledgers: (times, [json.loads(ledger.account) for ledger in ledgers]))


def _server_layout(start: str) -> TopicLayout:
    try:
        rooms = {room.name: room for room in start_of(start)[0]}
    except (KeyError, ValueError):  # it can be read all the same
        rooms = {}
    axes = max((seat_axes(room, user) for room in rooms.values() for user in room.users), default=len(AXES))
    fields = [_scalar(name, str, itemgetter(name)) for name in ("room", "user")]
    fields += _account_fields(SeatAccount, axes, itemgetter("seat"))
    for name in ("limited", "room_dropped"):
        fields.append(_scalar(name, int, _chain(itemgetter(name), lambda counts: add_integers(counts.values()))))
        fields.append(_scalar(f"{name}_reasons", str, _chain(itemgetter(name), _reasons)))
    fields += _account_fields(RoomAccount, axes, itemgetter("account"), "room_")

    def rows(times: Times, ledgers: Sequence[Ledger]) -> Rows:
        found = []
        for time_s, ledger in zip(times, ledgers, strict=True):
            table = json.loads(ledger.account)
            users = [user.name for user in rooms[table["room"]].users] if table["room"] in rooms else []
            for place, seat in enumerate(table["seats"]):
                user = users[place] if place < len(users) else str(place)
                row = {"room": table["room"], "user": user, "seat": seat, "limited": table["limited"][place]}
                found.append((time_s, {**row, "room_dropped": table.get("dropped", {}), "account": table["account"]}))
        return [time_s for time_s, _ in found], [row for _, row in found]

    return TopicLayout(fields, rows)


def _reasons(counts: Mapping[str, int]) -> str:
    return "; ".join(f"{reason} {count}" for reason, count in counts.items())
