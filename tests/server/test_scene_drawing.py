"""Shapes of scenes: surfaces, points of what is flexible, textures, against the model itself."""

from collections.abc import Sequence
from pathlib import Path

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

from cogrip.protocol.drawing import MOST_SHAPES, TILE, Shape
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES, Geom, decode, encode
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_shapes import shapes_of
from cogrip.server.worlds.scenes.scene_surfaces import MOST_SCENE_TRIANGLES

from tests.server.scene_worlds import hold, world_of
from tests.view.drawn_scenes import SCENES


def world_named(folder: Path, name: str) -> SceneWorld:
    path = folder / "scene.xml"
    path.write_text(SCENES[name])
    return hold(world_of(path, ("ball",)))


def of_kind(shapes: Sequence[Shape], kind: str) -> list[Shape]:
    return [shape for shape in shapes if shape.kind == kind]


def places(world: SceneWorld, shape: Shape) -> np.ndarray:
    """Return where the points of a shape are in the scene's own frame."""
    found: np.ndarray = world.drawing.poses()[list(shape.bodies), :3] + world.object.start
    return found


@pytest.mark.sample(11)
@pytest.mark.parametrize("name", SCENES)
def test_every_shape_of_every_scene_fits_a_datagram_and_comes_back(tmp_path: Path, name: str) -> None:
    shapes = world_named(tmp_path, name).drawing.shapes()
    for number in range(len(shapes)):
        message = encode(Geom.of(shapes, number, 2**63 - 1))
        assert len(message) <= MAX_MESSAGE_BYTES
        told = decode(message)
        assert isinstance(told, Geom)
        assert told.shape == shapes[number]


@pytest.mark.parametrize("name", ["cloth", "jelly", "rope"])
def test_points_of_a_flexible_body_are_its_vertices_as_it_moves(tmp_path: Path, name: str) -> None:
    world = world_named(tmp_path, name)
    for _ in range(20):
        world.data.qvel[:] += 0.01 * np.random.default_rng(1).normal(size=world.scene.model.nv)
        world.step(np.zeros((1, 3)))
    soft = [shape for shape in world.drawing.shapes() if shape.soft]
    first = min(number for shape in soft for number in shape.bodies)
    vertices = world.data.flexvert_xpos
    assert np.ptp(vertices - world_named(tmp_path, name).data.flexvert_xpos) > 1e-5, "it has moved"
    corners = {number for shape in soft for number in shape.bodies}
    for shape in soft:
        assert places(world, shape) == pytest.approx(vertices[np.array(shape.bodies) - first], abs=1e-12)
    faces = sum(len(shape.bodies) for shape in of_kind(soft, "flex")) // 3
    assert (faces, len(corners)) == {"cloth": (128, 81), "jelly": (6 * 32, 98), "rope": (0, 12)}[name]


def test_points_of_a_tendon_are_its_path_also_when_it_leaves_what_it_went_round(tmp_path: Path) -> None:
    world = world_named(tmp_path, "tendon")
    (tendon,) = of_kind(world.drawing.shapes(), "tendon")
    assert tendon.size_m[0] == 0.005
    assert len(tendon.bodies) == 4, "two sites, and two points on the post"
    counts = []
    for height_m in (0.0, 0.3):
        world.data.qpos[world.scene.model.jnt_qposadr[0]] = height_m
        mujoco.mj_forward(world.scene.model, world.data)
        count = int(world.data.ten_wrapnum[0])
        counts.append(count)
        path = world.data.wrap_xpos.reshape(-1, 3)[:count]
        found = places(world, tendon)
        assert found[:count] == pytest.approx(path, abs=1e-12)
        assert (found[count:] == found[count - 1]).all(), "what it does not need lies at its end"
        lengths = np.linalg.norm(np.diff(found, axis=0), axis=1).sum()
        assert lengths == pytest.approx(world.data.ten_length[0], rel=0.02), "the arc is drawn straight"
    assert counts == [4, 2]


def test_a_height_field_is_drawn_through_its_heights(tmp_path: Path) -> None:
    world = world_named(tmp_path, "height field")
    model = world.scene.model
    (x_m, y_m, top_m, base_m), parts = model.hfield_size[0], of_kind(world.drawing.shapes(), "mesh")
    corners = np.array([np.array(part.place_m) + corner for part in parts for corner in part.corners_m()])
    corners += world.object.start
    heights = top_m * model.hfield_data.reshape(40, 40)
    upper = corners[corners[:, 2] > -base_m + 1e-4]
    columns, rows = (np.round((1 + upper[:, axis] / half) / 2 * 39).astype(int) for axis, half in ((0, x_m), (1, y_m)))
    assert upper[:, 2] == pytest.approx(heights[rows, columns], abs=1e-5)
    assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) == 1600
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert low == pytest.approx([-x_m, -y_m, -base_m], abs=1e-6)
    assert high == pytest.approx([x_m, y_m, heights.max()], abs=1e-5)


