"""Rooms on demand: opened under a name, entered by it alone, closed, and a spare room again that has forgotten all of it."""

import gc
import tracemalloc
from typing import Any

import numpy as np
import pytest

from cogrip.machine.pacing import Pacer
from cogrip.protocol.settings.settable import RoomChange
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Welcome, decode
from cogrip.server.administration.orders import NewRoomOrder
from cogrip.server.checkpoint import decode as decode_checkpoint
from cogrip.server.checkpoint import encode as encode_checkpoint
from cogrip.server.core import ServerCore
from cogrip.server.inputs import CloseLedger, CloseRoom, OpenRoom, Restore, SetRoom, SpareRooms
from cogrip.server.io.housekeeping import entry_of
from cogrip.server.io.rooms_on_demand import RoomsOnDemand
from cogrip.server.room import Room
from cogrip.server.snapshot import SnapshotMaker

from tests.kinds import SCHEMES, object_of
from tests.server.recorded_rooms import ADDRESSES, Server, a_room
from tests.server.test_server_core import Desk, hello, room, waves

S = 1_000_000_000


def demand(core: ServerCore, count: int, empty_s: float = 60.0) -> tuple[RoomsOnDemand, list[tuple[Room, bool]]]:
    changed: list[tuple[Room, bool]] = []
    core.handle(SpareRooms("lesson", tuple(f"lesson.{number}" for number in range(count))), 0)
    return RoomsOnDemand(core, entry_of, lambda room, opened: changed.append((room, opened)), empty_s), changed


def lessons(count: int, **tables: Any) -> Desk:
    return Desk(room("lab"), *(room(f"lesson.{number}", **tables) for number in range(count)))


def test_a_spare_room_is_nobodys_and_an_open_one_is_entered_by_its_name() -> None:
    desk = lessons(2)
    rooms, changed = demand(desk.core, 2)
    assert desk.refused("x", room="lesson.0").code == "room"
    reply = rooms.open(NewRoomOrder("lesson", "group 7", {"class": "physics"}))
    assert reply.ok
    assert [(each.name, each.template, dict(each.labels)) for each in reply.rooms] == [
        ("group 7", "lesson", {"class": "physics"})
    ]
    assert desk.refused("x", room="lesson.0", nonce=2).code == "room"
    welcome = desk.welcome("x", room="group 7")
    assert (welcome.settings.room, welcome.settings.user) == ("group 7", "anna")
    assert desk.welcome("y").settings.room == "lab", "whoever names no room comes into one that is open to all"
    assert [event.text for event in desk.core.events if event.room == "group 7"] == [
        "group 7: opened, of template lesson", "group 7: anna joined from x with sim:ideal",
    ]  # fmt: skip
    assert [opened for _, opened in changed] == [True]


def test_a_closed_room_sends_its_people_out_and_the_next_one_begins_anew() -> None:
    desk = lessons(1, object={"axes": 1})
    rooms, _ = demand(desk.core, 1)
    lesson = desk.core.rooms[1]
    start = lesson.world.save()
    for turn in range(2):
        assert rooms.open(NewRoomOrder("lesson", f"group {turn}")).ok
        assert lesson.world.save() == start
        session = desk.welcome("x", room=f"group {turn}", nonce=turn + 5).session
        desk.core.handle(SetRoom(RoomChange(0.7), f"group {turn}"), desk.now_ns)
        for number in range(300):
            desk.core.receive(waves(session, number, 0.4), "x", desk.now_ns)
            desk.tick(1)
        assert lesson.world.mass_kg == 0.7
        assert lesson.travel_m > 0.0
        assert rooms.close(f"group {turn}", "by the administrator") == (
            f"group {turn}: closed; sessions ended: 1",
            True,
        )
        (farewell,) = [each for each in desk.heard("x") if type(each).__name__ == "Farewell"]
        assert farewell.reason == "sent out: by the administrator"
        assert desk.refused("y", room=f"group {turn}", nonce=turn + 50).code == "room"
    assert rooms.close("group 1", "again") == ("no room 'group 1' was opened on demand; there is: none", False)


def test_what_cannot_be_opened_says_why() -> None:
    desk = lessons(1)
    rooms, _ = demand(desk.core, 1)
    assert rooms.open(NewRoomOrder("lessons")).text == "there is no template 'lessons'; there is: lesson"
    assert "is no name of a room" in rooms.open(NewRoomOrder("lesson", "../x")).text
    for taken in ("lab", "lesson.0"):
        assert rooms.open(NewRoomOrder("lesson", taken)).text == f"there is a room {taken!r} already; give another name"
    drawn = rooms.open(NewRoomOrder("lesson"))
    assert drawn.ok
    assert drawn.rooms[0].name.startswith("lesson-")
    assert rooms.open(NewRoomOrder("lesson")).text.startswith("all rooms of template 'lesson' are open; ")


