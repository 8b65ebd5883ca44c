"""Added tools begin in the free, near what they are to press, whatever stands in a scene."""

from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cogrip.server.worlds.scenes.scene_file import Held, Scene, load_scene, make_scene
from cogrip.server.worlds.scenes.scene_places import CLEAR_M, FREE_M, NEAR_M
from cogrip.server.worlds.scenes.scene_text import SceneError

SCENES = Path(__file__).parents[2] / "configs" / "scenes"
STEP_S = 1.0 / 512.0
FLOOR = '<geom name="floor" type="plane" size="1 1 .1"/>'
HINGED = '<body name="{name}" pos="{pos}"><joint type="hinge" axis="0 {axis}" damping=".02"/>{geom}</body>'
DOOR = HINGED.format(
    name="it", pos="0 .05 0", axis="0 1", geom='<geom type="box" size=".005 .06 .08" pos="0 -.06 .081" mass=".2"/>'
)
LEVER = HINGED.format(
    name="it", pos=".05 0 .12", axis="1 0", geom='<geom type="capsule" fromto="0 0 0 0 0 .1" size=".01" mass=".1"/>'
)
THINGS = {
    "a door on a floor": FLOOR + DOOR,
    "a lever on a plinth": '<geom type="box" size=".2 .2 .1"/>' + LEVER,
    "a crate of a metre": FLOOR
    + '<body name="it" pos="0 0 .5"><freejoint/><geom type="box" size=".5 .5 .5" mass="5"/></body>',
    "a drawer on a floor": FLOOR
    + '<body name="it" pos="0 0 .05"><joint type="slide" axis="1 0 0"/><geom type="box" size=".05 .1 .04" mass=".5"/></body>',
    "a ball in a corner": FLOOR
    + '<geom type="box" size=".01 1 1" pos="-.06 0 0"/>'
    + '<body name="it" pos="0 0 .03"><freejoint/><geom size=".03" mass=".1"/></body>',
}
KINDS = ("pad", "ball", "box")


def scene_of(things: str, *tools: str, sides: tuple[str, ...] = ("left", "right")) -> Scene:
    held = [Held(tool, side, "") for tool, side in zip(tools, sides, strict=True)]  # type: ignore[arg-type]
    return make_scene(f"<mujoco><worldbody>{things}</worldbody></mujoco>", held, STEP_S)


def distances_m(scene: Scene, seat: int, target: str = "it") -> tuple[float, float]:
    """Return how far a tool is from anything else, and from its target, as MuJoCo measures it."""
    model, data = scene.model, mujoco.MjData(scene.model)
    mujoco.mj_forward(model, data)
    tool = scene.tools[seat].body
    mine = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == tool]
    rest = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] != tool]
    aims = [geom for geom in rest if model.body(model.geom_bodyid[geom]).name == target]
    least = [
        min(mujoco.mj_geomDistance(model, data, one, other, 1e3, None) for one, other in product(mine, others))
        for others in (rest, aims)
    ]
    return least[0], least[1]


@pytest.mark.sample(8)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("things", THINGS)
def test_tools_begin_in_the_free_and_near_what_they_press(things: str, kind: str) -> None:
    scene = scene_of(THINGS[things], kind, kind)
    for seat in (0, 1):
        least_m, to_target_m = distances_m(scene, seat)
        assert least_m >= FREE_M
        assert to_target_m <= NEAR_M
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    tools = {tool.body for tool in scene.tools}
    near = [contact.dist for contact in data.contact if tools & set(scene.model.geom_bodyid[contact.geom])]
    assert all(dist_m >= FREE_M for dist_m in near), "within the margin of a contact at most"


def test_a_moved_tool_is_as_near_as_stated() -> None:
    assert distances_m(scene_of(THINGS["a crate of a metre"], "ball", "ball"), 0)[1] == pytest.approx(CLEAR_M, abs=1e-3)


def test_four_people_at_one_crate_are_apart() -> None:
    scene = scene_of(THINGS["a crate of a metre"], *["pad"] * 4, sides=("left", "left", "right", "right"))
    assert all(distances_m(scene, seat)[0] >= FREE_M for seat in range(4))


def test_tools_that_stood_in_the_free_stay_where_they_were() -> None:
    scene = load_scene(SCENES / "lift.xml", [Held("", "left", ""), Held("", "right", "")], STEP_S)
    places = scene.model.body_pos[[tool.body for tool in scene.tools]]
    assert np.allclose(places[0, 1:], places[1, 1:])
    assert distances_m(scene, 0, "box")[1] == pytest.approx(0.044, abs=1e-3), (
        "as its hands in configs/lift.toml have it"
    )


def test_a_scene_without_a_free_place_is_refused() -> None:
    walls = '<geom type="box" size="5 5 5"/><body name="it"><freejoint/><geom size=".03" mass=".1"/></body>'
    with pytest.raises(
        SceneError, match=r"there is no free place near body 'it' for an added tool; give the scene a body"
    ):
        scene_of(walls, "ball", sides=("left",))


def test_where_nothing_moves_a_tool_begins_beside_what_stands_in_the_middle() -> None:
    scene = scene_of('<geom type="box" size=".05 .05 .02"/>', "ball", sides=("left",))
    model, data = scene.model, mujoco.MjData(scene.model)
    mujoco.mj_forward(model, data)
    assert mujoco.mj_geomDistance(model, data, 0, 1, 1e3, None) >= FREE_M


