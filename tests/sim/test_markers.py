"""Markers in sessions: each reaches everybody once, in every recording, whatever is lost; and who sets too many is bounded."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cogrip.client.inputs import Mark
from cogrip.client.loop import LiveClient
from cogrip.client.markers import MOST_UNANSWERED
from cogrip.machine.stop import Stop
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.task import EVERYBODY
from cogrip.protocol.wire.messages import MARK_BYTES, encode
from cogrip.protocol.wire.messages import Mark as MarkMessage
from cogrip.results.reading.records import open_run
from cogrip.results.writing import laboratory_run
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server import inputs
from cogrip.server.seats.markers import BURST, MOST_TOLD, TOLD_S, RoomMarkers
from cogrip.sim.laboratory import Laboratory
from cogrip.sim.link import LinkEmulator

from tests.extent import long
from tests.sim.session_measures import assert_plays_again, run_frames

USERS = [{"name": "anna", "hand": "hold"}, {"name": "ben", "hand": "hold"}]


def session(seconds: float, **tables: Any) -> tuple[Laboratory, dict[str, list[str]]]:
    """Return a session, and the texts of events that each end records."""
    said: dict[str, list[str]] = {}

    def record(core: Any, who: str) -> Any:
        texts = said.setdefault(who, [])

        def put(topic: int, time_ns: int, payload: bytes) -> None:
            if payload.startswith(b'{"text":'):
                texts.append(payload.decode())

        return SimpleNamespace(keeps=True, put=put, close=lambda: None)

    return Laboratory(resolve({"seconds": seconds, "users": USERS, **tables}), record), said


def marked(said: list[str]) -> list[str]:
    return [text for text in said if "marker" in text]


@pytest.mark.parametrize("loss", [long(0.0), 0.3])
def test_every_marker_reaches_everybody_once(loss: float) -> None:
    laboratory, said = session(6.0, seed=3, link={"loss": loss, "delay_ms": 20.0})
    anna, ben = (person.core for person in laboratory.people)

    def each_frame(lab: Laboratory) -> None:
        if lab.room.steps % 50 == 0 and lab.room.steps <= 400:
            number = lab.room.steps // 50
            if number % 3 == 0:
                lab.server.handle(inputs.Mark(f"event {number}"), lab.now_ns)
            else:
                (anna, ben)[number % 3 - 1].handle(Mark(f"event {number}"), lab.now_ns)

    laboratory.run(None, each_frame)
    for who in ("", "anna", "ben"):
        found = sorted(text.partition("event ")[2][:1] for text in marked(said[who]))
        assert found == list("12345678"), who
    assert any("demo" not in text and "ben marker: event 2" in text for text in said[""])
    assert not anna.markers.pending()
    assert not ben.markers.pending()
    assert laboratory.server.dropped["too many markers"] == 0


def test_a_person_may_set_few_at_once() -> None:
    laboratory, said = session(1.0)
    core = laboratory.people[0].core
    laboratory.frame()
    for number in range(MOST_UNANSWERED + 2):
        core.handle(Mark(f"event {number}"), laboratory.now_ns)
    assert core.markers.refused == 2
    laboratory.run()
    assert len(marked(said["ben"])) == len(marked(said[""])) == MOST_UNANSWERED


def test_a_person_is_told_which_markers_were_set() -> None:
    """Typed at a terminal while the server does not answer; a text that is too long is told as it is set."""
    laboratory, said = session(1.0)
    laboratory.frame()
    core, told = laboratory.people[0].core, list[str]()
    typed = Stop(typed=[f"m event {number} " + "x" * 100 for number in range(MOST_UNANSWERED + 1)])
    live: Any = SimpleNamespace(_core=core, stop=typed, say=told.append, rearms=False, _unkept=None)
    LiveClient._obey(live, True, laboratory.now_ns, Any)
    laboratory.run()
    assert [text.partition(" ")[0] for text in told] == ["marker:"] * MOST_UNANSWERED + ["no"]
    for text, event in zip(told, marked(said["anna"]), strict=False):
        assert text in event
    assert len(marked(said["anna"])) == MOST_UNANSWERED


def test_a_client_that_floods_is_bounded_and_counted() -> None:
    laboratory, said = session(1.0)
    run_frames(laboratory, 16)
    seated = laboratory.people[0].core.seated
    for number in range(100):
        datagram = encode(MarkMessage(seated.session_id, number + 1, "x"))
        laboratory.server.receive(datagram, laboratory.people[0].address, laboratory.now_ns)
    assert len(marked(said[""])) == BURST
    assert laboratory.server.dropped["too many markers"] == 100 - BURST


@pytest.mark.long
def test_a_marker_whose_answers_are_all_lost_is_taken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing comes down for longer than it is told; the client resumes, and sends it until it is answered."""
    laboratory, said = session(9.0)
    laboratory.frame()
    anna = laboratory.people[0]
    anna.core.handle(Mark("once"), laboratory.now_ns)
    with monkeypatch.context() as patch:
        patch.setattr(anna, "down", LinkEmulator(LinkProfile(), "", [(0.0, 60.0)]))
        run_frames(laboratory, round((TOLD_S + 1.0) * 128))
    assert anna.core.markers.pending()
    run_frames(laboratory, 128)
    assert not anna.core.markers.pending()
    assert [len(marked(said[who])) for who in ("", "anna", "ben")] == [1, 1, 1]


