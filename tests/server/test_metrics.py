"""Metrics: snapshots of a room, the verdict on them, and the text that Prometheus reads."""

from math import inf, isnan, nan
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families

from cogrip.machine.histogram import DurationHistogram
from cogrip.machine.pacing import Pacer
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.accounts import LinkCount
from cogrip.protocol.wire.messages import Stamp, Waves
from cogrip.server.io.metrics_families import families
from cogrip.server.ports.seat_limits import Record
from cogrip.server.room import Room
from cogrip.server.snapshot import (
    FRESH_NS,
    REFRESHED_ROOMS,
    Health,
    RoomSnapshot,
    SeatSnapshot,
    Snapshot,
    SnapshotMaker,
    Times,
    decode,
    encode,
    times,
)

from tests.server.recorded_rooms import scripted

FRAME_NS = 7_812_500
PHANTOM = Record("sim:phantom", 1, 1024.0, 10.0, 2.0)


def a_room(name: str = "lab", people: tuple[str, ...] = ("anna", "ben")) -> Room:
    return Room(resolve({"name": name, "users": [{"name": person} for person in people]}))


def waves(frame: int, value: float = 0.1) -> Waves:
    """Frame `frame` alone, with a true energy ledger."""
    made_j = (frame + 1) * value * value * FRAME_NS * 0.5e-9
    return Waves(1, frame, (value,), (frame * value,), (frame * value * value,), made_j, 0.0, 0, Stamp(1), (0.0, 0.0))


def hold(room: Room, frames: range, number: int = 0) -> None:
    """One person sends frames and the room ticks."""
    for frame in frames:
        port = room.seats[number].port
        assert port is not None
        assert port.receive(waves(frame), 0)
        room.tick(frame * FRAME_NS)


def take_seat(room: Room, number: int = 0) -> None:
    room.take_seat(number, 1, 1, 0, PHANTOM)


def maker(*rooms: Room) -> SnapshotMaker:
    return SnapshotMaker(rooms, {room.name: Pacer(128, 0) for room in rooms}, "1.2.3")


def test_a_snapshot_says_what_the_room_knows():
    room, pacer = a_room(), Pacer(128, 0)
    take_seat(room)
    hold(room, range(20))
    seat = room.seats[0]
    assert seat.port.receive(waves(19), 0), "a duplicate"
    seat.rtt_ns = 41_000_000
    seat.clock.read(Stamp(5_010_000_000, 1_000_000_000, 0), 1_040_000_000)  # 40 ms and back, 3.99 s ahead
    for tick in (0, 1, 5):
        pacer.take(pacer.due_ns(tick) + 300_000)
    snapshot = SnapshotMaker([room], {"lab": pacer}, "1.2.3").make(
        2.5, {"malformed": 3, "rate": 1}, {"malformed": 4}, datagrams=(7, 8)
    )
    (seen,) = snapshot.rooms
    anna, ben = seen.seats
    assert (snapshot.software, snapshot.uptime_s) == ("1.2.3", 2.5)
    assert snapshot.dropped == {"malformed": 7, "rate": 1}
    assert (snapshot.received, snapshot.sent) == (7, 8)
    assert (seen.room, seen.seated, seen.observers, seen.unstable, seen.left) == ("lab", 1, 0, "", ())
    assert (seen.ticks_due, seen.ticks_run, seen.ticks_skipped) == (6, 3, 3)
    assert seen.position_m == tuple(room.world.position.tolist()) != (0.0,)
    assert seen.travel_m == room.travel_m > 0.0
    assert anna.seated
    assert anna.frames == seat.port.count()
    assert (anna.frames.sent, anna.frames.applied, anna.frames.duplicate) == (20, 20, 1)
    assert anna.rtt_s == pytest.approx(0.041)
    assert (anna.up_delay_s, anna.down_delay_s, anna.clock_offset_s) == pytest.approx((0.02, 0.02, 3.99))
    assert anna.rendered_npm == room.world.accounts.stiffness(0) > 0.0
    assert (ben.up_delay_s, ben.down_delay_s, ben.clock_offset_s, ben.rendered_npm) == (None, None, None, None)
    assert anna.up_margin_j == seat.port.up_margin_j
    assert (anna.up_reserve_j, anna.line_reserve_j) == (seat.port.up_reserve.now_j, seat.line_reserve.now_j)
    assert None not in (anna.up_reserve_j, anna.line_reserve_j)
    assert (ben.user, ben.seated, ben.frames, ben.rtt_s, ben.up_margin_j) == ("ben", False, LinkCount(), None, None)


