"""Recordings and the Foxglove socket before others' judges: JSON Schema, foxglove-sdk, and the checks of `mcap doctor`."""

import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zstandard
from jsonschema import Draft202012Validator, FormatChecker
from mcap.reader import make_reader
from openapi_schema_validator import OAS30StrictValidator, oas30_strict_format_checker

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.recording.records import kind_of
from cogrip.protocol.recording.schema import NOT_SHOWN
from cogrip.results.reading.bag import export_bag
from cogrip.results.reading.records import open_run
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.view.foxglove import FoxgloveSession
from cogrip.view.foxglove_layout import NAME, export_layout, layout
from cogrip.view.playback import Playback
from cogrip.view.recording import open_view

from tests.mcap_doctor import diagnose
from tests.view.foxglove_client import ENDED, connected
from tests.view.foxglove_server import serving
from tests.view.recorded_runs import recorded_run

KEYWORDS = {
    "title", "description", "type", "properties", "required", "items", "nullable", "contentEncoding", "additionalProperties",
}  # fmt: skip
LAYOUT = Path(__file__).parents[2] / "configs" / "foxglove-layout.json"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people for a short time, over a link that loses datagrams."""
    return recorded_run(tmp_path_factory.mktemp("runs") / "demo", 0.25)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """People in a scene, whose shapes and poses are recorded."""
    folder = tmp_path_factory.mktemp("lift")
    run_laboratory(msgspec.structs.replace(load(Path("lift")), seconds=0.1), folder)
    return folder


class Judge:
    """Schema that came with messages, made strict: no key but those that it names, and those that no schema has."""

    def __init__(self, schema: dict[str, Any]) -> None:
        Draft202012Validator.check_schema(schema)
        OAS30StrictValidator.check_schema(schema)
        strict = self._closed(schema)
        self._plain = Draft202012Validator(strict, format_checker=FormatChecker())
        self._nullable = OAS30StrictValidator(strict, format_checker=oas30_strict_format_checker)

    def _closed(self, schema: dict[str, Any]) -> dict[str, Any]:
        assert schema.keys() <= KEYWORDS, "a keyword that judges may not know"
        closed = dict(schema)
        if schema["type"] == "object" and "properties" in schema:
            closed["properties"] = {key: self._closed(each) for key, each in schema["properties"].items()}
            closed["properties"] |= {key: {} for key in NOT_SHOWN}
            closed["additionalProperties"] = False
        elif schema["type"] == "array":
            closed["items"] = self._closed(schema["items"])
        return closed

    def wrong(self, message: Any) -> Iterator[str]:
        """Yield what is wrong: by OpenAPI 3.0's rules anything, by plain JSON Schema anything but a null that is told of."""
        yield from (error.message for error in self._nullable.iter_errors(message))
        for error in self._plain.iter_errors(message):
            if not (error.instance is None and error.validator == "type" and error.schema.get("nullable")):
                yield error.message


def judged(channel: str, judges: dict[str, Judge], schema: bytes, message: bytes) -> None:
    if channel not in judges:
        judges[channel] = Judge(json.loads(schema))
    assert [*judges[channel].wrong(json.loads(message))] == [], channel


def test_the_judge_finds_what_is_wrong() -> None:
    judge = Judge({
        "title": "x", "type": "object", "required": ["a"],
        "properties": {"a": {"type": "number"}, "b": {"type": "integer", "nullable": True}},
    })  # fmt: skip
    assert not [*judge.wrong({"a": 1.5, "b": None})]
    for wrong in ({}, {"a": None}, {"a": "1"}, {"a": 1, "b": 1.5}, {"a": 1, "c": 1}):
        assert [*judge.wrong(wrong)], wrong


