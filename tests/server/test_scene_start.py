"""Where a scene begins and what moves in it of its own: keyframes, actuators, mocap bodies, and its sensors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.columns import layout_of
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.results.reading.records import End
from cogrip.results.reading.traces import trace_of
from cogrip.results.replay.verify import verify
from cogrip.results.verdict.verdict_text import verdict
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.schemes import make_scene_world
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_file import SceneAccount, account_of
from cogrip.server.worlds.scenes.scene_text import SceneError

SCENE = """<mujoco>
  <default><joint damping=".5" armature=".01"/></default>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="aim" mocap="true" pos="0 .3 .2"><geom type="box" size=".01 .01 .01" contype="0" conaffinity="0"/></body>
    <body name="arm" pos="0 .3 .1"><joint name="turn" type="hinge" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/></body>
    <body name="box" pos="0 0 .03"><freejoint/><site name="top" pos="0 0 .03"/>
      <geom type="box" size=".03 .03 .03" mass=".2"/></body>
  </worldbody>
  <actuator><position name="servo" joint="turn" kp="2" ctrlrange="-2 2"/></actuator>
  <sensor><jointpos name="angle" joint="turn"/><framepos name="top" objtype="site" objname="top"/></sensor>
  <keyframe>
    <key name="high" qpos=".4 .1 .2 .2 1 0 0 0" qvel="0 0 0 0 0 0 0" ctrl=".4" mpos="0 .3 .3"/>
    <key name="low" qpos="-.4 0 0 .03 1 0 0 0"/>
  </keyframe>
</mujoco>"""  # fmt: skip


def settings_of(folder: Path, text: str = SCENE, *tools: str, seconds: float = 0.5, **thing: Any) -> Settings:
    file = folder / "scene.xml"
    file.write_text(text)
    users = [
        {"name": name, "device": "sim:ideal", "hand": "hold", "side": side, "tool": tool}
        for name, side, tool in zip(("anna", "ben"), ("left", "right"), tools or ("", ""), strict=False)
    ]
    return resolve(
        {"seconds": seconds, "object": {"kind": "scene", "file": str(file), "axes": 3, **thing}, "users": users}
    )


def world_in(folder: Path, text: str = SCENE, *tools: str, **thing: Any) -> SceneWorld:
    settings = settings_of(folder, text, *tools, **thing)
    world = make_scene_world(settings, [seat_settings(settings, seat) for seat in range(len(settings.users))])
    assert isinstance(world, SceneWorld)
    return world


@pytest.mark.parametrize(
    ("keyframe", "box", "angle", "ctrl", "aim"),
    [
        ("", (0, 0, 0.03), 0.0, 0.0, 0.2),
        ("high", (0.1, 0.2, 0.2), 0.4, 0.4, 0.3),
        ("low", (0, 0, 0.03), -0.4, 0.0, 0.2),
    ],
)
def test_a_scene_begins_in_its_keyframe_and_goes_back_there(
    tmp_path: Path, keyframe: str, box: tuple[float, ...], angle: float, ctrl: float, aim: float
) -> None:
    world = world_in(tmp_path, keyframe=keyframe)
    for _ in range(2):
        data = world.data
        assert data.body("box").xpos == pytest.approx(box)
        assert data.joint("turn").qpos[0] == angle
        assert data.ctrl.tolist() == [ctrl]
        assert data.mocap_pos[0, 2] == aim
        assert world.position == pytest.approx(np.zeros(3)), "its start counts as 0"
        world.join(0, np.zeros(3))
        for _ in range(64):
            world.step(np.zeros((2, 3)))
        assert keyframe != "high" or data.body("box").xpos[2] < 0.1, "it falls"
        world.reset()
    tools = [world.data.xpos[tool.body] for tool in world.scene.tools]
    assert all(np.linalg.norm(place - box) < 0.15 for place in tools), "they begin beside where it is"


def test_a_session_that_began_in_a_keyframe_replays_and_is_another_one_than_without(tmp_path: Path) -> None:
    settings = settings_of(tmp_path, keyframe="high")
    run_laboratory(settings, tmp_path)
    assert verify(open_recording(tmp_path / SERVER_RECORDING)).exact
    assert world_in(tmp_path, keyframe="high").scene.digest != world_in(tmp_path).scene.digest


def test_what_nothing_uses_is_said_by_advice_and_by_the_run(tmp_path: Path) -> None:
    unused = [
        "keyframes (high, low): name one as object.keyframe",
        "mocap bodies stay where they are (aim): name one as a person's tool",
        "ctrl of actuators stays 0 (servo): set object.ctrl, or a keyframe that has it",
    ]
    settings = settings_of(tmp_path)
    assert [each.text for each in scene_findings(settings) if each.topic == "not used"] == unused
    summary = run_laboratory(settings).summary
    assert summary["server"]["scene"]["unused"] == unused
    assert ("warn", f"What nothing here uses of the scene: {'; '.join(unused)}.") in verdict(summary)
    assert world_in(tmp_path).drawing.notes() == (f"what nothing here uses of the scene: {'; '.join(unused)}",)
    used = settings_of(tmp_path, SCENE, "aim", "", keyframe="high")
    assert not [each for each in scene_findings(used) if each.topic == "not used"]


@pytest.mark.parametrize(("ctrl", "keyframe", "angle"), [((0.5,), "", 0.5), ((-0.3,), "high", -0.3), ((), "high", 0.4)])
def test_an_actuator_has_a_constant_control(
    tmp_path: Path, ctrl: tuple[float, ...], keyframe: str, angle: float
) -> None:
    world = world_in(tmp_path, ctrl=ctrl, keyframe=keyframe)
    for _ in range(512):
        world.step(np.zeros((2, 3)))
    assert world.data.joint("turn").qpos[0] == pytest.approx(angle, abs=0.01)


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        ({"keyframe": "mid"}, r"there is no keyframe 'mid'; its keyframes are high, low$"),
        (
            {"ctrl": (0.1, 0.2)},
            r"object\.ctrl has 2 values, and the scene 1 actuators, servo; give a finite one for each$",
        ),
        ({"ctrl": (float("nan"),)}, r"give a finite one for each$"),
        ({"ctrl": (2.5,)}, r"object\.ctrl of 'servo' is 2\.5, outside of its ctrlrange, -2 to 2$"),
    ],
)
def test_a_start_that_a_scene_has_not_is_refused(tmp_path: Path, thing: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        world_in(tmp_path, **thing)


GRIPPER = """<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="hand" pos="0 0 .2" gravcomp="1">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
      <geom type="box" size=".05 .02 .01" mass=".1"/>
      <body name="one" pos=".03 0 -.03" gravcomp="1"><joint name="a" type="slide" axis="1 0 0" range="-.03 .03" damping="5"/>
        <geom type="box" size=".005 .015 .03" mass=".02"/></body>
      <body name="two" pos="-.03 0 -.03" gravcomp="1"><joint name="b" type="slide" axis="-1 0 0" range="-.03 .03" damping="5"/>
        <geom type="box" size=".005 .015 .03" mass=".02"/></body>
    </body>
    <body name="ball" pos="0 0 .15"><freejoint/><geom size=".015" mass=".01"/></body>
  </worldbody>
  <equality><joint joint1="b" joint2="a"/></equality>
  <actuator><position name="close" joint="a" kp="200"/></actuator>
  <keyframe><key name="open" qpos="0 0 0 0 0 0 0 .15 1 0 0 0"/></keyframe>