def test_tick_times_are_in_seconds_and_skips_are_counted():
    values_ns = np.random.default_rng(7).lognormal(11, 1, 2000).astype(int).tolist()
    histogram = DurationHistogram()
    for value_ns in values_ns:
        histogram.add(value_ns)
    found = times(histogram)
    assert found.sum_s == pytest.approx(sum(values_ns) * 1e-9)
    assert found.max_s == pytest.approx(max(values_ns) * 1e-9)
    for q, value_s in ((50, found.p50_s), (99, found.p99_s)):
        assert value_s == pytest.approx(np.percentile(values_ns, q, method="inverted_cdf") * 1e-9, rel=1 / 32)
    assert times(DurationHistogram()) == Times()
    late_by_nothing = DurationHistogram()
    late_by_nothing.add(0)
    assert times(late_by_nothing) == Times(0.0, 0.0, 0.0, 0.0), "not the same as no tick"


def test_least_margins_stay_when_the_seat_is_left_and_taken_again():
    room = a_room()
    make = maker(room).make
    take_seat(room)
    room.seats[0].line_margin_j = -0.25
    assert make(0.5).rooms[0].least_line_margin_j == -0.25
    room.leave_seat(0, "leave")
    left = make(1.0).rooms[0]
    assert (left.seated, left.least_line_margin_j, left.seats[0].line_margin_j) == (0, -0.25, -0.25)
    take_seat(room)
    again = make(1.5).rooms[0]
    assert (again.least_line_margin_j, again.seats[0].line_margin_j) == (-0.25, 0.0)


@pytest.mark.parametrize("count", [1, REFRESHED_ROOMS, REFRESHED_ROOMS + 1, 3 * REFRESHED_ROOMS - 1])
def test_every_room_gets_new_percentiles_in_turn(count):
    rooms = [a_room(f"r{number}", ("anna",)) for number in range(count)]
    pacers = {room.name: Pacer(128, 0) for room in rooms}
    make = SnapshotMaker(rooms, pacers, "1").make
    make(0.0)
    for pacer in pacers.values():
        pacer.take(1_000_000)
    needed = -(-count // REFRESHED_ROOMS)
    seen = [make(number * 0.5) for number in range(needed)]
    assert all(room.late.max_s == pytest.approx(1e-3) for room in seen[-1].rooms)
    assert len([room for room in seen[0].rooms if room.late.max_s]) == min(count, REFRESHED_ROOMS)


def test_a_snapshot_is_not_recorded():
    """A replay would be asked for what nobody had asked."""
    core = scripted().core
    puts: list[object] = []
    core.record(SimpleNamespace(put=lambda *message: puts.append(message)))
    make = maker(*core.rooms).make
    assert make(1.0, core.dropped) == make(1.0, core.dropped)
    assert puts == []
    core.rooms[0].account()
    assert puts, "as an account is"


def test_what_is_not_finite_is_said_as_such():
    room = a_room()
    take_seat(room)
    room.world.position = np.array([nan])
    room.travel_m = inf
    room.unstable = "place and velocity of the object are not finite"
    back = decode(encode(maker(room).make(1.0)))
    assert back.rooms[0].position_m == (None,)
    assert back.rooms[0].travel_m is None
    samples = scraped(back)
    assert isnan(samples["cogrip_object_position_meters"][0].value)
    assert isnan(samples["cogrip_object_travel_meters_total"][0].value)
    assert samples["cogrip_unstable"][0].value == 1.0


# how well it is ------------------------------------------------------------------------------------------------------


def state(
    uptime_s: float = 1.0,
    ticks: int = 128,
    unstable: str = "",
    left: tuple[str, ...] = (),
    rooms: tuple[str, ...] = ("lab",),
) -> Snapshot:
    each = [RoomSnapshot(name, 0, (), (0.0,), 0.0, ticks, unstable=unstable, left=left) for name in rooms]
    return Snapshot("1.2.3", uptime_s, tuple(each))


def test_a_snapshot_is_good_for_two_seconds_also_of_a_room_whose_people_took_the_object_away():
    health = Health()
    assert health.trouble(0) == "the server has said nothing yet"
    health.take(state(left=("the object",)), 10**9)
    assert health.trouble(10**9 + FRESH_NS - 1) == ""
    assert "has said nothing for 2.0 s" in health.trouble(10**9 + FRESH_NS)


def test_a_room_that_nobody_knows_of_is_degraded_and_not_one_that_stands():
    """As behind a cluster's front without its directory: people play on, and the ticks that were told last are old."""
    health, silent = Health(), Snapshot("1.2.3", 9.0, (), degraded={"directory": "it is silent"})
    health.take(state(1.0, 128), 0)
    for uptime_s in (2.5, 60.0):
        health.take(msgspec.structs.replace(silent, uptime_s=uptime_s), 1)
        assert (health.trouble(1), health.degraded()) == ("", "directory")
    health.take(state(60.5, 128), 2)  # an old word: it begins anew
    assert (health.trouble(2), health.degraded()) == ("", "")
    health.take(state(62.5, 128), 3)
    assert health.trouble(3) == "room lab: no tick for 2.0 s"


def test_a_room_without_a_tick_for_two_seconds_is_not_well():
    health = Health()
    for now, (uptime_s, ticks, trouble) in enumerate(
        [(1.0, 128, ""), (2.5, 128, ""), (3.0, 128, "room lab: no tick for 2.0 s"), (3.5, 129, "")]
    ):
        health.take(state(uptime_s, ticks, rooms=("lab", "hall")), now)
        assert health.trouble(now) == trouble


# what is written -----------------------------------------------------------------------------------------------------


def scraped(snapshot: Snapshot) -> dict:
    return samples_in(generate_latest(SimpleNamespace(collect=lambda: families(snapshot))).decode())


def samples_in(text: str) -> dict:
    """Samples by name, as Prometheus' own reader finds them."""
    found: dict = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, []).append(sample)
    return found