@pytest.mark.parametrize("folder", ["run", "scene"])
def test_every_message_of_a_session_is_what_its_schema_says(folder: str, request: pytest.FixtureRequest) -> None:
    files = sorted(request.getfixturevalue(folder).glob("*.mcap"))
    assert len(files) > 1
    for path in files:
        judges: dict[str, Judge] = {}
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                assert schema is not None
                assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                judged(channel.topic, judges, schema.data, message.data)
        wanted = {"tick", "datagram_in"} if path.name.startswith("client") else {"step", "scene", "tf", "forces"}
        assert {kind_of(topic) for topic in judges} >= wanted


async def test_every_message_of_the_socket_is_what_its_schema_says(run: Path) -> None:
    view = open_view(run)
    duration_s = view.scene.duration_s or 0.0

    def player() -> FoxgloveSession:
        return FoxgloveSession(view.scene, view.began_ns, Playback(view.frames, view.scene.chunks, duration_s))

    async with serving(player) as address, connected(address) as client:
        judges = {each["topic"]: Judge(json.loads(each["schema"])) for each in client.channels.values()}
        await client.subscribe(*judges)
        await client.socket.send(struct.pack("<BBfBQI", 3, 0, 1.0, 0, 0, 0))  # play
        while not (client.states and client.states[-1].status == ENDED):
            await client.take()
        assert client.data.keys() == judges.keys()
        for topic, messages in client.data.items():
            for _, message in messages:
                assert [*judges[topic].wrong(message)] == [], topic


def test_pictures_are_messages_of_foxglove_s_own_library(scene: Path) -> None:
    messages = pytest.importorskip("foxglove.messages", reason="foxglove-sdk is not installed")

    def built(kind: str, value: dict[str, Any]) -> Any:
        """Return a message as the library has it; it raises TypeError for a field or a type that it does not know."""
        parts = {key: part(key, each) for key, each in value.items()}
        if kind == "SceneEntityDeletion":
            parts["type"] = (messages.SceneEntityDeletionType.MatchingId, messages.SceneEntityDeletionType.All)[
                parts["type"]
            ]
        if kind == "LinePrimitive":
            kinds = messages.LinePrimitiveLineType
            parts["type"] = (kinds.LineStrip, kinds.LineLoop, kinds.LineList)[parts["type"]]
        return getattr(messages, kind)(**parts)

    of = {
        "entities": "SceneEntity", "deletions": "SceneEntityDeletion", "transforms": "FrameTransform",
        "arrows": "ArrowPrimitive", "cubes": "CubePrimitive", "spheres": "SpherePrimitive",
        "cylinders": "CylinderPrimitive", "lines": "LinePrimitive",
        "triangles": "TriangleListPrimitive", "texts": "TextPrimitive", "models": "ModelPrimitive", "metadata": "KeyValuePair",
        "pose": "Pose", "position": "Vector3", "translation": "Vector3", "size": "Vector3", "orientation": "Quaternion",
        "rotation": "Quaternion", "color": "Color", "colors": "Color", "points": "Point3", "timestamp": "Timestamp",
        "lifetime": "Duration",
    }  # fmt: skip

    def part(key: str, value: Any) -> Any:
        if isinstance(value, list):
            return [part(key, each) for each in value]
        return built(of[key], value) if isinstance(value, dict) else value

    counts = dict.fromkeys(("SceneUpdate", "FrameTransforms"), 0)
    with (scene / "server.mcap").open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages():
            assert schema is not None
            kind = schema.name.removeprefix("foxglove.")
            if kind in counts:
                assert built(kind, json.loads(message.data)).encode()
                counts[kind] += 1
    assert min(counts.values()) > 2, counts


def test_files_are_well_by_the_checks_of_the_doctor(run: Path, scene: Path, tmp_path: Path) -> None:
    for path in (*run.glob("*.mcap"), *scene.glob("*.mcap")):
        assert diagnose(path) == [], path.name
    if pytest.importorskip("rosbags", reason="the extra rosbag2 is not installed"):
        export_bag(open_run(run), tmp_path)
        assert diagnose(tmp_path / "rosbag2" / "rosbag2.mcap", checksums=False) == []


