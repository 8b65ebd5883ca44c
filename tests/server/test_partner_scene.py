"""The server's scene with models of hands: what it refuses, what clients are told of it, and that both move alike."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cogrip.client.coupling.partner.scene_copy import SceneCopy
from cogrip.protocol.laws.partner_model import Model, ToolDrive
from cogrip.protocol.laws.rotations import log
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.schemes import make_scene_world
from cogrip.server.worlds.scenes.copied_geometry import unfit_copy
from cogrip.server.worlds.scenes.partner_scene import PartnersScene
from cogrip.server.worlds.scenes.scene_text import SceneError

from tests.server.scene_worlds import SCENES

K, B = 1000.0, 10.0
BODY = '<body name="box" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/>{}</body>'
SLIDES = "".join(f"<joint type='slide' axis='{axis}'/>" for axis in ("1 0 0", "0 1 0", "0 0 1"))
TOOL = f'<body name="own" pos="-.2 0 .03" gravcomp="{{}}">{SLIDES}<geom size=".01" mass=".05"/></body>'
FLOOR = '<geom name="floor" type="plane" size="1 1 .1"/>'


def world_of(path: Path, tool: str = "", substeps: int = 4) -> PartnersScene:
    settings = resolve({
        "object": {"kind": "scene", "file": str(path), "axes": 3, "substeps": substeps},
        "coupling": {"kind": "partner", "stiffness_npm": K, "damping_nspm": B},
        "users": [{"name": "a", "side": "left", "tool": tool}, {"name": "b", "side": "right"}],
    })  # fmt: skip
    world = make_scene_world(settings, [seat_settings(settings, number) for number in range(2)])
    assert isinstance(world, PartnersScene)
    return world


def scene(folder: Path, inside: str, outside: str = "") -> Path:
    path = folder / "x.xml"
    path.write_text(f"<mujoco>{outside}<worldbody>{inside}</worldbody></mujoco>")
    return path


def rows(world: PartnersScene, *intended_m: tuple[float, float, float], stiffness_npm: float = 300.0) -> np.ndarray:
    """Return the inputs of hands that intend these places, told now, and have given nothing."""
    told = np.zeros((2, 6, 3))
    told[:, 0] = told[:, 1] = intended_m
    told[:, 3] = stiffness_npm
    return told.reshape(2, -1)


@pytest.mark.parametrize(
    ("inside", "outside", "tool", "why"),
    [
        (FLOOR, "", "", "no free body"),
        (BODY.format("") + BODY.format("").replace("box", "ball", 1).replace("0 0 .03", "0 .3 .03", 1), "", "", "'ball' moves"),
        (BODY.format('<body name="lid"><joint/><geom size=".01"/></body>'), "", "", "'lid' moves as well"),
        (BODY.format("") + TOOL.format("0"), "", "own", "weighs something"),
        (
            BODY.format("") + '<body name="own" pos="-.2 0 .03" gravcomp="1"><freejoint/><geom size=".01"/></body>', "", "own",
            "turns",
        ),
        (BODY.format("") + TOOL.format("1").replace("'0 0 1'/", "'0 0 1' damping='1'/"), "", "own", "dampers"),
        (BODY.format("") + TOOL.format("1").replace("'0 0 1'/", "'0 0 1' limited='true' range='-1 1'/"), "", "own", "limits"),
        (BODY.format(""), '<option density="1.2"/>', "", "floats"),
        (BODY.format(""), '<option><flag gravity="disable"/></option>', "", "flags"),
        (BODY.format("").replace("mass", 'solref=".01 1" mass'), "", "", "contact of its own (geom solref)"),
        (BODY.format("").replace("mass", 'priority="1" mass'), "", "", "gap or priority"),
        (BODY.format("").replace("mass", 'condim="1" mass'), "", "", "contact of its own"),
        (BODY.format("".join(f'<geom size=".001" pos="0 0 {each / 1e3}"/>' for each in range(40))), "", "", "32 at most"),
        (
            BODY.format(""), '<equality><weld body1="box" body2="world" active="false"/></equality>', "", "equalities",
        ),
    ],
)  # fmt: skip
def test_a_scene_of_which_clients_make_no_copy_is_refused_in_one_line(
    inside: str, outside: str, tool: str, why: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError) as refused:
        world_of(scene(tmp_path, inside, outside), tool)
    text = str(refused.value)
    assert why in text
    assert text.endswith('set coupling.kind = "wave"')
    assert "\n" not in text


@pytest.mark.parametrize(
    ("inside", "tool"),
    [
        (FLOOR + BODY.format(""), ""),
        (FLOOR + BODY.format("") + TOOL.format("1"), "own"),
        (BODY.format('<geom type="capsule" size=".01 .02" pos=".01 0 .05" euler="30 0 0" friction=".5"/>'), ""),
        (FLOOR + '<body pos="1 0 0" euler="0 0 40"><geom type="cylinder" size=".1 .1"/></body>' + BODY.format(""), ""),
    ],
)
def test_each_client_is_told_what_the_scene_is(inside: str, tool: str, tmp_path: Path) -> None:
    world = world_of(scene(tmp_path, inside, '<option gravity="0 .1 -5"/>'), tool)
    assert not unfit_copy(world.scene)
    model = world.scene.model
    for seat in range(2):
        shapes = world.drawing.local_shapes(seat)
        copy = SceneCopy(shapes, seat, 1 / 1024)
        told = copy._model
        assert told.opt.gravity == pytest.approx(model.opt.gravity)
        assert told.ngeom == model.ngeom
        own, theirs = told.body("object").id, world.scene.object
        for key in ("body_mass", "body_inertia", "body_ipos"):
            assert getattr(told, key)[own] == pytest.approx(getattr(model, key)[theirs]), key
        assert abs(np.dot(told.body_iquat[own], model.body_iquat[theirs])) == pytest.approx(1.0)
        for number, tool_of in enumerate(world.scene.tools):
            assert told.body_mass[told.body(f"tool {number}").id] == pytest.approx(model.body_mass[tool_of.body])
        assert sorted(told.geom_friction[:, 0]) == pytest.approx(sorted(model.geom_friction[:, 0]))
        assert np.array_equal(np.unique(told.geom_solref, axis=0), np.unique(model.geom_solref, axis=0))


def test_scene_and_copy_move_alike() -> None:
    """With the hands known to both at all times, and the same steps, the copy of each is the server's scene."""
    world = world_of(SCENES / "lift.xml", substeps=8)
    for user in range(2):
        world.join(user, np.zeros(3))
    copies = [SceneCopy(world.drawing.local_shapes(seat), seat, world.frame_s / 8) for seat in range(2)]
    models = [[Model((0.0, 0.0, 0.0)) for _ in range(2)] for _ in range(2)]
    for seat, copy in enumerate(copies):
        copy.tell(world.position + world.offset[seat], (0.0,) * 3, world.orientation)
        copy.begin((0.0,) * 3)
        copy._aim = None  # it goes its own way
        for user, model in enumerate(models[seat]):
            model.place_m = (world.offset[seat] - world.offset[user]).tolist()
    answers = np.zeros((2, 12))
    for frame in range(384):
        press, up = min(1.0, frame / 128) * 0.06, 0.04 * min(1.0, max(0.0, (frame - 192) / 128))
        aims = ((press, 0.0, up), (-press, 0.0, up))
        answers = world.step(rows(world, *aims))
        for seat, copy in enumerate(copies):
            for user, model in enumerate(models[seat]):
                model.intention_m = (np.array(aims[user]) + world.offset[seat] - world.offset[user]).tolist()
                model.stiffness_npm = 300.0
            for _ in range(8):
                hand = models[seat][seat]
                own = copy._tools[seat]
                # One's own hand is a model here, too, so that both have the same motion of it.
                drive = ToolDrive(world.frame_s / 8, (K, B), hand, copy._data.qpos[own.places].tolist())
                drive.end(copy._data.qvel[own.dofs].tolist())
                copy.step(hand.place_m, hand.velocity_mps, (K, B), {1 - seat: models[seat][1 - seat]})
    assert world.position[2] > 0.035
    for seat, copy in enumerate(copies):
        assert copy.object_m == pytest.approx(world.position + world.offset[seat], abs=5e-4)
        assert answers[seat, :3] == pytest.approx(world.position + world.offset[seat])
        assert answers[seat, 3:6] == pytest.approx(log(world.orientation.tolist()))


