"""Scenes and frames of a live session, from what an observer of a laboratory session received."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.client import inputs
from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.client.observer import ObserverCore
from cogrip.protocol.recording.records import Datagram
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES, Person, View, decode
from cogrip.protocol.wire.session import ClientSession, make_hello
from cogrip.results.report.page import write_report
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.recorder import DATAGRAM_OUT
from cogrip.server.seats.observers import PEOPLE_A_VIEW, VIEWS_HZ
from cogrip.sim.laboratory import Laboratory
from cogrip.view import frames
from cogrip.view.frames import SceneFrame
from cogrip.view.live import LiveScene
from cogrip.view.recording import open_view

FRAME_S = 1 / 128


class Watched:
    """A laboratory session with an observer, whose frames are kept."""

    def __init__(self, **tables: Any) -> None:
        settings = resolve({"seconds": 3.0, "users": [{"name": "anna"}, {"name": "ben", "hand": "hold"}], **tables})
        hello = make_hello(
            software="1", nonce=99, room="", name="", digest="", device="none", axes=1, rate_hz=1.0, role="observer"
        )
        self.observer = ObserverCore(ClientSession(hello))
        self.messages: list[View | Person] = []
        self.frames: list[SceneFrame] = []
        self.live: LiveScene | None = None
        self.lab = Laboratory(settings, lambda core, who: self if who == "" else Ignored())

    keeps = True

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Take what the server recorded; its datagrams to the observer are received."""
        if topic != DATAGRAM_OUT:
            return
        sent = msgspec.json.decode(payload, type=Datagram)
        if sent.address != '"observer"':
            return
        assert len(sent.data) <= MAX_MESSAGE_BYTES
        message = decode(sent.data)
        if isinstance(message, View | Person):
            self.messages.append(message)
        self.observer.receive(sent.data, time_ns)

    def run(self, each_frame: Callable[[Laboratory], None] = lambda lab: None) -> "Watched":
        observer, views = self.observer, 0

        def watch(lab: Laboratory) -> None:
            nonlocal views
            each_frame(lab)
            observer.handle(inputs.Poll() if observer.session.state != "idle" else inputs.Connect(), lab.now_ns)
            while observer.outbox:
                lab.server.receive(observer.outbox.popleft(), "observer", lab.now_ns)
            welcome = observer.session.welcome
            if welcome is not None and self.live is None:
                self.live = LiveScene(welcome.settings)
            if self.live is not None and observer.views > views:
                views = observer.views
                frame = self.live.update(observer)
                assert frame is not None
                self.frames.append(frame)

        self.lab.run(each_frame=watch)
        return self


ZONE = {"kind": "zone", "place_m": (-0.02, 0.0, 0.0), "size_m": (0.01, 0.0, 0.0), "stiffness_npm": 500.0}


@pytest.mark.long
def test_haptic_effects_are_drawn_beside_the_object_while_they_last() -> None:
    path = {"kind": "path", "points_m": ((0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.03, 0.04, 0.0)), "stiffness_npm": 100.0}
    channel = {"kind": "channel", "points_m": ((0.0, -0.02, 0.0), (0.0, 0.02, 0.0)), "stiffness_npm": 100.0}
    spring = {"kind": "spring", "place_m": (0.01, 0.0, 0.0), "stiffness_npm": 5.0}
    field = {"kind": "curl", "direction": (0.0, 0.0, 1.0), "damping_nspm": 1.0}  # everywhere: nothing to see
    watched = Watched(effects=[ZONE, path, channel, spring, field], object={"axes": 2})
    watched.run()
    live = watched.live
    assert live is not None
    assert [shape.kind for shape in live.scene.effects] == ["box", *["capsule"] * 3, "sphere"]
    box, first, second, line, point = live.scene.effects
    assert (line.place_m, line.size_m[1]) == ((0.0, 0.0, 0.0), pytest.approx(0.02))
    assert point.place_m == (0.01, 0.0, 0.0)
    assert box.place_m == (-0.02, 0.0, 0.0)
    assert box.size_m[0] == 0.01
    assert (first.place_m, second.place_m) == ((0.015, 0.0, 0.0), (0.03, 0.02, 0.0))
    assert first.size_m[1] == pytest.approx(0.015)
    assert live.scene.geoms == ()


class Ignored:
    """A sink that keeps nothing."""

    keeps = False

    def put(self, topic: int, time_ns: int, payload: bytes) -> None: ...


@pytest.mark.sample(1)
@pytest.mark.parametrize("axes", [1, 3])
def test_frames_show_what_the_server_had(axes: int) -> None:
    places: dict[int, list[float]] = {}
    watched = Watched(object={"axes": axes}, link={"delay_ms": 20.0}).run(
        lambda lab: places.update({lab.room.steps: lab.room.world.motion()[:axes]})
    )
    assert watched.live is not None
    assert [person.name for person in watched.live.scene.people] == ["anna", "ben"]
    assert len(watched.frames) > 2.5 * VIEWS_HZ
    for frame in watched.frames:
        assert list(frame.position_m[:axes]) == list(places[frame.number])
        assert frame.position_m[axes:] == (0.0,) * (3 - axes)
    last = watched.frames[-1]
    assert [person.state for person in last.people] == ["live", "live"]
    for number, person in enumerate(last.people):
        world, port = watched.lab.room.world, watched.lab.room.seats[number].port
        assert port is not None
        assert person.flags & frames.HAND_KNOWN
        assert not person.flags & frames.NOT_PASSIVE
        assert 40.0 <= person.rtt_ms <= 40.0 + 2e3 * FRAME_S  # and the wait for a tick and a step
        assert 0.0 <= person.up_ms - 20.0 - 1e3 * FRAME_S * port.playout_frames <= 1e3 * FRAME_S
        assert person.loss == 0.0
        assert len(world.offset[number]) == axes