def test_the_doctor_finds_what_is_wrong(run: Path, tmp_path: Path) -> None:
    whole, ill = (run / "client-anna.mcap").read_bytes(), tmp_path / "ill.mcap"
    with (run / "client-anna.mcap").open("rb") as file:
        footer = make_reader(file).get_summary()
        assert footer is not None
        statistics = footer.statistics
        chunk = footer.chunk_indexes[0]
    assert statistics is not None
    count = struct.pack("<Q", statistics.message_count)
    at = whole.rindex(count)
    ill.write_bytes(whole[:at] + struct.pack("<Q", statistics.message_count + 1) + whole[at + 8 :])
    assert {"the checksum of the summary is wrong"} < {*diagnose(ill)}
    at = chunk.chunk_start_offset + chunk.chunk_length + 9 + 6  # the first entry of the first message index
    ill.write_bytes(whole[:at] + struct.pack("<Q", 1) + whole[at + 8 :])
    assert any("message index" in each for each in diagnose(ill))
    at = chunk.chunk_start_offset + chunk.chunk_length - 20  # within the packed messages
    ill.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    with pytest.raises((ValueError, zstandard.ZstdError)):
        diagnose(ill)


PATH = re.compile(r"(?P<topic>(/[\w ]+)+)\.(?P<field>\w+)(\[(?P<place>\d+)\]|\.(?P<axis>\w+))?")


def test_every_path_of_the_layout_is_in_a_recording_or_in_the_live_socket(run: Path) -> None:
    whole = json.loads(LAYOUT.read_text(encoding="utf-8"))
    found: dict[str, Any] = {}
    for path in run.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                found[channel.topic] = json.loads(message.data)
    view = open_view(run)
    session = FoxgloveSession(view.scene, 0)
    offered = json.loads(session.opening()[1])["channels"]
    live = {each["topic"]: json.loads(each["schema"]) for each in offered}
    for panel, config in whole["configById"].items():
        for series in config.get("paths", ()):
            match = PATH.fullmatch(series["value"])
            assert match, series["value"]
            topic, field = match["topic"], match["field"]
            assert (topic in found) != (topic in live), topic
            if topic in found:
                value = found[topic][field]
                assert not match["place"] or len(value) > int(match["place"]), series["value"]
            else:
                schema = live[topic]["properties"][field]
                assert not match["axis"] or match["axis"] in schema["properties"], series["value"]
        for topic in config.get("topics", ()):
            assert topic in found or topic in live, topic
        if "topicPath" in config:
            assert config["topicPath"] in found
        assert panel in json.dumps(whole["layout"])
    assert whole["configById"]["3D!scene"]["followTf"] == view.scene.room


def test_panels_have_settings_that_foxglove_s_own_library_knows() -> None:
    layouts = pytest.importorskip("foxglove.layouts", reason="foxglove-sdk is not installed")
    kinds = {"3D": "ThreeDeeConfig", "Plot": "PlotConfig", "StateTransitions": "StateTransitionsConfig"}
    kinds["RawMessages"] = "RawMessagesConfig"
    series = {"Plot": "PlotSeries", "StateTransitions": "StateTransitionsSeries"}
    of_lichtblick = {"foxglovePanelTitle", "sidebarDimension"}  # and of Foxglove's own files
    for panel, config in json.loads(LAYOUT.read_text(encoding="utf-8"))["configById"].items():
        kind = panel.partition("!")[0]
        known = {*getattr(layouts, kinds[kind])()._to_dict()}
        assert config.keys() - of_lichtblick <= known, (panel, config.keys() - known)
        for each in config.get("paths", ()):
            assert each.keys() <= {*getattr(layouts, series[kind])()._to_dict()}, panel


def test_the_layout_that_comes_along_is_that_of_the_demo_and_a_run_gives_its_own(run: Path, tmp_path: Path) -> None:
    assert LAYOUT.read_text(encoding="utf-8") == layout("demo", ["anna", "ben"])
    ((path, _),) = export_layout(open_run(run), tmp_path)
    assert path.name == NAME
    assert path.read_text(encoding="utf-8") == LAYOUT.read_text(encoding="utf-8")
