"""Bodies of a scene for the 3D panels of Foxglove and Lichtblick: live, recorded, and in the recording itself."""

import json
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.drawing import Shape, pack_points, pack_triangles
from cogrip.protocol.recording.records import kind_of
from cogrip.protocol.recording.scene_messages import SCHEMAS
from cogrip.results.reading.records import open_run
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.view import pictures

from tests.foxglove_schemas import PUBLISHED, check_schema, check_value
from tests.view.pictured import frame, scene

UP = (0.5**0.5, 0.5**0.5, 0.0, 0.0)  # takes z to -y
CORNER = (0.01, 0.02, 0.03)
CORNERS = (CORNER, (-0.01, 0.02, 0.03), (-0.01, -0.02, -0.03))
SHAPES = (
    Shape("plane", (0.0, 1.0, 0.1), place_m=(0.0, 0.0, -0.05)),
    Shape("box", (0.01, 0.02, 0.03), 0, rgba=(1.0, 0.0, 0.0, 0.5), object=True),
    Shape("capsule", (0.01, 0.02, 0.0), 0, (0.0, 0.0, 0.1), UP),
    Shape("cylinder", (0.01, 0.02, 0.0), 1),
    Shape("ellipsoid", (0.01, 0.02, 0.03), 1),
    Shape("sphere", (0.02, 0.0, 0.0), 2, seat=0),
    Shape("sphere", (0.02, 0.0, 0.0), 3, seat=7),
    Shape("mesh", CORNER, 0, (0.0, 0.1, 0.0), UP, triangles=pack_triangles([CORNERS], CORNER)),
)


def read(payload: bytes, schema: str) -> Any:
    value = json.loads(payload)
    check_value(value, PUBLISHED[schema])
    return value


def test_every_shape_is_a_primitive_of_its_size() -> None:
    told = msgspec.structs.replace(scene(), geoms=SHAPES)
    turned = (0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5)
    sent = replace(frame(1), bodies=(turned, (nan,) * 7, turned, turned))
    update = read(pictures.scene(told, pictures.drawn(told, sent), 5), "foxglove.SceneUpdate")
    entities = {each["id"]: each for each in update["entities"]}
    assert not {"demo/object", "demo/anna/seen", "demo/body/1", "demo/body/3"} & entities.keys()
    (floor,) = entities["demo"]["cubes"]
    assert floor["size"] == {"x": 2.0, "y": 2.0, "z": 0.001}
    body = entities["demo/body/0"]
    assert body["cubes"][0]["size"] == {"x": 0.02, "y": 0.04, "z": 0.06}
    assert body["cubes"][0]["color"] == {"r": 1.0, "g": 0.0, "b": 0.0, "a": 0.5}
    assert body["cylinders"][0]["size"] == {"x": 0.02, "y": 0.02, "z": 0.04}
    ends = [each["pose"]["position"] for each in body["spheres"]]
    assert [(each["x"], each["y"], each["z"]) for each in ends] == [(0.0, 0.02, 0.1), (0.0, -0.02, 0.1)]
    (surface,) = body["triangles"]
    assert [(each["x"], each["y"], each["z"]) for each in surface["points"]] == [
        pytest.approx(each) for each in CORNERS
    ]
    assert surface["pose"]["position"] == {"x": 0.0, "y": 0.1, "z": 0.0}
    assert entities["demo/body/2"]["spheres"][0]["color"]["b"] > 0.6, "anna's blue"
    transforms = read(pictures.transforms(told, sent, 5), "foxglove.FrameTransforms")["transforms"]
    (place,) = [each for each in transforms if each["child_frame_id"] == "demo/body/0"]
    assert place["translation"] == {"x": 0.1, "y": 0.2, "z": 0.3}
    assert place["rotation"] == {"w": 0.5, "x": -0.5, "y": 0.5, "z": 0.5}
    whole = msgspec.structs.replace(told, geoms=SHAPES[3:5])
    update = read(pictures.scene(whole, frozenset({"demo/body/1"}), 5), "foxglove.SceneUpdate")
    (entity,) = update["entities"]
    assert entity["cylinders"][0]["size"] == {"x": 0.02, "y": 0.02, "z": 0.04}
    assert entity["spheres"][0]["size"] == {"x": 0.02, "y": 0.04, "z": 0.06}
    check_schema(json.loads(SCHEMAS["foxglove.SceneUpdate"]), PUBLISHED["foxglove.SceneUpdate"])