@pytest.mark.long
def test_a_person_is_shown_the_object_as_it_was_a_delay_ago() -> None:
    watched = Watched(link={"delay_ms": 50.0}).run()
    by_number = {frame.number: frame.position_m for frame in watched.frames}
    for frame in watched.frames[-64:]:
        for person in frame.people:
            assert 50.0 <= person.down_ms <= 50.0 + 1e3 * 4 * FRAME_S
            near = [by_number[n] for n in by_number if abs((frame.number - n) * 1e3 * FRAME_S - person.down_ms) <= 17.0]
            assert person.seen_m in near


def test_whoever_leaves_or_falls_silent_is_told() -> None:
    def happen(lab: Laboratory) -> None:
        if lab.now_ns > 10**9 and not lab.people[1].going and not lab.people[1].gone:
            lab.leave(1)
        if lab.now_ns > 1.5e9:
            lab.people[0].lost.update(lab.people[0].migration.paths)

    watched = Watched(seconds=3.2).run(happen)
    assert watched.live is not None
    said = [(event.kind, event.who) for event in watched.live.events]
    assert said[:2] == [("joined", "anna"), ("joined", "ben")] or said[:2] == [("joined", "ben"), ("joined", "anna")]
    assert ("left", "ben") in said
    assert ("lost", "anna") in said


def test_presses_and_releases_are_told_and_shown() -> None:
    users = [{"name": "anna", "device": "sim:phantom?press=2@0.5+0.3,32@0.6+0.1"}, {"name": "ben", "hand": "hold"}]
    watched = Watched(seconds=1.5, users=users).run()
    assert watched.live is not None
    said = [event for event in watched.live.events if event.kind == "button"]
    assert [event.text for event in said] == [
        "anna presses button 2", "anna presses button 32", "anna releases button 32", "anna releases button 2",
    ]  # fmt: skip
    shown = [frame.people[0].buttons for frame in watched.frames if frame.people]
    assert [now for before, now in pairwise([0, *shown]) if now != before] == [2, 2 | 1 << 31, 2, 0]
    begun = watched.frames[0].number * FRAME_S
    for event, at_s in zip(said, (0.5, 0.6, 0.7, 0.8), strict=True):
        assert 0.0 <= event.time_s + begun - at_s < 4 * FRAME_S, "to the end of its frame, and to the next view"


def test_loss_is_that_of_the_last_second() -> None:
    watched = Watched(seconds=6.0, link={"delay_ms": 5.0, "loss": 0.2}, playout={"redundancy": 1}).run()
    shares = [person.loss for frame in watched.frames[-128:] for person in frame.people]
    assert 0.1 < sum(shares) / len(shares) < 0.3


@pytest.mark.long
def test_of_many_people_each_is_told_in_turn() -> None:
    users = [{"name": f"u{number}"} for number in range(7)]
    watched = Watched(seconds=1.0, users=users).run()
    told: dict[int, int] = {}
    views = 0
    for message in watched.messages:
        if isinstance(message, View):
            views += 1
        else:
            told[message.seat] = told.get(message.seat, 0) + 1
    assert sum(told.values()) <= PEOPLE_A_VIEW * views
    assert len(told) == 7
    assert max(told.values()) - min(told.values()) <= 1
    assert watched.live is not None
    assert len(watched.live.scene.people) == 7


def test_of_copies_the_servers_is_shown_and_said_to_be(tmp_path: Path) -> None:
    """Two who pull apart feel copies that lie apart by millimetres; whoever looks sees the server's, live and recorded."""
    users = [
        {"name": name, "hand": f"reach&amplitude_m={sign}0.03", "device": "sim:ideal?mass_kg=0.1"}
        for name, sign in (("anna", ""), ("ben", "-"))
    ]
    places, apart_m = dict[int, float](), list[float]()

    def note(lab: Laboratory) -> None:
        places[lab.room.steps] = lab.room.world.motion()[0]
        coupling = lab.people[0].core.coupling
        assert isinstance(coupling, PartnerCoupling)
        if coupling.place_m is not None:
            apart_m.append(abs(coupling.place_m[0] - lab.room.world.offset[0, 0] - places[lab.room.steps]))

    watched = Watched(coupling={"kind": "partner"}, link={"delay_ms": 50.0}, users=users).run(note)
    assert watched.live is not None
    assert max(apart_m) > 1e-3
    assert [frame.position_m[0] for frame in watched.frames] == [places[frame.number] for frame in watched.frames]
    assert "Shown is the server's copy of the object" in watched.live.scene.note
    run_laboratory(watched.lab.settings, tmp_path)
    assert "Shown is the server's copy of the object" in open_view(tmp_path).scene.note
    report = write_report(tmp_path).read_text()
    assert "Shown is the server&#39;s copy of the object" in report
    assert "all gates may give" in report