def test_a_room_that_is_empty_for_long_is_closed_and_one_with_people_is_not() -> None:
    desk = lessons(2)
    rooms, changed = demand(desk.core, 2, empty_s=60.0)
    for name in ("held", "empty"):
        rooms.open(NewRoomOrder("lesson", name))
    begun_ns = max(rooms._since_ns.values())
    desk.now_ns = begun_ns
    desk.welcome("x", room="held")
    assert rooms.close_empty(begun_ns + 60 * S) == []
    assert rooms.close_empty(begun_ns + 60 * S + 1_000_000_000) == ["empty: closed; sessions ended: 0"]
    assert [(room.called, opened) for room, opened in changed if not opened] == [("", False)]
    desk.core.rooms[1].leave_seat(0, "leave")
    assert rooms.close_empty(begun_ns + 90 * S) == []
    assert rooms.close_empty(begun_ns + 200 * S) == ["held: closed; sessions ended: 0"]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_world_begins_anew(scheme: str) -> None:
    tables: dict[str, Any] = {"coupling": {"kind": scheme}, "object": {"kind": object_of(scheme), "axes": 1}}
    server = Server(a_room("lesson.1", "ab", **tables))
    server.handle(SpareRooms("lesson", ("lesson.1",)))
    world = server.core.rooms[0].world
    start = world.save()
    for name in ("one", "two"):
        server.handle(OpenRoom("lesson.1", name))
        assert np.array_equal(world.save(), start)
        server.core.receive(server.hello(0, room=name, axes=3), ADDRESSES[0], server.now_ns)
        server.hear()
        server.run(30, (0,))
        server.handle(CloseRoom("lesson.1", "it is over"))


def test_rooms_on_demand_play_again_bit_for_bit() -> None:
    server = Server(a_room("hall", "z"), a_room("lesson.1", "ab"), a_room("lesson.2", "ab"))
    server.handle(SpareRooms("lesson", ("lesson.1", "lesson.2")))
    for name in ("group 7", "group 8"):
        server.handle(OpenRoom("lesson.2", name, {"class": "physics"}))
        server.core.receive(server.hello(0, room=name), ADDRESSES[0], server.now_ns)
        server.hear()
        server.run(20, (0,))
        server.handle(SetRoom(RoomChange(0.5, 2.0), name))
        server.run(20, (0,))
        server.handle(CloseRoom("lesson.2", "it is over"))
    server.handle(CloseLedger())
    server.exact()


def test_a_restarted_server_has_the_rooms_that_were_open() -> None:
    desk, again = lessons(2), lessons(2)
    rooms, _ = demand(desk.core, 2)
    rooms.open(NewRoomOrder("lesson", "group 7", {"class": "physics"}))
    demand(again.core, 2)
    for checkpoint in desk.core.checkpoint():
        again.core.handle(Restore(decode_checkpoint(encode_checkpoint(checkpoint))), 0)
    assert [(each.called, each.is_open) for each in again.core.rooms] == [("lab", True), ("group 7", True), ("", False)]
    assert isinstance(again.hello("x", room="group 7"), Welcome)


def test_measures_are_of_open_rooms_under_their_names() -> None:
    desk = lessons(2)
    rooms, _ = demand(desk.core, 2)
    ticks = {each.name: Pacer(128, 0) for each in desk.core.rooms}
    maker = SnapshotMaker(desk.core.rooms, ticks, "test")

    def names() -> list[str]:
        return [each.room for each in maker.make(1.0).rooms]

    assert names() == ["lab"]
    rooms.open(NewRoomOrder("lesson", "group 7"))
    assert names() == ["lab", "group 7"]
    rooms.close("group 7", "it is over")
    rooms.open(NewRoomOrder("lesson", "group 8"))
    assert names() == ["lab", "group 8"]


def test_a_thousand_rooms_come_and_go_and_nothing_grows() -> None:
    desk = lessons(3)
    rooms, changed = demand(desk.core, 3)

    def come_and_go(first: int, last: int) -> None:
        for number in range(first, last):
            assert rooms.open(NewRoomOrder("lesson", f"group {number}", {"number": str(number)})).ok
            (answer,) = [decode(each) for each in said(desk, number)]
            assert isinstance(answer, Welcome)
            desk.tick(1)
            assert rooms.close(f"group {number}", "it is over")[1]
            desk.core.outbox.clear()
            desk.core.events.clear()
            changed.clear()

    come_and_go(0, 100)
    gc.collect()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    come_and_go(100, 1000)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 100_000, "100 bytes a room"
    assert len(desk.core.addresses) <= 3


def said(desk: Desk, number: int) -> list[bytes]:
    desk.core.receive(messages.padded(hello(room=f"group {number}", nonce=number + 1)), f"{number % 3}", desk.now_ns)
    return [datagram for _, datagram in desk.core.outbox]