def test_hands_press_with_what_their_springs_in_series_give() -> None:
    world = world_of(SCENES / "lift.xml")
    for user in range(2):
        world.join(user, np.zeros(3))
    for _ in range(256):
        world.step(rows(world, (0.06, 0.0, 0.0), (-0.06, 0.0, 0.0)))
    gap_m = 0.044  # between each tool's start and the box
    force = (0.06 - gap_m) / (1.0 / 300.0 + 1.0 / K)
    assert world.force[:, 0] == pytest.approx((force, -force), rel=0.01)
    assert np.abs(world.force[:, 1:]).max() < 1e-6
    stretch = world.hand[:, 0] - world.tools()[0][:, 0]
    assert world.force[:, 0] == pytest.approx(K * stretch, abs=1e-6)
    assert 300.0 * (0.06 - world.hand[0, 0]) == pytest.approx(world.force[0, 0], abs=1e-3), "at rest"


def test_a_saved_scene_goes_on_as_the_one_that_was_saved() -> None:
    world, other = (world_of(SCENES / "lift.xml") for _ in range(2))
    for user in range(2):
        world.join(user, np.zeros(3))
    for _ in range(96):
        world.step(rows(world, (0.06, 0.0, 0.01), (-0.05, 0.0, 0.0)))
    other.restore(world.save())
    for _ in range(64):
        one, two = (each.step(rows(each, (0.06, 0.0, 0.03), (-0.06, 0.0, 0.03))) for each in (world, other))
        assert np.array_equal(one, two)


def test_who_leaves_lets_go_and_the_others_are_told_of_nobody() -> None:
    world = world_of(SCENES / "lift.xml")
    for user in range(2):
        world.join(user, np.zeros(3))
    for _ in range(256):
        world.step(rows(world, (0.06, 0.0, 0.0), (-0.06, 0.0, 0.0)))
    world.leave(1)
    seen = [world.step(rows(world, (0.06, 0.0, 0.0), (-0.06, 0.0, 0.0)))[0] for _ in range(128)]
    assert not world.force[1].any()
    assert all(not row[12 + 15 + 3 :].any() for row in seen)
    assert world.position[0] > 0.005, "the one who stays pushes the box"
    assert max(abs(a[0] - b[0]) for a, b in pairwise(seen)) < 0.01