def test_a_large_height_field_is_drawn_by_its_share(tmp_path: Path) -> None:
    asset = '<hfield name="hill" nrow="300" ncol="300" size=".1 .08 .05 .01"/>'
    path = tmp_path / "scene.xml"
    path.write_text(
        f"<mujoco><asset>{asset}</asset><worldbody><geom name='far' type='hfield' hfield='hill'/></worldbody></mujoco>"
    )
    world = world_of(path, ("ball",))
    drawn = shapes_of(world.scene, np.zeros(3))
    count = sum(len(shape.corners_m()) // 3 for shape in drawn.shapes)
    assert 0.8 * MOST_SCENE_TRIANGLES < count <= MOST_SCENE_TRIANGLES
    assert drawn.coarser == ("far",)


def test_what_has_more_points_than_there_is_room_for_is_left_out_by_name(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    cloth = '<flexcomp name="cloth" type="grid" dim="2" count="33 32 1" rigid="true">{}</flexcomp>'.format(
        '<contact contype="0" conaffinity="0"/>'
    )
    path.write_text(f"<mujoco><worldbody>{cloth}</worldbody></mujoco>")
    drawn = shapes_of(world_of(path, ("ball",)).scene, np.zeros(3))
    assert not [shape for shape in drawn.shapes if shape.soft]
    assert MOST_SHAPES < 33 * 32
    assert drawn.left_out[-1] == "flex cloth (1056 points)"


def test_a_checker_is_a_tile_of_its_colours_in_their_places(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    check = '<texture name="c" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="64" height="64"/>'
    material = '<material name="c" texture="c" texrepeat="4 2" rgba="1 1 1 .5"/>'
    floors = (
        '<geom type="plane" size=".2 .1 .1" material="c"/><geom type="plane" size="0 0 .1" pos="0 0 -1" material="c"/>'
    )
    path.write_text(f"<mujoco><asset>{check}{material}</asset><worldbody>{floors}</worldbody></mujoco>")
    floor, endless = of_kind(world_of(path, ("ball",)).drawing.shapes(), "plane")
    assert (floor.period_m, endless.period_m) == ((0.1, 0.1), (0.5, 1.0))
    cells = np.array(floor.triangle_colours()).reshape(TILE, TILE, 3)
    half = TILE // 2
    for rows, columns, rgb in ((0, 0, (1, 0, 0)), (0, half, (0, 0, 1)), (half, 0, (0, 0, 1)), (half, half, (1, 0, 0))):
        assert (cells[rows : rows + half, columns : columns + half] == rgb).all()
    assert floor.rgba == pytest.approx((0.5, 0.0, 0.5, 0.5)), "for who draws no textures"


def test_one_image_is_on_all_sides_of_a_cube(tmp_path: Path) -> None:
    """As MuJoCo has it of a square image: left to right on each side, as seen from outside with y up."""
    check = '<texture name="c" type="cube" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="8" height="{}"/>'
    path = tmp_path / "scene.xml"
    colours = []
    for height in (8, 48):
        material = '<material name="c" texture="c"/>'
        box = '<geom type="box" size=".1 .1 .1" material="c"/>'
        path.write_text(f"<mujoco><asset>{check.format(height)}{material}</asset><worldbody>{box}</worldbody></mujoco>")
        parts = of_kind(world_of(path, ("ball",)).drawing.shapes(), "mesh")
        colours.append([rgb for part in parts for rgb in part.triangle_colours()])
    assert colours[0] == colours[1]
    assert {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)} <= set(colours[0])


def test_what_is_not_drawn_is_named(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    sky = '<texture type="skybox" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="8" height="8"/>'
    shiny = '<material name="shiny" reflectance=".5"/>'
    world = '<light pos="0 0 1"/><geom type="box" size=".1 .1 .1" material="shiny"/><site group="4"/><site size=".01"/>'
    path.write_text(f"<mujoco><asset>{sky}{shiny}</asset><worldbody>{world}</worldbody></mujoco>")
    told = world_of(path, ("ball",)).drawing.left_out()
    assert [words.split(" (")[0] for words in told[:3]] == ["lights", "the skybox", "reflections"]
    assert told[3].startswith("1 geoms and sites of the groups 3 to 5")
    assert len(told) == 4
    path.write_text(SCENES["box"])
    assert world_of(path, ("ball",)).drawing.left_out() == ()


def test_a_geom_has_its_own_colour_before_that_of_its_material(tmp_path: Path) -> None:
    boxes = of_kind(world_named(tmp_path, "material").drawing.shapes(), "box")
    assert [box.rgba for box in boxes] == [pytest.approx((0.9, 0.1, 0.2, 1.0)), pytest.approx((0.1, 0.8, 0.3, 1.0))]


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "box", "points": b"\0\0"},
        {"kind": "flex", "points": bytes(4)},
        {"kind": "tendon", "points": bytes(2)},
        {"kind": "tendon", "points": bytes(3)},
        {"kind": "tendon", "points": b"\0\4\0\0"},
        {"kind": "flex", "points": bytes(6 * 166)},
        {"kind": "mesh", "triangles": bytes(18), "colours": bytes(6)},
        {"kind": "mesh", "triangles": bytes(18 * 48), "colours": bytes(3 * 48)},
        {"kind": "plane", "colours": bytes(972)},
        {"kind": "plane", "period_m": (1.0, 1.0)},
        {"kind": "plane", "colours": bytes(972), "period_m": (1.0, 0.0)},
        {"kind": "plane", "colours": bytes(969), "period_m": (1.0, 1.0)},
        {"kind": "mesh", "triangles": bytes(18), "colours": bytes(3), "period_m": (1.0, 1.0)},
    ],
)
def test_a_shape_that_is_none_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"bytes of|repeats after"):
        Shape(**{"size_m": (0.1, 0.1, 0.1), **wrong})  # type: ignore[arg-type]
