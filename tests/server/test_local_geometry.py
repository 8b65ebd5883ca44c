"""Which shapes a client is told of a scene, which tools it can render contact of, and what is left to the server."""

from pathlib import Path

import numpy as np
import pytest

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds.scenes.local_geometry import MOST_LOCAL, LocalGeometry
from cogrip.server.worlds.scenes.local_scene import LocalSceneWorld

from tests.server.local_worlds import join_all, local_world, report

Place = tuple[float, float, float]
SLIDES = "".join(f"<joint type='slide' axis='{axis}'/>" for axis in ("1 0 0", "0 1 0", "0 0 1"))
BALL = "<geom name='ball' size='.01' mass='.05'/>"


def scene(fixed: str = "", tool: str = SLIDES + BALL, more: str = "") -> str:
    body = f"<body name='hand' pos='.5 0 .1' gravcomp='1'>{tool}</body>"
    return f"<mujoco><worldbody>{fixed}{body}</worldbody>{more}</mujoco>"


def led(text: str, place: Place, frames: int) -> LocalSceneWorld:
    """Return the world of a scene whose hand has been led to a place."""
    world = join_all(local_world(text, ["hand"]))
    for _ in range(frames):
        report(world, np.array([place]))
        world.step(np.zeros((1, 3)))
    return world


def geometry(text: str) -> LocalGeometry:
    return local_world(text, ["hand"]).geometry[0]


KINDS = """
  <geom name="plane" type="plane" size="1 2 .1" euler="0 20 0"/>
  <geom name="box" type="box" size=".1 .2 .3" pos="1 2 3" euler="10 20 30"/>
  <geom name="sphere" size=".1" pos="1 0 0"/>
  <geom name="capsule" type="capsule" size=".1 .2" pos="0 1 0"/>
  <geom name="cylinder" type="cylinder" size=".1 .2" pos="0 0 1" group="4" rgba="0 0 0 0"/>
  <geom name="ellipsoid" type="ellipsoid" size=".1 .2 .3" pos="3 0 0"/>
  <geom name="drawn" type="box" size=".1 .2 .3" contype="0" conaffinity="0"/>
  <geom name="other" type="box" size=".1 .2 .3" contype="2" conaffinity="2"/>
  <geom name="far" size=".1" pos="2000 0 0"/>
  <body name="excluded"><geom type="box" size=".1 .2 .3"/></body>
  <body name="static" pos="0 0 5"><geom name="on it" size=".3"/></body>
"""
EXCLUDED = "<contact><exclude body1='hand' body2='excluded'/></contact>"


def test_fixed_shapes_that_the_tool_can_touch_are_told_in_the_hands_own_frame() -> None:
    found = geometry(scene(KINDS, more=EXCLUDED))
    assert found.why == ""
    *fixed, ball = found.shapes
    assert [shape.kind for shape in fixed] == ["plane", "box", "sphere", "capsule", "cylinder", "sphere"]
    assert fixed[0].size_m == (0.0, 0.0, 0.0), "a plane has no end, whatever is drawn"
    assert fixed[0].orientation == pytest.approx((np.cos(np.pi / 18), 0.0, np.sin(np.pi / 18), 0.0))
    assert fixed[1].size_m == pytest.approx((0.1, 0.2, 0.3))
    assert fixed[1].place_m == pytest.approx((0.5, 2.0, 2.9))
    assert fixed[3].size_m == pytest.approx((0.1, 0.2, 0.0))
    assert (ball.kind, ball.size_m, ball.place_m, ball.seat) == ("sphere", (0.01, 0.0, 0.0), (0.0, 0.0, 0.0), 0)
    assert all(shape.body is None and shape.seat is None for shape in fixed)
    assert found.left_out == ("ellipsoid", "far")
    assert len(found.obstacles) == 2


def test_of_too_many_shapes_the_last_are_left_to_the_server() -> None:
    for count, left in ((MOST_LOCAL - 1, 0), (MOST_LOCAL + 2, 3)):
        fixed = "".join(f"<geom size='.01' pos='{0.1 * number} 5 0'/>" for number in range(count))
        found = geometry(scene(fixed))
        assert (len(found.shapes), len(found.left_out)) == (MOST_LOCAL, left)


