"""Bodies of a scene in the view: frames, a live session, a recorded run, and the page in a real browser."""

import json
import shutil
from dataclasses import replace
from math import cos, isnan, nan, sin
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.devices.web.messages import FrameError
from cogrip.protocol.drawing import TILE, Shape, pack_points, pack_triangles
from cogrip.protocol.recording.reader import RecordedMessage
from cogrip.protocol.wire.messages import Pose, View
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.view.frames import BODY_BYTES, decode, decode_chunk, encode, encode_chunk
from cogrip.view.page import self_contained
from cogrip.view.recording import ViewError, open_view
from cogrip.view.scene import WORKSPACE_M, PageScene, to_json, turn_of, workspace_of

from tests.extent import long
from tests.recording_files import rewrite
from tests.view.browser_page import BrowserPage, Open, Show
from tests.view.pictured import frame, moving, scene
from tests.view.test_live_scene import Watched

HALF = 0.03
BOX = Shape("box", (HALF,) * 3, 0, rgba=(1.0, 0.2, 0.1, 1.0), object=True)
FLOOR = Shape("plane", (0.0, 0.0, 0.1), place_m=(0.0, 0.0, -0.05))
KINDS = (
    BOX, FLOOR, Shape("sphere", (0.02, 0.0, 0.0), 1, seat=0), Shape("capsule", (0.01, 0.02, 0.0), 2),
    Shape("cylinder", (0.01, 0.02, 0.0), 2, (0.0, 0.0, 0.05)), Shape("ellipsoid", (0.01, 0.02, 0.03), 3),
)  # fmt: skip
HERE: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
TURN = 0.4  # of the box about z, from one edge upright before the camera to another


def drawn_of(shapes: tuple[Shape, ...] = KINDS) -> PageScene:
    return msgspec.structs.replace(scene(), geoms=shapes)


def test_bodies_follow_the_people_and_come_back_bit_for_bit() -> None:
    poses = ((1 / 3, -1e-9, 2.0, 0.5, -0.5, 0.5, 0.5), (0.1,) * 7)
    sent = replace(moving(7), bodies=poses)
    assert decode(encode(sent)).bodies == poses
    assert len(encode(sent)) - len(encode(moving(7))) == 2 * BODY_BYTES
    number, frames = decode_chunk(encode_chunk(3, [sent, sent]), 2, 2)
    assert (number, [each.bodies for each in frames]) == (3, [poses, poses])
    for wrong in (encode(sent)[:-1], encode(sent) + b"\0", encode(sent)[: 96 + 135]):
        with pytest.raises(FrameError):
            decode(wrong)