</mujoco>"""  # fmt: skip


@pytest.mark.parametrize(("ctrl", "held"), [(-0.02, True), (0.01, False)])
def test_a_robots_gripper_with_an_equality_and_a_control_holds_what_is_between_its_fingers(
    tmp_path: Path, ctrl: float, held: bool
) -> None:
    world = world_in(tmp_path, GRIPPER, "hand", keyframe="open", ctrl=(ctrl,))
    world.join(0, np.zeros(3))
    for _ in range(256):
        world.step(np.zeros((1, 3)))
    fingers = world.data.joint("a").qpos[0], world.data.joint("b").qpos[0]
    assert fingers[0] == pytest.approx(fingers[1], abs=1e-3)
    assert (world.data.body("ball").xpos[2] > 0.13) == held


PULLED = """<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="aim" mocap="true" pos=".1 0 .2" quat="1 0 1 0">
      <geom type="box" size=".1 .1 .1" contype="0" conaffinity="0"/></body>
    <body name="hand" pos=".1 0 .2" quat="1 0 1 0"><freejoint/><geom type="box" size=".02 .02 .02" mass=".1"/></body>
  </worldbody>
  <equality><weld body1="aim" body2="hand"/></equality>
</mujoco>"""  # fmt: skip


def test_a_hand_holds_a_mocap_body_as_a_program_would_move_it(tmp_path: Path) -> None:
    """It has the mass of an added tool, moves along the world's axes though it is turned, and takes with it what is welded."""
    world = world_in(tmp_path, PULLED, "aim")
    tool = world.scene.tools[0].body
    assert world.scene.model.body_mass[tool] == pytest.approx(0.05)
    assert world.data.xpos[tool] == pytest.approx([0.1, 0.0, 0.2])
    world.join(0, np.zeros(3))
    for _ in range(128):
        world.step(np.array([[0.0, 0.1, 0.0]]))
    moved = world.proxy(0)
    assert moved[1] > 0.01
    assert moved[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert world.data.body("hand").xpos - world.data.xpos[tool] == pytest.approx(np.zeros(3), abs=1e-3)
    assert world.balance_error_j <= 1e-14


def test_sensors_stand_in_the_recording_and_its_tables(tmp_path: Path) -> None:
    run_laboratory(settings_of(tmp_path, keyframe="high"), tmp_path)
    server = End(open_recording(tmp_path / SERVER_RECORDING))
    (topic,) = [each for each in server.recording.topics if each.endswith("/sensors")]
    trace, box = trace_of(server, topic), trace_of(server, topic.replace("sensors", "poses"))
    assert trace.rows == box.rows > 20
    names = [column.name for column in layout_of(next(server.records(topic)).record).columns]
    assert names[-4:] == ["sensors_angle", "sensors_top_0", "sensors_top_1", "sensors_top_2"]
    angle, *top = trace.columns["sensors"][-1]
    assert angle == pytest.approx(0.4, abs=0.01)
    assert top == pytest.approx([0.1, 0.2, 0.06], abs=2e-3), "the box has fallen, as its pose says"


def test_one_account_says_what_becomes_of_a_scene(tmp_path: Path) -> None:
    text = SCENE.replace("<default>", '<option integrator="Euler" cone="pyramidal"/><default>')
    told = account_of(settings_of(tmp_path, text, "aim", "ball"), 1 / 128)
    (added,) = told.added
    assert added.startswith("ball for ben at ")
    assert added.endswith(", 0, 30 mm")
    assert (told.refused, told.own, told.changed) == ("", ("option cone",), ("integrator (euler > discrete)",))
    assert "geom solref" in told.filled
    assert len(told.unused) == 2
    refused = account_of(settings_of(tmp_path, text, keyframe="mid"), 1 / 128)
    assert refused == SceneAccount("scene.xml: there is no keyframe 'mid'; its keyframes are high, low")