def test_the_text_says_what_the_snapshot_says():
    seat = SeatSnapshot(
        "anna", True, LinkCount(9, 8, 7, 6, 5, 4), 0.04, 1e-3, -2e-3, {"wave clipped": 12}, 0.02, 0.03, -7.0, 1837.0
    )
    room = RoomSnapshot(
        "lab", 1, (seat, SeatSnapshot("b\"e\\n\n", False)), (0.1, 0.2, 0.3), 1.5, 100, 2,
        Times(0.5, 1e-4, 2e-4, 3e-4), Times(), 3, 1e-3, -2e-3,
    )  # fmt: skip
    found = scraped(Snapshot("1.2.3", 60.0, (room,), {"refused: token": 5}, 1000, 2000))

    def value(name: str, **labels: str) -> float:
        (sample,) = [each for each in found[f"cogrip_{name}"] if each.labels == labels]
        return sample.value

    anna = {"room": "lab", "user": "anna"}
    assert value("build_info", version="1.2.3") == 1.0
    assert value("uptime_seconds") == 60.0
    assert value("dropped_total", reason="refused: token") == 5.0
    assert [value("datagrams_total", direction=way) for way in ("in", "out")] == [1000.0, 2000.0]
    assert (value("seats", room="lab"), value("users_seated", room="lab"), value("observers", room="lab")) == (2, 1, 3)
    assert [value(f"ticks_{kind}_total", room="lab") for kind in ("due", "run", "skipped")] == [102, 100, 2]
    assert value("tick_lateness_seconds", room="lab", quantile="0.5") == 1e-4
    assert value("tick_lateness_seconds", room="lab", quantile="0.99") == 2e-4
    assert value("tick_lateness_seconds_sum", room="lab") == 0.5
    assert value("tick_lateness_seconds_count", room="lab") == 100
    assert value("tick_lateness_max_seconds", room="lab") == 3e-4
    assert "cogrip_tick_work_max_seconds" not in found, "not known, not said"
    assert [value("object_position_meters", room="lab", axis=axis) for axis in "xyz"] == [0.1, 0.2, 0.3]
    assert value("object_travel_meters_total", room="lab") == 1.5
    assert value("unstable", room="lab") == 0.0
    assert value("object_left", room="lab") == 0.0
    assert (value("least_up_margin_joules", room="lab"), value("least_line_margin_joules", room="lab")) == (1e-3, -2e-3)
    assert (value("up_margin_joules", **anna), value("line_margin_joules", **anna)) == (1e-3, -2e-3)
    assert value("rtt_seconds", **anna) == 0.04
    assert (value("up_delay_seconds", **anna), value("down_delay_seconds", **anna)) == (0.02, 0.03)
    assert (value("clock_offset_seconds", **anna), value("rendered_newtons_per_meter", **anna)) == (-7.0, 1837.0)
    assert value("seat_taken", **anna) == 1.0
    assert value("seat_taken", room="lab", user='b"e\\n\n') == 0.0, "a name cannot break a line"
    assert value("limited_total", **anna, reason="wave clipped") == 12.0
    fates = ("sent", "received", "applied", "lost", "late", "duplicate")
    assert [value(f"frames_{fate}_total", **anna, direction="up") for fate in fates] == [9, 8, 7, 6, 5, 4]


def test_names_units_and_help_are_what_prometheus_asks_for():
    room = a_room()
    take_seat(room)
    hold(room, range(5))
    for family in families(maker(room).make(1.0, {"malformed": 1}, datagrams=(1, 1))):
        assert family.name.startswith("cogrip_")
        assert family.documentation.endswith(".")
        assert not family.name.endswith("_total"), "the format adds it"
        labels = {label for sample in family.samples for label in sample.labels}
        assert labels <= {"room", "user", "reason", "direction", "axis", "quantile", "version"}
        for unit in ("_s", "_ms", "_us", "_j", "_m", "_ns"):
            assert not family.name.endswith(unit), "base units, in full"
