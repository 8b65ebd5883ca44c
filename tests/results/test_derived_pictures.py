"""Pictures for 3D panels that the writer of a server's recording derives, and everything that leaves them out again."""

import json
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from cogrip.protocol.recording.derived import DERIVED, MOST_HZ, Pictures
from cogrip.protocol.recording.folder import RECOVERED
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import SeatStep, Step, kind_of
from cogrip.protocol.recording.recover import recover
from cogrip.protocol.recording.scene_messages import turned_to
from cogrip.protocol.session_drawing import FORCE_M_PER_N, LEAST_DRAWN_N, anchors_m
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.export import export
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.recorder import server_topics, start_text, step_topic

from tests.foxglove_schemas import PUBLISHED, check_schema, check_value

SECONDS = 1.5


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "demo"
    folder.mkdir()
    users = [
        {"name": "anna", "hand": "reach&direction=1,0.5,-0.3"},
        {"name": "ben", "hand": "tremor&direction=0.2,1,1&seed=3", "side": "right"},
    ]
    run_laboratory(resolve({"name": "demo", "seconds": SECONDS, "object": {"axes": 3}, "users": users}), folder)
    return folder


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return (log time, message) of each derived topic, read by the `mcap` library and checked against what is published."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if kind_of(channel.topic) in DERIVED:
                assert schema is not None
                check_schema(json.loads(schema.data), PUBLISHED[schema.name])
                value = json.loads(message.data)
                check_value(value, PUBLISHED[schema.name])
                found.setdefault(channel.topic, []).append((message.log_time, value))
    return found


def test_a_3d_panel_finds_scene_transforms_and_forces_where_the_steps_say(run: Path) -> None:
    pictures = read(run / "server.mcap")
    assert set(pictures) == {f"/room/demo/{kind}" for kind in DERIVED}
    transforms, forces = pictures["/room/demo/tf"], pictures["/room/demo/forces"]
    assert len(transforms) == len(forces) == SECONDS * MOST_HZ
    steps = {round(step.time_s * 1e9): step.record for step in open_run(run).steps()}
    anchors = anchors_m("cube", ["left", "right"])
    arrows = 0
    for (time_ns, told), (_, pushed) in zip(transforms, forces, strict=True):
        step = steps[time_ns]
        wanted = {"demo/object": step.object_m}
        for seat, anchor in zip(step.seats, anchors, strict=True):
            place = [proxy + away for proxy, away in zip(seat.proxy_m, anchor, strict=True)]
            wanted[f"demo/{seat.user}/proxy"] = tuple(place)
        found = {each["child_frame_id"]: tuple(each["translation"].values()) for each in told["transforms"]}
        assert found == {name: pytest.approx(place, abs=1e-7) for name, place in wanted.items()}
        assert {each["parent_frame_id"] for each in told["transforms"]} == {"demo"}
        (entity,) = pushed["entities"]
        strong = [sum(each**2 for each in seat.force_n) ** 0.5 for seat in step.seats]
        strong = [force_n for force_n in strong if force_n >= LEAST_DRAWN_N]
        lengths = [arrow["shaft_length"] + arrow["head_length"] for arrow in entity["arrows"]]
        assert lengths == pytest.approx([FORCE_M_PER_N * force_n for force_n in strong], abs=2e-5)
        arrows += len(lengths)
    assert arrows > len(transforms)  # both push most of the time
    scenes = [scene for _, scene in pictures["/room/demo/scene"]]
    assert len(scenes) == 2  # once a second
    for scene in scenes:
        assert [entity["id"] for entity in scene["entities"]] == ["demo/object", "demo/anna/proxy", "demo/ben/proxy"]
        assert [text["text"] for entity in scene["entities"] for text in entity["texts"]] == ["anna", "ben"]


@given(st.tuples(*[st.floats(-9.0, 9.0)] * 3).filter(lambda force: sum(each**2 for each in force) > 1e-3))
def test_an_arrow_points_along_its_force(force: tuple[float, float, float]) -> None:
    q = turned_to(force)
    turned = (1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y))
    length = sum(each**2 for each in force) ** 0.5
    assert turned == pytest.approx([each / length for each in force], abs=1e-3)


def test_replay_and_tables_leave_them_out(run: Path, tmp_path: Path) -> None:
    assert verify(open_recording(run / "server.mcap")).exact
    tables = {table.path.name for table in export(open_run(run), "csv", tmp_path / "tables")}
    assert "server.step.csv" in tables
    assert not [name for name in tables for kind in DERIVED if f".{kind}." in name]


def test_a_recovered_recording_has_them_once(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "server.mcap"
    shutil.copy(run / "server.mcap", path)
    whole = read(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - 200])  # the end is missing, no message
    recover(path)
    assert read(tmp_path / f"server{RECOVERED}") == whole
    assert verify(open_recording(tmp_path / f"server{RECOVERED}")).difference is None


def header(settings: Settings, start: str | None = None) -> Header:
    text = start_text([settings], "test") if start is None else start
    topics = server_topics([settings.name])
    return Header("server", "server", text, 128, 1, 0, True, versions_here(), topics, settings.name)


def test_what_cannot_be_drawn_is_not_drawn_and_the_next_step_is() -> None:
    settings = resolve({"name": "demo"})
    topic = header(settings).topics.index(step_topic("demo"))
    seat = SeatStep("user1", True, (0.1,), (1.0,), None, None, None, None, 0)
    unknown = Step(1, (None,), (None,), (seat,))
    pictures = Pictures(header(settings))
    assert pictures.of(topic, 0, msgspec.json.encode(unknown)) == []
    assert pictures.of(topic + 1, 0, b"") == []
    for _ in range(3):
        assert pictures.of(topic, 1, b"not a step at all") == []  # between two pictures it is not even read
    assert pictures.of(topic, 2, b"{}") == []
    pictures = Pictures(header(settings))
    assert len(pictures.of(topic, 3, msgspec.json.encode(Step(2, (0.0,), (0.0,), (seat,))))) == len(DERIVED)
    for start in ("", "{}", '{"rooms": [7]}'):
        assert Pictures(header(settings, start)).of(topic, 0, msgspec.json.encode(unknown)) == []


def test_who_joins_with_the_hand_elsewhere_is_drawn_at_the_object() -> None:
    settings = resolve({"name": "demo"})
    topic = header(settings).topics.index(step_topic("demo"))
    pictures = Pictures(header(settings))
    found = []
    for number, (object_m, proxy_m) in enumerate([(0.1, 0.4), (0.1, 0.4), (0.1, 0.4), (0.1, 0.4), (0.2, 0.51)]):
        seat = SeatStep("user1", True, (proxy_m,), (1.0,), None, None, None, None, 0)
        made = pictures.of(topic, number, msgspec.json.encode(Step(number, (object_m,), (0.0,), (seat,))))
        found += [json.loads(payload) for place, payload in made if place == topic + 2]
    places = [[each["translation"]["x"] for each in message["transforms"]] for message in found]
    assert places == [pytest.approx([0.1, 0.08]), pytest.approx([0.2, 0.19])]  # held 20 mm from the middle