HINGED = "<body><joint type='hinge'/><geom size='.01' mass='.01'/></body>"
SPRUNG = "<joint type='slide' axis='1 0 0' stiffness='9'/>" + SLIDES.partition("/>")[2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (scene(tool="<freejoint/>" + BALL), "it turns"),
        (scene(tool=SLIDES + BALL + HINGED), "joints of its own"),
        (scene(tool=SLIDES + "<geom type='box' size='.1 .1 .1' mass='1'/>"), "it does not touch with balls alone"),
        (scene(tool=SLIDES + BALL.replace("/>", " contype='0' conaffinity='0'/>")), "balls alone"),
        (scene(tool=SPRUNG + BALL), "springs or limits"),
        (scene(tool=SLIDES.replace("/>", " range='-1 1' limited='true'/>", 1) + BALL), "springs or limits"),
        (scene("<geom name='a' size='.1'/>", more="<contact><pair geom1='a' geom2='ball'/></contact>"), "pairs"),
        (
            scene("<body name='b' pos='.5 0 .1'><freejoint/><geom size='.01'/></body>",
                  more="<equality><weld body1='b' body2='hand'/></equality>"),
            "tied to other bodies",
        ),
        (
            scene("<body><joint name='j'/><geom size='.01'/></body>", more="<actuator><motor joint='j'/></actuator>"),
            "actuators",
        ),
    ],
)  # fmt: skip
def test_a_tool_that_cannot_be_put_anywhere_is_always_held_by_its_line(text: str, words: str) -> None:
    world = led(text, (0.1, 0.0, 0.0), frames=200)
    assert words in world.geometry[0].why
    assert world.drawing.local_shapes(0) == ()
    assert world.engaged_at(0) == pytest.approx((0.0, 0.0, 0.0)), "where it was taken"


def test_a_fixed_shape_that_no_client_renders_engages_the_tool() -> None:
    world = led(scene("<geom type='ellipsoid' size='.1 .2 .3' pos='.7 0 .1'/>"), (0.15, 0.0, 0.0), frames=60)
    assert world.engaged_at(0)
    assert world.proxy(0)[0] == pytest.approx(0.2 - 0.1 - 0.01 - 0.005, abs=2e-4)
    u = np.array([[0.4, 0.0, 0.0]])
    for _ in range(100):
        world.step(u)
    assert world.force[0, 0] == pytest.approx(np.sqrt(40.0) * 0.4, rel=1e-3), "the server's contact holds it"
    assert world.proxy(0)[0] < 0.092


def test_height_fields_are_kept_clear_of_by_a_ball_around_them() -> None:
    field = "<asset><hfield name='h' nrow='2' ncol='2' elevation='0 1 0 1' size='.1 .1 .1 .1'/></asset>"
    fixed = "<geom name='hills' type='hfield' hfield='h' pos='0 0 -1'/>"
    world = led(scene(fixed, more=field), (-0.5, 0.0, -1.1), frames=100)
    assert world.geometry[0].left_out == ("hills",)
    assert world.engaged_at(0)
    distance = float(np.linalg.norm(world.proxy(0) - np.array([-0.5, 0.0, -1.1])))
    radius = float(world.scene.model.geom_rbound[world.geometry[0].obstacles[0]])
    assert distance == pytest.approx(radius + 0.01 + 0.005, abs=2e-3)


def local_texts(settings: Settings) -> list[str]:
    return [finding.text for finding in scene_findings(settings) if finding.topic == "local"]


def test_advice_says_what_is_rendered_where(tmp_path: Path) -> None:
    at_hand = "is rendered at the hand; bodies that move are felt through the line"
    lift, table = (load(Path(name), ["coupling.kind=local"]) for name in ("lift", "table"))
    assert local_texts(lift)[0] == f"anna: contact with 1 fixed shape {at_hand}"
    assert "it turns, or has joints of its own" in local_texts(table)[0]
    file = tmp_path / "s.xml"
    file.write_text(scene(KINDS, more=EXCLUDED))
    thing = {"kind": "scene", "axes": 3, "file": str(file)}
    users = [{"name": "anna", "tool": "hand"}]
    assert local_texts(resolve({"object": thing, "coupling": {"kind": "local"}, "users": users})) == [
        f"anna: contact with 6 fixed shapes {at_hand}",
        "anna: contact with ellipsoid, far is the server's: no client renders it",
    ]


@pytest.mark.parametrize(
    ("user", "refused"),
    [
        ({"tool": "pad", "device": "sim:phantom6"}, True),
        ({"tool": "pad", "orientation": "fixed"}, False),
        ({"tool": "ball", "device": "sim:phantom6"}, False),
    ],
)
def test_advice_refuses_a_tool_that_turns_and_is_no_ball(user: dict[str, str], refused: bool) -> None:
    thing = {"kind": "scene", "axes": 6, "file": str(shipped_scene("wall.xml"))}
    table = resolve({"object": thing, "coupling": {"kind": "local"}, "users": [{"name": "anna", **user}]})
    (finding,) = [finding for finding in scene_findings(table) if finding.topic == "local"]
    assert finding.refused == refused
    assert refused or finding.text.startswith("anna: contact with 1 fixed shape is rendered at the hand")
