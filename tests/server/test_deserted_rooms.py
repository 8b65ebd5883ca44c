"""Rooms where nobody is cost nothing: they are not stepped, and are caught up with once somebody comes."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.machine.pacing import Pacer
from cogrip.machine.stop import Stop
from cogrip.protocol.recording.records import Input
from cogrip.protocol.wire.session import LOST_NS
from cogrip.server import inputs
from cogrip.server.administration.orders import MarkOrder
from cogrip.server.checkpoint import decode
from cogrip.server.io import checkpoint_file
from cogrip.server.io.housekeeping import EVERY_NS, POLL_EVERY_NS, Housekeeping
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.paced_room import PacedRoom, deserted_among
from cogrip.server.io.state_folder import make_folder
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.recorder import INPUT
from cogrip.server.snapshot import SnapshotMaker
from cogrip.server.unencrypted_channel import UnencryptedListener

from tests.server.recorded_rooms import FRAME_NS, Server, a_room


class Loop:
    """A live loop in virtual time, without its socket: two rooms, stepped when they are due."""

    def __init__(self) -> None:
        self.people = Server(a_room("lab"), a_room("hall", "z"))
        self.server = LiveServer(
            [], "127.0.0.1", 0, Stop(), print, lambda core: UnencryptedListener(RateLimiter(b"s"), core.knows)
        )
        self.server.core = core = self.people.core
        for room in core.rooms:
            self.server.pacers[room.name] = pacer = Pacer(128, self.people.now_ns + FRAME_NS)
            self.server._awake.append(PacedRoom(room, pacer))
        self.lab, self.hall = core.rooms

    def frame(self, *words: tuple[int, str, int, float], frames: int = 1) -> None:
        """So many frames pass, of which the last is stepped, and what comes is received before that step."""
        self.people.now_ns += frames * FRAME_NS
        now_ns, server = self.people.now_ns, self.server
        for each in server._awake:
            each.take(now_ns)
        self.people.hear(*words)
        for each in server._awake:
            each.step(self.people.core, now_ns, 0)
        self.people.hear()
        server.core.finish_step()
        if server.core.woken:
            server._wake(now_ns)
        for each in deserted_among(server._awake):
            server._awake.remove(each)
            server._asleep[each.room] = each

    @property
    def asleep(self) -> list[str]:
        return [room.name for room in self.server._asleep]

    def idle_inputs(self) -> list[inputs.Idle]:
        given = [msgspec.json.decode(payload, type=Input) for topic, _, payload in self.people.noted if topic == INPUT]
        found = [inputs.decode(each.value) for each in given if each.kind == "idle"]
        return [each for each in found if isinstance(each, inputs.Idle)]


def test_a_room_sleeps_after_a_step_without_anybody_and_wakes_when_somebody_comes() -> None:
    loop = Loop()
    assert loop.asleep == []
    loop.frame()
    assert loop.asleep == ["lab", "hall"]
    steps = loop.lab.steps
    loop.frame(frames=1000)
    assert loop.lab.steps == steps, "nothing is done for it"
    loop.frame((0, "hello", 0, 0.0))
    assert loop.asleep == ["hall"]
    assert loop.lab.steps == loop.server.pacers["lab"].run == steps + 1001, "it has been caught up with"
    assert loop.hall.steps == steps
    loop.frame((0, "next", 0, 0.1))
    assert loop.lab.steps == loop.server.pacers["lab"].run
    loop.frame((0, "leave", 0, 0.0))
    assert loop.asleep == ["hall", "lab"]
    assert loop.idle_inputs()[-1].room == "lab"


@given(
    st.lists(
        st.tuples(
            st.integers(1, 300), st.sampled_from(["hello", "next", "leave", "hello to a room", ""]), st.integers(0, 2)
        ),
        min_size=1,
    )
)
def test_steps_are_the_ticks_that_were_due_and_the_recording_plays_again(
    script: list[tuple[int, str, int]],
) -> None:
    loop = Loop()
    for frames, kind, who in script:
        loop.frame(*([(who, kind, 0, 0.1)] if kind else []), frames=frames if kind != "next" else 1)
        for each in loop.server._awake:
            assert each.room.steps == each.pacer.run
    loop.server.count_deserted(loop.people.now_ns)
    for room in loop.people.core.rooms:
        pacer = loop.server.pacers[room.name]
        assert room.steps == pacer.run
        behind = pacer.tick_at(loop.people.now_ns) + 1 - pacer.due
        assert behind == 0 if room.name in loop.asleep else behind in (0, 1), "a tick may be run a period late"
    loop.people.handle(inputs.CloseLedger())
    loop.people.exact()


def test_a_room_that_everybody_left_before_its_step_is_stepped_once_more() -> None:
    """An object in motion, or out of the workspace, must not stay as it was until somebody comes."""
    loop = Loop()
    loop.frame((0, "hello", 0, 0.0))
    for _ in range(8):
        loop.frame((0, "next", 0, 0.5))
    loop.lab.world.velocity = np.array([1.0, 0.0, 0.0])
    loop.people.hear((0, "leave", 0, 0.0))
    assert deserted_among(loop.server._awake) == []
    loop.frame()
    assert loop.asleep == ["hall", "lab"]
    assert not np.any(loop.lab.world.velocity)


def test_whoever_falls_silent_lets_the_room_sleep() -> None:
    loop = Loop()
    loop.frame((0, "hello", 0, 0.0))
    loop.frame((0, "next", 0, 0.1))
    for _ in range(2 + LOST_NS // FRAME_NS):
        loop.frame()
    assert loop.asleep == ["hall", "lab"]


def test_steps_pass_at_once_where_somebody_has_come_and_not_where_somebody_holds() -> None:
    loop = Loop()
    loop.frame((0, "hello", 0, 0.0))
    loop.people.handle(inputs.Idle("lab", 7))
    loop.frame((0, "next", 0, 0.1))
    with pytest.raises(ValueError, match=r"7 idle steps of room 'lab', where somebody holds the object"):
        loop.people.handle(inputs.Idle("lab", 7))


def test_only_rooms_that_were_used_have_checkpoints_and_deserted_ones_a_last_one(tmp_path: Path) -> None:
    loop, folder = Loop(), make_folder(tmp_path / "state")
    housekeeping = Housekeeping(loop.server, print, folder=folder)
    housekeeping.begin()

    def chores() -> None:
        for _ in range(EVERY_NS // POLL_EVERY_NS):
            loop.frame(frames=1 + POLL_EVERY_NS // FRAME_NS)
            housekeeping.chore(loop.people.now_ns)

    def kept() -> dict[str, int]:
        housekeeping.write_checkpoints()
        for writer in housekeeping._writers.values():
            writer.close()
        assert housekeeping._thread is not None
        housekeeping._thread.begin()
        return {
            name: housekeeping._writers[name].written + housekeeping._writers[name].overtaken
            for name in ("lab", "hall")
        }

    chores()
    assert kept() == {"lab": 0, "hall": 0}
    loop.frame((0, "hello", 0, 0.0))
    housekeeping.chore(loop.people.now_ns + POLL_EVERY_NS)
    assert kept()["hall"] == 0
    assert kept()["lab"] > 0, "a new session is kept at once"
    loop.frame((0, "leave", 0, 0.0))
    loop.frame()
    chores()
    last = kept()
    chores()
    assert kept() == last, "nothing changes where nobody is"
    housekeeping.end(said_goodbye=False)
    data = checkpoint_file.read(folder.checkpoint("lab"))
    assert data is not None
    assert checkpoint_file.read(folder.checkpoint("hall")) is None


def test_a_marker_of_the_administrator_gets_the_step_of_now() -> None:
    loop = Loop()
    loop.frame()
    housekeeping = Housekeeping(loop.server, print)
    assert housekeeping._mark(MarkOrder("here", "hall")) == ("marked in 1 room: here", True)
    assert (loop.lab.steps, loop.server.pacers["lab"].run) == (1, 1), "nothing is asked of it"
    assert housekeeping._mark(MarkOrder("there", "")) == ("marked in 2 rooms: there", True)
    for room in loop.people.core.rooms:
        assert room.markers._told[-1].step == room.steps == loop.server.pacers[room.name].run > 1


def test_a_snapshot_of_a_deserted_room_is_the_last_one_with_its_ticks() -> None:
    loop = Loop()
    make = SnapshotMaker(loop.people.core.rooms, loop.server.pacers, "").make
    loop.frame()
    assert [room.ticks_run for room in make(1.0).rooms] == [1, 1]
    loop.lab.travel_m = 3.0
    loop.frame(frames=100)
    loop.server.count_deserted(loop.people.now_ns, steps=False)
    second = make(2.0).rooms
    assert [room.ticks_run for room in second] == [101, 101]
    assert second[0].travel_m == 0.0, "nothing else can have changed"
    assert loop.lab.steps == 1
    loop.frame((0, "hello", 0, 0.0))
    assert [(room.ticks_run, room.travel_m, room.seated) for room in make(3.0).rooms] == [(102, 3.0, 1), (101, 0.0, 0)]
    assert loop.lab.steps == 102


def test_a_visit_between_two_snapshots_is_in_the_second() -> None:
    loop = Loop()
    make = SnapshotMaker(loop.people.core.rooms, loop.server.pacers, "").make
    loop.frame()
    assert make(1.0).rooms[0].travel_m == 0.0
    loop.frame((0, "hello", 0, 0.0))
    for _ in range(40):
        loop.frame((0, "next", 0, 0.5))
    loop.frame((0, "leave", 0, 0.0))
    assert "lab" in loop.asleep
    seen = make(1.5).rooms[0]
    assert seen.travel_m == loop.lab.travel_m > 0.0
    assert seen.seats[0].frames.received > 0
    assert seen.least_up_margin_j is not None


def test_a_room_that_is_handed_over_has_its_newest_people_and_steps(tmp_path: Path) -> None:
    """Somebody may have come since rooms were last looked at, and nobody for an hour."""
    loop, folder = Loop(), make_folder(tmp_path / "state")
    housekeeping = Housekeeping(loop.server, print, folder=folder)
    housekeeping.begin()
    loop.frame()
    housekeeping.chore(loop.people.now_ns)
    loop.frame((0, "hello", 0, 0.0))
    housekeeping.write_checkpoints()
    kept = decode(housekeeping.last_checkpoint())
    data = checkpoint_file.read(folder.checkpoint("lab"))
    assert data is not None
    assert decode(data).seats[0].ticket == kept.seats[0].ticket != ""
    loop.frame((0, "leave", 0, 0.0))
    assert decode(housekeeping.last_checkpoint()).steps == loop.server.pacers["lab"].run > 3
    housekeeping.end(said_goodbye=False)