def test_camera_takes_in_all_bodies_but_nothing_below_the_floor() -> None:
    assert workspace_of((FLOOR,), ()) == (*WORKSPACE_M[:2], (-0.05, 0.1))
    far = (0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    (_, high), _, _ = workspace_of((BOX,), (far,))
    assert high == pytest.approx(0.5 + HALF * 3**0.5)
    assert workspace_of((BOX,), ((nan,) * 7,)) == WORKSPACE_M
    assert workspace_of((BOX,), ()) == WORKSPACE_M
    assert turn_of((BOX,), ((0.0, 0.0, 0.0, 0.6, 0.8, 0.0, 0.0),)) == (0.6, 0.8, 0.0, 0.0)
    assert turn_of((BOX,), ((nan,) * 7,)) == turn_of((), ()) == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.long
def test_a_live_scene_is_drawn_of_its_bodies() -> None:
    places: dict[int, Any] = {}
    settings = msgspec.to_builtins(load(Path("lift"), ["seconds=3"]))
    watched = Watched(**settings).run(
        lambda lab: places.update({lab.room.steps: lab.room.world.drawing.poses().copy()})
    )
    live, world = watched.live, watched.lab.room.world
    assert live is not None
    assert live.scene.geoms == tuple(world.drawing.shapes())
    anchors = [pytest.approx((-world.offset[seat]).tolist()) for seat in (0, 1)]
    assert [person.anchor_m for person in live.scene.people] == anchors
    views = [message for message in watched.messages if isinstance(message, View)]
    with_bodies = [each for each in watched.frames if each.bodies]
    assert len(views) - len(with_bodies) <= 32, "known within half a second"
    for each in with_bodies:  # the poses of a view come before it
        assert np.array(each.bodies) == pytest.approx(places[each.number], abs=1e-7)
    assert with_bodies[-1].orientation == with_bodies[-1].bodies[0][3:]


LIT = """<mujoco><option integrator="Euler"/><worldbody><light pos="0 0 1"/><geom type="plane" size="1 1 .1"/>
<body name="box" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body></worldbody></mujoco>"""
LIT_TOLD = (
    "not drawn of the scene: lights (a view has its own), nor are haze, fog and shadows",
    "the scene sets integrator (euler > discrete), which does not hold: contact that creates no energy is stepped otherwise",
)


@pytest.mark.parametrize("scene", [LIT, ""])
def test_who_looks_at_a_live_scene_is_told_what_is_not_drawn_and_what_was_changed(tmp_path: Path, scene: str) -> None:
    tables: dict[str, Any] = {"seconds": 2.0}
    if scene:
        (tmp_path / "lit.xml").write_text(scene)
        tables["object"] = {"kind": "scene", "file": str(tmp_path / "lit.xml"), "axes": 3}
    live = Watched(**tables).run().live
    assert live is not None
    assert live.scene.note == (" ".join(f"{text[0].upper()}{text[1:]}." for text in LIT_TOLD) if scene else "")


@pytest.fixture(scope="module")
def lift_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "lift"
    folder.mkdir()
    run_laboratory(load(Path("lift"), ["seconds=2.5"]), folder)
    return folder


def test_a_recorded_scene_is_drawn_bit_for_bit_as_recorded(lift_run: Path) -> None:
    view, server = open_view(lift_run), open_run(lift_run).server
    assert server is not None
    (geoms,) = [each.record for each in server.records("geoms")]
    recorded = {each.record.step: each.record.poses for each in server.records("poses")}
    assert view.scene.geoms == geoms.shapes
    _, frames = decode_chunk(view.chunk(0), 2, 3)
    assert len(frames) == len(recorded) == 160, "64 a second"
    for each in frames:
        assert np.array(each.bodies).tobytes() == np.array(recorded[each.number]).tobytes()
        assert each.position_m == pytest.approx(each.bodies[0][:3], abs=0.0)
    last = frames[-1]
    for who, state in zip(view.scene.people, last.people, strict=True):
        tool = next(shape.body for shape in geoms.shapes if shape.seat == who.seat)
        assert tool is not None
        at = [value + away for value, away in zip(state.proxy_m, who.anchor_m, strict=True)]
        assert at == pytest.approx(last.bodies[tool][:3], abs=1e-12), "a proxy is at its tool"
    assert server.columns("poses")["poses"].tobytes() == np.array(list(recorded.values())).tobytes()
    assert verify(server.recording).exact


def is_red(colour: np.ndarray) -> bool:
    red, green, blue = colour
    return bool(red > 1.5 * green and red > 1.5 * blue)


def test_page_draws_a_body_where_it_has_moved_and_turned_to(show: Show) -> None:
    bare = replace(frame(1), people=())
    turned: Pose = (0.05, -0.03, 0.02, cos(TURN), 0.0, 0.0, sin(TURN))
    poses: list[Pose] = [HERE, turned, (-0.06, 0.02, 0.0, 1.0, 0.0, 0.0, 0.0)]
    page, server = show(drawn_of((BOX, FLOOR)))
    page.tab.keyboard.press("3")  # from above
    for number, pose in enumerate(poses):
        server.send(encode(replace(bare, number=number, bodies=(pose,))))
        drawn = page.until_drawn(number)["drawn"]
        assert drawn["object"] is None, "the plain box is left out"
        assert drawn["bodies"][0]["position_m"] == list(pose[:3])
        assert drawn["bodies"][0]["orientation"] == pytest.approx(pose[3:], abs=1e-12)
        picture = page.picture()
        x, y, z, w, _, _, k = pose
        c, s = w * w - k * k, 2 * w * k
        for along, across, inside in ((0.9, 0.9, True), (-0.9, 0.9, True), (1.15, 0.0, False), (1.15, 1.15, False)):
            u, v = along * HALF, across * HALF
            point = (x + c * u - s * v, y + s * u + c * v, z + HALF)
            assert is_red(page.pixel(picture, point)) == inside, (number, along, across)
    server.send(encode(replace(bare, number=9, flags=1, bodies=(HERE,))))
    page.until_drawn(9)
    red, green, blue = page.pixel(page.picture(), (0.0, 0.0, HALF))
    assert green > 0.5 * red > blue, "the object in contact, in the colour of contact"


WEDGE_M = (0.04, 0.03, 0.03)  # half edges of the box around it: a roof along y, its ridge on top
EDGES = [(x, y, -0.03) for x in (-0.04, 0.04) for y in (-0.03, 0.03)] + [(0.0, -0.03, 0.03), (0.0, 0.03, 0.03)]
FACES = ((0, 2, 4), (1, 5, 3), (0, 4, 5), (0, 5, 1), (2, 3, 5), (2, 5, 4), (0, 1, 3), (0, 3, 2))


def wedge(red: float = 1.0) -> tuple[Shape, ...]:
    """Return a roof in two parts, as a surface of more triangles than a shape holds comes."""
    triangles = [[EDGES[corner] for corner in face] for face in FACES]
    parts = [pack_triangles(part, WEDGE_M) for part in (triangles[:3], triangles[3:])]
    return tuple([Shape("mesh", WEDGE_M, 0, rgba=(red, 0.2, 0.1, 1.0), object=True, triangles=part) for part in parts])


def on_wedge(page: BrowserPage, picture: np.ndarray, at: tuple[float, float, float]) -> list[bool]:
    """Return whether points beside the ridge, which the box around holds, and points of the roof are red, from before it."""
    x, y, z = at
    beside = [(sign * 0.036, 0.0, 0.026) for sign in (-1, 1)]
    inside = [(sign * 0.01, 0.0, height) for sign in (-1, 1) for height in (-0.02, 0.0)]
    return [is_red(page.pixel(picture, (x + a, y - 0.03, z + c))) for a, _, c in (*beside, *inside)]


ROOF = [False] * 2 + [True] * 4


def test_page_draws_a_mesh_as_its_surface_where_its_body_is(show: Show) -> None:
    """Live, and in the picture of what another person sees; the box around it would be red beside the ridge."""
    page, server = show(drawn_of(wedge()))
    page.tab.keyboard.press("2")  # from the side
    for number, at in enumerate([(0.0, 0.0, 0.0), (0.03, 0.0, 0.02)]):
        server.send(encode(replace(frame(number), people=(), bodies=((*at, 1.0, 0.0, 0.0, 0.0),))))
        page.until_drawn(number)
        assert on_wedge(page, page.picture(), at) == ROOF
    server.send(encode(replace(frame(5), bodies=(HERE,))))
    page.until_drawn(5)
    assert page.state("cogrip.stats.malformed") == 0


def mesh_scene(folder: Path) -> Path:
    """Write a scene of the wedge as an OBJ file, and settings for one person who moves beside it."""
    lines = ["v " + " ".join(map(str, corner)) for corner in EDGES]
    lines += ["f " + " ".join(str(number + 1) for number in face) for face in FACES]
    (folder / "wedge.obj").write_text("\n".join(lines))
    (folder / "mesh.xml").write_text(
        '<mujoco><asset><mesh name="wedge" file="wedge.obj"/></asset><option gravity="0 0 0"/><worldbody><body name="roof">'
        '<freejoint/><geom type="mesh" mesh="wedge" mass=".2" rgba="1 .2 .1 1"/></body></worldbody></mujoco>'
    )
    (folder / "mesh.toml").write_text(
        'name = "mesh"\n[object]\nkind = "scene"\nfile = "mesh.xml"\naxes = 3\n[[users]]\nname = "anna"\n'
        'tool = "ball"\nhand = "hold"\n'
    )
    return folder / "mesh.toml"


def test_a_recorded_mesh_is_drawn_from_the_recording_alone(open_page: Open, tmp_path: Path) -> None:
    """From a mesh file to the pixels of the page as one file, when neither scene nor mesh is there any more."""
    path, run = mesh_scene(tmp_path), tmp_path / "run"
    run.mkdir()
    run_laboratory(load(path, ["seconds=0.5"]), run)
    live = Watched(**msgspec.to_builtins(load(path, ["seconds=1"]))).run().live
    for file in ("wedge.obj", "mesh.xml", "mesh.toml"):
        (tmp_path / file).unlink()
    view = open_view(run)
    assert live is not None
    assert live.scene.geoms == view.scene.geoms
    assert [shape.kind for shape in view.scene.geoms].count("mesh") == 1
    page_file = tmp_path / "page.html"
    page_file.write_text(self_contained(to_json(view.scene), [view.chunk(0)]), encoding="utf-8")
    page = open_page(page_file.as_uri())
    page.until("cogrip.frame !== null")
    page.tab.keyboard.press("2")  # from the side
    last = view.frames(0)[-1]
    page.state(f"cogrip.seek({last.time_s})")
    page.until_drawn(last.number)
    assert on_wedge(page, page.picture(), (0.0, 0.0, 0.0)) == ROOF


@pytest.mark.parametrize("scheme", [long("light"), "dark"])
def test_page_draws_all_kinds_and_hides_what_is_not_known_or_not_held(show: Show, scheme: str) -> None:
    away = [(0.0, 0.07 * number - 0.1, 0.02, 1.0, 0.0, 0.0, 0.0) for number in range(4)]
    page, server = show(drawn_of(), color_scheme=scheme, width=390, height=844)
    for number, (people, poses, shown) in enumerate(
        [
            (frame(1).people, away, [True] * 4),
            ((), away, [True, False, True, True]),
            (frame(1).people, [*away[:3], (nan,) * 7], [True, True, True, False]),
            (frame(1).people, away[:2], [True, True, False, False]),
        ]
    ):
        server.send(encode(replace(frame(number), people=people, bodies=tuple(poses))))
        bodies = page.until_drawn(number)["drawn"]["bodies"]
        assert [each["visible"] for each in bodies] == shown
    assert page.state("cogrip.stats.malformed") == 0
    assert page.state("document.documentElement.scrollWidth") <= 390


def test_a_recorded_scene_as_one_file(open_page: Open, lift_run: Path, tmp_path: Path) -> None:
    view = open_view(lift_run)
    path = tmp_path / "page.html"
    path.write_text(self_contained(to_json(view.scene), [view.chunk(0)]), encoding="utf-8")
    page = open_page(path.as_uri())
    wanted = view.frames(0)[-1]
    page.until("cogrip.frame !== null")
    page.state(f"cogrip.seek({wanted.time_s})")
    read = page.until_drawn(wanted.number)
    assert [(*each["position_m"], *each["orientation"]) for each in read["bodies"]] == [*map(tuple, wanted.bodies)]
    assert [each["visible"] for each in read["drawn"]["bodies"]] == [True] * 3
    assert not any(isnan(value) for each in wanted.bodies for value in each)


@pytest.mark.long
def test_a_recording_with_impossible_bodies_is_told_or_shown_without_them(lift_run: Path, tmp_path: Path) -> None:
    def spoil(wanted: str, payload: bytes, after: int = 0) -> Path:
        seen = 0

        def alter(kind: str, message: RecordedMessage) -> bytes:
            nonlocal seen
            seen += kind == wanted
            return payload if kind == wanted and seen > after else message.payload

        folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        shutil.copytree(lift_run, folder)
        rewrite(folder / "server.mcap", alter)
        return folder

    shape = {"kind": "box", "size_m": [1, 1, 1], "body": 0, "place_m": [0, 0, 0], "orientation": [1, 0, 0, 0]}
    impossible: list[dict[str, Any]] = [
        {"body": 10**9}, {"size_m": [1]}, {"kind": "cloud"}, {"triangles": "AAAA"}, {"kind": "mesh", "triangles": "AAAA"},
        {"orientation": [1]}, {"rgba": [1, 1]}, {"place_m": None},
    ]  # fmt: skip
    for wrong in impossible:
        geoms = json.dumps({"shapes": [{**shape, **wrong}], "offsets_m": []}).encode()
        with pytest.raises(ViewError, match="does not say what it should"):
            open_view(spoil("geoms", geoms))
    short = open_view(spoil("poses", b'{"step": -1, "poses": [1, null]}', after=10))
    _, frames = decode_chunk(short.chunk(0), 2, 3)
    assert [isnan(each.bodies[0][0]) for each in frames[:20]] == [False] * 10 + [True] * 10
    with pytest.raises(ViewError, match="not what its topic says"):
        open_view(spoil("poses", b'{"step": 4}', after=10)).chunk(0)


def test_a_floor_is_drawn_below_what_is_seen_wherever_its_middle_is(show: Show) -> None:
    floor = Shape("plane", (0.0, 5.0, 0.1), place_m=(3.0, -3.0, -0.05), rgba=(1.0, 0.0, 0.0, 1.0))
    edge = Shape("plane", (0.05, 0.05, 0.1), place_m=(0.0, 0.0, -0.04), rgba=(0.0, 0.0, 1.0, 1.0))
    page, server = show(drawn_of((floor, edge)))
    page.tab.keyboard.press("3")
    server.send(encode(replace(frame(1), people=())))
    page.until_drawn(1)
    picture = page.picture()
    for x, y in ((0.08, 0.08), (-0.08, 0.07), (0.06, -0.08)):
        assert is_red(page.pixel(picture, (x, y, -0.05)))
    red, _, blue = page.pixel(picture, (0.04, -0.03, -0.04))
    assert blue > 2 * red, "no wider than it is"


@pytest.mark.long
def test_a_tool_that_is_taken_elsewhere_is_drawn_where_it_is(tmp_path: Path) -> None:
    """Ben turns the wheel before Anna takes her handle: her own frame is then another one, in recording and view."""
    hand = "crank&radius_m=0.08&phase_rad=0&speed_radps={}&start_s={}&ramp_s=0.2"
    hands = [f"users.{number}.hand={hand.format(*each)}" for number, each in enumerate(((0.5, 5.0), (3.0, 0.1)))]
    settings = load(Path("wheel"), ["seconds=1.6", "task.together=false", *hands])
    run_laboratory(settings, tmp_path, begins=(1024, 0))
    server = open_run(tmp_path).server
    assert server is not None
    assert len(list(server.records("geoms"))) == 2
    assert verify(server.recording).exact
    view = open_view(tmp_path)
    last = view.frames(view.scene.chunks - 1)[-1]
    for body, person, drawn in zip((1, 2), view.scene.people, last.people, strict=True):
        shown = np.array(drawn.proxy_m) + person.anchor_m
        assert shown == pytest.approx(last.bodies[body][:3], abs=1e-9)
    assert abs(last.bodies[1][1]) > 0.01


def test_page_draws_a_flex_a_tendon_and_a_tile_where_they_are(show: Show) -> None:
    """A square of two faces and a round line whose points move, over a floor whose tile is red at its upper left alone."""
    tile = np.zeros((TILE, TILE, 3), dtype=np.uint8)
    tile[: TILE // 2, : TILE // 2] = (230, 20, 20)
    floor = Shape(
        "plane", (0.1, 0.1, 0.0), place_m=(0.0, 0.0, -0.05), rgba=(0.3, 0.3, 0.3, 1.0), colours=tile.tobytes(),
        period_m=(0.2, 0.2),
    )  # fmt: skip
    flex = Shape("flex", (0.0, 0.0, 0.0), rgba=(0.9, 0.1, 0.1, 1.0), points=pack_points([0, 1, 2, 2, 3, 0]))
    tendon = Shape("tendon", (0.01, 0.0, 0.0), rgba=(0.9, 0.1, 0.1, 1.0), points=pack_points([4, 5]))
    page, server = show(drawn_of((floor, flex, tendon)))
    page.tab.keyboard.press("3")  # from above
    for number, x in enumerate((0.04, 0.06)):
        corners = [(x, 0.02), (x + 0.02, 0.02), (x + 0.02, 0.04), (x, 0.04), (x, -0.05), (x, -0.02)]
        poses: tuple[Pose, ...] = tuple([(u, v, 0.0, 1.0, 0.0, 0.0, 0.0) for u, v in corners])
        server.send(encode(replace(frame(1), people=(), number=number, bodies=poses)))
        page.until_drawn(number)
        picture = page.picture()
        for point, inside in (
            ((x + 0.01, 0.03, 0.0), True), ((x + 0.025, 0.03, 0.0), False), ((x, -0.035, 0.01), True),
            ((x + 0.015, -0.035, 0.0), False), ((-0.05, 0.05, -0.05), True), ((-0.05, -0.05, -0.05), False),
            ((0.03, 0.08, -0.05), False),
        ):  # fmt: skip
            assert is_red(page.pixel(picture, point)) == inside, (number, point)
