"""State of a live server at one moment, made between two ticks and read in another process; and its health."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import msgspec

from cogrip.machine.addition import add_integers
from cogrip.machine.histogram import DurationHistogram
from cogrip.protocol.wire.accounts import LinkCount

if TYPE_CHECKING:  # the reader needs no room, and none of numpy
    from cogrip.server.room import Room

FRESH_NS = 2_000_000_000  # age from which on a snapshot, or a room without a tick, is unhealthy
REFRESHED_ROOMS = 4
"""Most rooms of a snapshot with new percentiles, which cost 50 us a room: with more rooms they take turns."""
LENGTH_BYTES = 4  # bytes of the length, big-endian, before each snapshot in a pipe

Number = float | None  # a number; None: not finite, or not known


class Times(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """Durations since the start [s]: exact sum and maximum, percentiles to 1/32; None while there are none."""

    sum_s: float = 0.0
    p50_s: Number = None
    p99_s: Number = None
    max_s: Number = None


class SeatSnapshot(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """One seat; of a free one the counts of its last session. frames: from the person to the object."""

    user: str
    seated: bool
    frames: LinkCount = LinkCount()
    rtt_s: Number = None
    up_margin_j: Number = None
    line_margin_j: Number = None
    limited: dict[str, int] = {}  # number of limitations, by reason
    up_delay_s: Number = None  # newest one-way delay, as far as the clocks' offset is known
    down_delay_s: Number = None
    clock_offset_s: Number = None  # what the person's clock shows beyond the server's
    rendered_npm: Number = None
    up_reserve_j: Number = None  # energy reserve of the uplink, now
    line_reserve_j: Number = None


class RoomSnapshot(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """One room."""

    room: str
    seated: int
    seats: tuple[SeatSnapshot, ...]
    position_m: tuple[Number, ...]
    travel_m: Number
    ticks_run: int = 0
    ticks_skipped: int = 0
    late: Times = Times()
    work: Times = Times()
    observers: int = 0
    least_up_margin_j: Number = None  # least margin of all seat sessions since the start
    least_line_margin_j: Number = None
    unstable: str = ""  # reason why the room is unstable, where it is
    left: tuple[str, ...] = ()  # names of what left the workspace, while the object is outside

    @property
    def ticks_due(self) -> int:
        """Ticks run or skipped."""
        return self.ticks_run + self.ticks_skipped


class Snapshot(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """The whole server."""

    software: str
    uptime_s: float
    rooms: tuple[RoomSnapshot, ...]
    dropped: dict[str, int] = {}  # number of dropped datagrams, by reason
    received: int | None = None  # number of datagrams at the socket, where they are counted
    sent: int | None = None
    failed: dict[str, int] = {}  # number of things that were not written, or not taken, by name
    degraded: dict[str, str] = {}  # what cannot be written now, and why: the server goes on without it


encode = msgspec.json.Encoder().encode
decode = msgspec.json.Decoder(Snapshot).decode


class Ticks(Protocol):
    """Tick counts of a room's loop: a `Pacer`."""

    run: int
    skipped: int
    lateness: DurationHistogram
    work: DurationHistogram


class SnapshotMaker:
    """Makes snapshots of some rooms, without any call that would be recorded.

    ticks: of each room, by its name.
    """

    def __init__(self, rooms: "Sequence[Room]", ticks: Mapping[str, Ticks], software: str) -> None:
        self._rooms = rooms
        self._ticks = ticks
        self._software = software
        self._times = {room.name: (Times(), Times()) for room in rooms}
        self._least: dict[str, tuple[Number, Number]] = {room.name: (None, None) for room in rooms}
        self._called: dict[str, str] = {}  # what each room was called in the last snapshot
        self._next = 0
        self._deserted: dict[str, tuple[int, RoomSnapshot]] = {}  # the last of a room, and its step then

    def make(
        self, uptime_s: float, *dropped: Mapping[str, int], datagrams: tuple[int, int] | None = None,
        failed: Mapping[str, int] | None = None, degraded: Mapping[str, str] | None = None,
    ) -> Snapshot:  # fmt: skip
        """Return a snapshot.

        dropped: counts by reason, of core and channel; the same reason is summed.
        datagrams: (received, sent) at the socket.
        failed, degraded: see `Snapshot`.
        """
        self._refresh()
        counts: Counter[str] = Counter()
        for some in dropped:
            counts.update(some)
        there = [room for room in self._rooms if room.is_open]
        for room in there:
            if self._called.get(room.name) != room.called:  # a room on demand that was opened since
                self._called[room.name], self._least[room.name] = room.called, (None, None)
                self._deserted.pop(room.name, None)
        rooms = tuple([self._resting(room) if room.deserted else self._room(room) for room in there])
        received, sent = datagrams or (None, None)
        return Snapshot(
            self._software, uptime_s, rooms, dict(counts), received, sent, dict(failed or {}), dict(degraded or {})
        )

    def _refresh(self) -> None:
        for _ in range(min(REFRESHED_ROOMS, len(self._rooms))):
            name = self._rooms[self._next].name
            ticks = self._ticks[name]
            self._times[name] = times(ticks.lateness), times(ticks.work)
            self._next = (self._next + 1) % len(self._rooms)

    def _resting(self, room: "Room") -> RoomSnapshot:
        """Return a snapshot of a deserted room: of the last one only the ticks have changed, unless it was stepped since."""
        step, last = self._deserted.get(room.name, (-1, None))
        if last is None or step != room.steps:
            last = self._room(room)
            self._deserted[room.name] = room.steps, last
        ticks, (late, work) = self._ticks[room.name], self._times[room.name]
        return msgspec.structs.replace(last, ticks_run=ticks.run, ticks_skipped=ticks.skipped, late=late, work=work)

    def _room(self, room: "Room") -> RoomSnapshot:
        name, ticks = room.name, self._ticks[room.name]
        late, work = self._times[name]
        seats = [_seat(room, number) for number in range(len(room.seats))]
        up_j, line_j = self._least[name]
        for seat in seats:
            up_j, line_j = _lesser(up_j, seat.up_margin_j), _lesser(line_j, seat.line_margin_j)
        self._least[name] = up_j, line_j
        there = room.left if room.world.left_workspace else ()  # it may have been put back
        left = tuple([body.what for body in there])
        occupied = add_integers(seat.seated for seat in seats)
        return RoomSnapshot(
            room.called, occupied, tuple(seats), room.world.motion()[: room.world.axes], room.travel_m,
            ticks.run, ticks.skipped, late, work, len(room.observer_slots.observers), up_j, line_j,
            room.unstable, left,
        )  # fmt: skip