BOX = (
    '<body name="it" pos="0 0 .2"><freejoint/>'
    '<geom type="box" size=".05 .05 .05" mass="20" contype="1" conaffinity="1"/></body>'
)
HEAVY = (
    '<body name="it" pos="0 0 .2"><freejoint/><inertial pos="0 0 0" mass="20" diaginertia=".1 .1 .1"/>'
    '<geom type="box" size=".05 .05 .05"/></body>'
)
DEFAULTS = (
    '<geom contype="0" conaffinity="0" group="4" friction=".1" priority="3" rgba="0 0 0 0"/>'
    '<joint armature="1" damping="5" frictionloss="3" stiffness="9" range="-.01 .01" limited="true"/>'
)


@pytest.mark.sample(9)
@pytest.mark.parametrize(
    ("compiler", "default", "body"),
    [
        ("", "", BOX), ("", DEFAULTS, BOX), ('settotalmass="20"', "", BOX), ('boundmass="1" boundinertia="1"', "", BOX),
        ('inertiafromgeom="false"', "", HEAVY), ('inertiafromgeom="true"', "", BOX), ('autolimits="false"', DEFAULTS, BOX),
        ('inertiagrouprange="3 5"', '<geom group="3"/>', BOX),
    ],
)  # fmt: skip
@pytest.mark.parametrize("orientation", ["", "free"])
def test_nothing_that_a_scene_says_of_its_own_acts_on_what_is_added(
    compiler: str, default: str, body: str, orientation: str
) -> None:
    """The scene's body weighs what MuJoCo alone makes of it, and the tool is as in a scene that says nothing."""
    text = f"<mujoco><compiler {compiler}/><default>{default}</default><worldbody>{body}</worldbody></mujoco>"
    alone = mujoco.MjModel.from_xml_string(text)
    held = [Held("ball", "left", orientation), Held("pad", "right", orientation)]  # type: ignore[arg-type]
    made, plain = (
        make_scene(text, held, STEP_S),
        make_scene(f"<mujoco><worldbody>{BOX}</worldbody></mujoco>", held, STEP_S),
    )
    assert made.model.body_mass[1] == alone.body_mass[1]
    assert np.array_equal(made.model.body_inertia[1], alone.body_inertia[1])
    tools = [made.tools[seat].body for seat in (0, 1)]
    for key in ("mass", "inertia", "ipos", "pos", "gravcomp"):
        assert np.array_equal(getattr(made.model, f"body_{key}")[tools], getattr(plain.model, f"body_{key}")[tools]), (
            key
        )
    for key in ("armature", "damping", "frictionloss"):
        assert np.array_equal(getattr(made.model, f"dof_{key}")[6:], getattr(plain.model, f"dof_{key}")[6:]), key
    for key in (
        "contype",
        "conaffinity",
        "group",
        "friction",
        "priority",
        "rgba",
        "solref",
        "solimp",
        "condim",
        "margin",
    ):
        assert np.array_equal(getattr(made.model, f"geom_{key}")[1:], getattr(plain.model, f"geom_{key}")[1:]), key
    assert not made.model.jnt_limited.any()
    assert not made.model.jnt_stiffness.any()


def test_a_site_that_a_scene_names_for_a_person_is_where_the_tool_begins() -> None:
    box = '<body name="it" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>'
    sites = (
        '<site name="cogrip_anna" pos=".3 .2 .4"/><body pos="0 0 1"><site name="cogrip_ben" pos="-.1 0 -.5"/></body>'
    )
    text = f"<mujoco><worldbody>{FLOOR}{box}{sites}</worldbody></mujoco>"
    seats = [
        Held("pad", "left", "", user="anna"),
        Held("ball", "right", "", user="ben"),
        Held("pad", "left", "", user="c"),
    ]
    scene = make_scene(text, seats, STEP_S)
    places = scene.start.data(scene.model).xpos[[tool.body for tool in scene.tools]]
    assert places[:2].tolist() == [[0.3, 0.2, 0.4], [-0.1, 0.0, 0.5]]
    assert distances_m(scene, 2)[1] <= NEAR_M, "who has no site begins as ever"
    other = make_scene(text, [seats[0]._replace(user="d"), *seats[1:]], STEP_S)
    assert other.digest != scene.digest


def test_a_site_in_something_is_refused() -> None:
    text = f'<mujoco><worldbody>{FLOOR}<site name="cogrip_anna" pos="0 0 .005"/></worldbody></mujoco>'
    with pytest.raises(
        SceneError, match=r"site 'cogrip_anna' is no place for a tool to begin: it would be in something"
    ):
        make_scene(text, [Held("pad", "left", "", user="anna")], STEP_S)


GROUND = """<asset><hfield name="h" nrow="2" ncol="2" size=".5 .5 .02 .5" elevation="0 0 0 0"/></asset>
  <worldbody><geom type="hfield" hfield="h" pos="0 0 .1"/></worldbody>"""
SOFT = """<worldbody><flexcomp name="soft" type="grid" count="4 4 4" spacing=".03 .03 .03" dim="3" radius=".003" mass=".2">
  <edge equality="true"/><contact selfcollide="none"/></flexcomp></worldbody>"""


@pytest.mark.parametrize("things", [GROUND, SOFT], ids=["height field", "flexible body"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_has_no_distance_in_mujoco_is_kept_off_all_the_same(things: str, kind: str) -> None:
    scene = make_scene(f"<mujoco>{things}</mujoco>", [Held(kind, "left", ""), Held(kind, "right", "")], STEP_S)
    data = scene.start.data(scene.model)
    mujoco.mj_forward(scene.model, data)
    tools = [
        geom
        for geom in range(scene.model.ngeom)
        if scene.model.geom_bodyid[geom] in {each.body for each in scene.tools}
    ]
    met = np.isin(data.contact.geom, tools).any(axis=1)
    assert (data.contact.dist[met] >= FREE_M).all()
