"""Prometheus families of a snapshot: base units, `_total` for what only grows (docs/operations.md)."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric, SummaryMetricFamily

from cogrip.server.snapshot import Number, RoomSnapshot, SeatSnapshot, Snapshot, Times

R = TypeVar("R")
Table = tuple[tuple[str, str, Callable[[R], Number]], ...]
Labelled = Iterable[tuple[list[str], R]]

NAN = float("nan")
DEFECT = "below 0 by more than the energy credit is a defect"

ROOM_GAUGES: Table[RoomSnapshot] = (
    ("seats", "Seats of the room.", lambda room: len(room.seats)),
    ("users_seated", "Seats taken.", lambda room: room.seated),
    ("observers", "Observers.", lambda room: room.observers),
    ("unstable", "1 once numbers of the world were not finite or grew, else 0.", lambda room: float(bool(room.unstable))),
    ("object_left", "1 while the object is outside of the workspace, else 0.", lambda room: float(bool(room.left))),
    ("tick_lateness_max_seconds", "The latest tick since the start.", lambda room: room.late.max_s),
    ("tick_work_max_seconds", "The longest tick since the start.", lambda room: room.work.max_s),
    ("least_up_margin_joules", f"Least energy margin of all forward lines since the start: {DEFECT}.",
     lambda room: room.least_up_margin_j),
    ("least_line_margin_joules", f"Least energy margin of all lines, both ways: {DEFECT}.",
     lambda room: room.least_line_margin_j),
)  # fmt: skip
ROOM_COUNTERS: Table[RoomSnapshot] = (
    ("ticks_due", "Ticks that were due: run or skipped.", lambda room: room.ticks_due),
    ("ticks_run", "Ticks that were run.", lambda room: room.ticks_run),
    ("ticks_skipped", "Ticks more than a period late, left out.", lambda room: room.ticks_skipped),
    ("object_travel_meters", "How far the object was moved.", lambda room: finite(room.travel_m)),
)
SEAT_GAUGES: Table[SeatSnapshot] = (
    ("seat_taken", "1 where a seat is taken, else 0.", lambda seat: float(seat.seated)),
    ("rtt_seconds", "Round trip, as last seen.", lambda seat: seat.rtt_s),
    ("up_delay_seconds", "One way to the server, as last seen, by the clocks' offset.", lambda seat: seat.up_delay_s),
    ("down_delay_seconds", "One way to the person, as last seen, by the clocks' offset.", lambda seat: seat.down_delay_s),
    ("clock_offset_seconds", "What the person's clock shows beyond the server's.", lambda seat: seat.clock_offset_s),
    ("rendered_newtons_per_meter", "The stiffness that is integrated for the seat.", lambda seat: seat.rendered_npm),
    ("up_margin_joules", "Least energy margin of the forward line of this seat session.", lambda seat: seat.up_margin_j),
    ("line_margin_joules", "Least energy margin of the line of this seat session.", lambda seat: seat.line_margin_j),
    ("up_reserve_joules", "Energy reserve of the forward line now: put in less taken out.", lambda seat: seat.up_reserve_j),
    ("line_reserve_joules", "Energy reserve of the line, both ways, now.", lambda seat: seat.line_reserve_j),
)  # fmt: skip
FRAME_COUNTERS: Table[SeatSnapshot] = (
    ("frames_sent", "Frames whose time has come: applied, late or lost.", lambda seat: seat.frames.sent),
    ("frames_received", "Frames received, each once.", lambda seat: seat.frames.received),
    ("frames_applied", "Frames applied in time.", lambda seat: seat.frames.applied),
    ("frames_lost", "Frames that never came.", lambda seat: seat.frames.lost),
    ("frames_late", "Frames that came after their time.", lambda seat: seat.frames.late),
    ("frames_duplicate", "Datagrams that came again.", lambda seat: seat.frames.duplicate),
)


def families(snapshot: Snapshot) -> Iterator[Metric]:
    """Return the families of a snapshot. What is not known has no sample; what is not finite is NaN."""
    yield InfoMetricFamily("cogrip_build", "What runs.", value={"version": snapshot.software})
    yield GaugeMetricFamily("cogrip_uptime_seconds", "Since the rooms began.", value=snapshot.uptime_s)
    reasons = [([reason], count) for reason, count in snapshot.dropped.items()]
    yield _counter("dropped", "Datagrams dropped, by reason.", ["reason"], reasons)
    failures = [([what], count) for what, count in snapshot.failed.items()]
    yield _counter("failures", "What was not written or not taken, by name.", ["what"], failures)
    degraded = GaugeMetricFamily("cogrip_degraded", "1 for each part that cannot be written now.", labels=["what"])
    for what in snapshot.degraded:
        degraded.add_metric([what], 1.0)
    yield degraded
    both = {"in": snapshot.received, "out": snapshot.sent}
    directions = [([direction], count) for direction, count in both.items() if count is not None]
    yield _counter("datagrams", "Datagrams at the socket.", ["direction"], directions)

    rooms = [([room.room], room) for room in snapshot.rooms]
    yield from _table(GaugeMetricFamily, ROOM_GAUGES, ["room"], rooms)
    yield from _table(CounterMetricFamily, ROOM_COUNTERS, ["room"], rooms)
    yield _position(snapshot.rooms)
    late = "How late ticks began, since the start."
    yield _times("tick_lateness_seconds", late, snapshot.rooms, lambda room: room.late)
    yield _times("tick_work_seconds", "How long ticks took, since the start.", snapshot.rooms, lambda room: room.work)

    seats = [([room.room, seat.user], seat) for room in snapshot.rooms for seat in room.seats]
    yield from _table(GaugeMetricFamily, SEAT_GAUGES, ["room", "user"], seats)
    up = [([*labels, "up"], seat) for labels, seat in seats]
    yield from _table(CounterMetricFamily, FRAME_COUNTERS, ["room", "user", "direction"], up)
    limited = [([*labels, reason], count) for labels, seat in seats for reason, count in seat.limited.items()]
    yield _counter("limited", "What a seat asked beyond its limits.", ["room", "user", "reason"], limited)


def finite(value: Number) -> float:
    """Return NaN for what is not finite, as JSON holds it."""
    return NAN if value is None else value


def _table(
    kind: type[GaugeMetricFamily | CounterMetricFamily], table: Table[R], labels: list[str], rows: Labelled[R]
) -> Iterator[Metric]:
    for name, text, value_of in table:
        family = kind(f"cogrip_{name}", text, labels=labels)
        for values, row in rows:
            value = value_of(row)
            if value is not None:
                family.add_metric(values, value)
        yield family


def _counter(name: str, text: str, labels: list[str], counts: Labelled[int]) -> Metric:
    family = CounterMetricFamily(f"cogrip_{name}", text, labels=labels)
    for values, count in counts:
        family.add_metric(values, count)
    return family


def _position(rooms: Iterable[RoomSnapshot]) -> Metric:
    family = GaugeMetricFamily("cogrip_object_position_meters", "Where the object is.", labels=["room", "axis"])
    for room in rooms:
        for axis, position in zip("xyz", room.position_m, strict=False):
            family.add_metric([room.room, axis], finite(position))
    return family


def _times(name: str, text: str, rooms: Iterable[RoomSnapshot], times_of: Callable[[RoomSnapshot], Times]) -> Metric:
    family = SummaryMetricFamily(f"cogrip_{name}", text, labels=["room"])
    for room in rooms:
        times = times_of(room)
        for quantile, value in (("0.5", times.p50_s), ("0.99", times.p99_s)):
            if value is not None:
                family.add_sample(family.name, {"room": room.room, "quantile": quantile}, value)
        family.add_metric([room.room], room.ticks_run, times.sum_s)
    return family