def times(histogram: DurationHistogram) -> Times:
    """Return sum, percentiles and maximum of a histogram [s]."""
    if not histogram.total_ns and not histogram.count:
        return Times()
    return Times(
        histogram.total_ns * 1e-9,
        histogram.percentile(50) * 1e-9,
        histogram.percentile(99) * 1e-9,
        histogram.max_ns * 1e-9,
    )


def _seat(room: "Room", number: int) -> SeatSnapshot:
    seat, limited = room.seats[number], room.limited(number)
    port, last = seat.port, seat.last
    if port is not None:
        clock, stiffness = seat.clock, room.world.accounts.stiffness(number) if seat.on_object else None
        return SeatSnapshot(
            seat.name, True, port.count(), _seconds(seat.rtt_ns), port.up_margin_j, seat.line_margin_j, limited,
            _seconds(clock.return_ns), _seconds(clock.forward_ns), _seconds(clock.offset_ns), stiffness,
            port.up_reserve.now_j, seat.line_reserve.now_j,
        )  # fmt: skip
    if last is not None:
        return SeatSnapshot(seat.name, False, last.up, None, last.up_margin_j, last.line_margin_j, limited)
    return SeatSnapshot(seat.name, False, limited=limited)


def _seconds(value_ns: int | None) -> Number:
    return None if value_ns is None else value_ns * 1e-9


def _lesser(one: Number, other: Number) -> Number:
    if one is None or other is None:
        return other if one is None else one
    return min(one, other)


class Health:
    """Health of a server by its snapshots. A room that is unstable is its people's affair: the server stays healthy."""

    def __init__(self) -> None:
        self.newest: Snapshot | None = None
        self._came_ns = 0
        self._moved: dict[str, tuple[int, float]] = {}  # room -> ticks run, and the uptime when they had last grown

    def take(self, snapshot: Snapshot, now_ns: int) -> None:
        """Take in a new snapshot."""
        self.newest, self._came_ns = snapshot, now_ns
        names = {room.room for room in snapshot.rooms}  # one that nobody knows of for a while begins anew
        self._moved = {room: moved for room, moved in self._moved.items() if room in names}
        for room in snapshot.rooms:
            if room.ticks_run != self._moved.get(room.room, (-1, 0.0))[0]:
                self._moved[room.room] = room.ticks_run, snapshot.uptime_s

    def age_ns(self, now_ns: int) -> int:
        """Return the time since the newest snapshot."""
        return now_ns - self._came_ns

    def trouble(self, now_ns: int) -> str:
        """Return why the server is unhealthy, "" if it is healthy, or degraded alone."""
        if self.newest is None:
            return "the server has said nothing yet"
        if self.age_ns(now_ns) >= FRESH_NS:
            return f"the server has said nothing for {self.age_ns(now_ns) * 1e-9:.1f} s: its loop stands, or is held up"
        for room in self.newest.rooms:
            still_s = self.newest.uptime_s - self._moved[room.room][1]
            if still_s * 1e9 >= FRESH_NS:
                return f"room {room.room}: no tick for {still_s:.1f} s"
        return ""

    def degraded(self) -> str:
        """Return what cannot be written, "" for nothing."""
        return ", ".join(sorted(self.newest.degraded)) if self.newest is not None else ""