def test_who_takes_a_seat_takes_no_marker_of_before_for_their_own() -> None:
    """Both clients count from 1; the first one's marker is still told when the second one comes."""
    laboratory, said = session(6.0)
    laboratory.frame()
    laboratory.people[0].core.handle(Mark("first"), laboratory.now_ns)
    laboratory.frame()
    laboratory.leave(0)
    while not laboratory.people[0].gone:
        laboratory.frame()
    laboratory.frame()
    again = laboratory.come(0)
    again.core.handle(Mark("second"), laboratory.now_ns)
    run_frames(laboratory, 64)
    assert not again.core.markers.pending()
    for who in ("", "ben", "anna 2"):
        assert ["first" in text for text in marked(said[who])].count(True) == 1, who
        assert ["second" in text for text in marked(said[who])].count(True) == 1, who


def test_an_observer_sets_none() -> None:
    laboratory, said = session(0.2)
    laboratory.frame()
    laboratory.server.receive(encode(MarkMessage(77, 1, "x")), "somebody else", 0)
    assert laboratory.server.dropped["not seated"] == 1
    assert marked(said[""]) == []


def test_who_comes_is_not_told_that_everybody_held_on_before() -> None:
    """Their hand would begin, though somebody else may have left meanwhile; other markers of before are told."""
    markers = RoomMarkers(128)
    markers.add(EVERYBODY, 0)
    markers.add(EVERYBODY, 0, 1, 7)  # a person's words
    markers.add("lamp on", 0)
    markers.begin(2)
    assert [(mark.text, mark.seat) for mark in markers.due(1)] == [(EVERYBODY, 1), ("lamp on", None)]
    markers.add(EVERYBODY, 1)
    assert [mark.text for mark in markers.due(2)] == [EVERYBODY]


def test_a_text_is_one_line_of_bounded_length() -> None:
    markers = RoomMarkers(128)
    mark = markers.add("two\nlines " + "x" * 200, 0)
    assert mark.text.startswith("two\\nlines xxx")
    assert len(mark.text.encode()) == MARK_BYTES


def test_people_who_set_many_keep_nobody_from_being_heard() -> None:
    """Four people set as many as they may before the next step; so does the administrator, after that."""
    markers = RoomMarkers(128)
    markers.add("lamp on", 0)
    markers.add("quiet", 0, 9, 1)
    for seat in range(4):
        for number in range(BURST):
            assert markers.add("x", 0, seat, number + 1)
    told = [mark.text for mark in markers.due(1)]
    assert told[:2] == ["lamp on", "quiet"]
    assert len(told) == MOST_TOLD
    for number in range(2 * MOST_TOLD):
        markers.add(f"event {number}", 1)
    assert [mark.text for mark in markers.due(2)] == [f"event {number}" for number in range(MOST_TOLD, 2 * MOST_TOLD)]


def test_a_marker_is_told_for_a_while() -> None:
    markers = RoomMarkers(128)
    markers.add("now", 1000)
    told = [step for step in range(1000, 2000) if markers.due(step)]
    assert (told[0], told[1]) == (1000, 1001)
    assert told[-1] - 1000 == TOLD_S * 128
    assert len(told) == TOLD_S * 16 + 2


def test_a_task_that_is_reached_is_a_marker() -> None:
    scene = Path(__file__).parents[2] / "configs" / "scenes" / "lift.xml"
    task = {"lifted_m": 0.0, "dwell_s": 0.0}
    laboratory, said = session(0.5, object={"kind": "scene", "file": str(scene), "axes": 3}, task=task)
    laboratory.run()
    assert len(marked(said[""])) == len(marked(said["anna"])) == 1
    assert "the task is reached" in marked(said[""])[0]


def test_a_run_tells_its_markers_on_one_clock(tmp_path: Path) -> None:
    settings = resolve({"seconds": 1.0, "users": USERS, "name": "demo", "link": {"delay_ms": 20.0}})

    class Marking(Laboratory):
        def frame(self, each_tick: Any = None) -> None:
            super().frame(each_tick)
            if self.room.steps == 32:
                self.server.handle(inputs.Mark("left: marker: twice"), self.now_ns)
            if self.room.steps in (64, 96):
                self.people[1].core.handle(Mark("again"), self.now_ns)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laboratory_run, "Laboratory", Marking)
        run_laboratory(settings, tmp_path)
    run = open_run(tmp_path)
    assert_plays_again(tmp_path)
    at_s, texts = zip(*run.markers(), strict=True)
    assert texts == ("left: marker: twice", "ben again", "ben again")
    assert at_s[0] == pytest.approx(255 / 1024, abs=1e-6)
    assert at_s[1] == pytest.approx(511 / 1024 + 0.02, abs=1 / 128)  # on its way for 20 ms, entered at the next step
    (tmp_path / "server.mcap").unlink()
    told_s, told = zip(*open_run(tmp_path).markers(), strict=True)
    assert told == ("left: marker: twice", "again", "again")
    assert told_s[0] == pytest.approx(at_s[0] + 0.02, abs=2 / 128)