def test_a_recording_of_a_lift_holds_its_bodies_and_proxies_at_their_tools(tmp_path: Path) -> None:
    run_laboratory(load(Path("lift"), ["seconds=1.5"]), tmp_path)
    server = open_run(tmp_path).server
    assert server is not None
    poses = [each.record.poses for each in server.records("poses")]
    topics = server.recording.topics
    found: dict[str, list[Any]] = {"scene": [], "tf": []}
    for message in server.recording.messages():
        if (kind := kind_of(topics[message.topic])) in found:
            found[kind].append(
                read(message.payload, f"foxglove.{'SceneUpdate' if kind == 'scene' else 'FrameTransforms'}")
            )
    last = {each["id"]: each for each in found["scene"][-1]["entities"]}
    assert {"lift", "lift/body/0", "lift/body/1", "lift/body/2"} <= last.keys()
    assert "lift/object" not in last
    moved = [each["transforms"] for each in found["tf"] if each["transforms"][0]["child_frame_id"] == "lift/body/0"]
    assert len(moved) == len(poses) / 2
    for transforms, row in zip(moved, poses[::2], strict=True):
        for number, each in enumerate(transforms):
            place, turned = each["translation"], each["rotation"]
            assert (place["x"], place["y"], place["z"]) == pytest.approx(row[7 * number : 7 * number + 3], abs=1e-7)
            whole = (turned["w"], turned["x"], turned["y"], turned["z"])
            assert whole == pytest.approx(row[7 * number + 3 : 7 * number + 7], abs=1e-7)
    places = {each["child_frame_id"]: each["translation"] for each in found["tf"][-1]["transforms"]}
    places |= {each["child_frame_id"]: each["translation"] for each in found["tf"][-2]["transforms"]}
    assert places["lift/anna/proxy"]["x"] == pytest.approx(places["lift/body/1"]["x"], abs=5e-3), "a step or two apart"


def test_what_is_flexible_follows_every_frame() -> None:
    """Faces of a flex and the path of a tendon between places of bodies, which have no frames of their own."""
    flex = Shape("flex", (0.0, 0.0, 0.0), rgba=(0.0, 0.0, 1.0, 1.0), points=pack_points([1, 2, 3, 3, 2, 4]))
    tendon = Shape("tendon", (0.002, 0.0, 0.0), points=pack_points([4, 1, 1]))
    told = msgspec.structs.replace(scene(), geoms=(SHAPES[1], flex, tendon))
    poses = tuple([(0.1 * body, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0) for body in range(5)])
    sent = replace(frame(1), bodies=poses)
    update = read(pictures.forces(told, sent, 5), "foxglove.SceneUpdate")
    (soft,) = [each for each in update["entities"] if each["id"] == "soft"]
    (faces,), (path,) = soft["triangles"], soft["lines"]
    assert [each["x"] for each in faces["points"]] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert faces["indices"] == [0, 1, 2, 2, 1, 3]
    assert [path["points"][number]["x"] for number in path["indices"]] == pytest.approx([0.4, 0.1, 0.1])
    assert (path["thickness"], path["scale_invariant"], path["type"]) == (0.004, False, 0)
    update = read(pictures.scene(told, pictures.drawn(told, sent), 5), "foxglove.SceneUpdate")
    assert "demo/body/1" not in {each["id"] for each in update["entities"]}
    places = read(pictures.transforms(told, sent, 5), "foxglove.FrameTransforms")
    frames = {each["child_frame_id"] for each in places["transforms"]}
    assert {each for each in frames if "/body/" in each} == {"demo/body/0"}
    lost = replace(sent, bodies=(*poses[:4], (nan,) * 7))
    update = read(pictures.forces(told, lost, 5), "foxglove.SceneUpdate")
    assert "soft" not in {each["id"] for each in update["entities"]}
