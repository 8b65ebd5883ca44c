"""Scripts of scenes: controls and mocap bodies that a Python class sets, what holds for them, and that they replay."""

from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.results.replay.verify import verify
from cogrip.results.verdict.verdict_text import notes
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.schemes import make_scene_world
from cogrip.server.worlds import registry
from cogrip.server.worlds.guarded import TooLongError
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_script import MOST_MPS
from cogrip.server.worlds.world import WorldError
from cogrip.sim.input_files import files_read
from cogrip.sim.laboratory import Laboratory

SCENE = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
<body name="arm" pos="0 .3 .1"><joint name="turn" axis="0 0 1" damping=".05"/>
<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/></body>
<body name="cart" mocap="true" pos="-.3 0 .05"><geom type="box" size=".02 .05 .05"/></body>
<body name="box" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body></worldbody>
<actuator><position name="servo" joint="turn" kp="2" ctrlrange="-1 1"/></actuator>
<sensor><jointpos name="angle" joint="turn"/></sensor></mujoco>"""
SCRIPT = """
from math import sin
from cogrip.server.worlds.scenes.scene_script import SceneScript

class Swing(SceneScript):
    kept = ("frames", "seen")

    def __init__(self):
        self.frames, self.seen = 0, 0.0

    def frame(self, scene):
        self.frames += 1
        self.seen = scene.sensor("angle")
        scene.set_control("servo", 0.5 * sin(4.0 * scene.time_s))
        {line}
"""
CART = 'scene.put("cart", (-0.3 + 0.3 * min(1.0, scene.time_s), 0.0, 0.05))'
STEP_S = 1.0 / 128.0


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that writes settings with a script whose last line is given, and loads them."""
    monkeypatch.setenv(registry.ALLOWED, str(tmp_path))
    (tmp_path / "scene.xml").write_text(SCENE)
    text = '[object]\nkind = "scene"\nfile = "scene.xml"\nscript = "python:swing.py:{name}"\naxes = 3\n'

    def make(line: str = CART, name: str = "Swing", *overrides: str) -> Settings:
        (tmp_path / "swing.py").write_text(dedent(SCRIPT).format(line=line))
        people = "".join(
            f'[[users]]\nname = "{side}"\nside = "{side}"\nhand = "reach&amplitude_m=0.02"\n'
            for side in ("left", "right")
        )
        (tmp_path / "room.toml").write_text(f"seconds = 1.5\n{text.format(name=name)}{people}")
        return load(tmp_path / "room.toml", overrides)

    return make


def world_of(settings: Settings) -> SceneWorld:
    world = make_scene_world(settings, [seat_settings(settings, seat) for seat in range(len(settings.users))])
    assert isinstance(world, SceneWorld)
    return world


def step(world: SceneWorld, frames: int) -> None:
    for _ in range(frames):
        world.step(np.zeros((2, 3)))


def test_a_script_turns_an_actuator_and_moves_a_mocap_body_that_pushes_what_is_in_its_way(room: Any) -> None:
    world = world_of(room())
    angles = []
    for _ in range(192):
        step(world, 1)
        angles.append(float(world.data.joint("turn").qpos[0]))
    assert max(angles) == pytest.approx(0.5, abs=0.1), "it follows the sine"
    assert min(angles) < -0.3
    assert world.data.body("cart").xpos == pytest.approx([0.0, 0.0, 0.05], abs=1e-9)
    assert 0.049 < float(world.data.body("box").xpos[0]) < 0.07, "it is pushed ahead, and slides on a little"
    assert world.accounts.scene()["mocap_slowed"] == 0
    assert world.scene.unused == ()
    assert not [each for each in scene_findings(room()) if each.topic == "not used"]


def test_a_mocap_body_goes_in_equal_parts_and_no_faster_than_it_may(room: Any) -> None:
    world = world_of(room('scene.put("cart", (-0.2, 0.0, 0.05), (0.0, 0.0, 0.0, 1.0))'))
    places = [float(world.data.body("cart").xpos[0])]
    for _ in range(8):
        step(world, 1)
        places.append(float(world.data.body("cart").xpos[0]))
    assert np.diff(places).max() <= MOST_MPS * STEP_S + 1e-12
    assert places[-1] < -0.2 + 1e-9
    step(world, 200)
    assert world.data.body("cart").xpos == pytest.approx([-0.2, 0.0, 0.05])
    assert abs(world.data.body("cart").xquat[3]) == pytest.approx(1.0)
    slowed = world.accounts.scene()["mocap_slowed"]
    assert slowed == 8, "frames in which it had farther to go"
    (told,) = [
        text for _, text, about in notes({"server": {"scene": world.accounts.scene()}}) if about == "mocap bodies"
    ]
    assert told.startswith("A script put mocap bodies farther than they may go, 8 times")


def test_it_is_saved_restored_and_begun_anew_with_the_scene(room: Any) -> None:
    world = world_of(room())
    step(world, 50)
    saved = world.save()
    step(world, 50)
    after = world.save()
    world.restore(saved)
    step(world, 50)
    assert world.save() == after
    other = world_of(room())
    other.restore(saved)
    step(other, 50)
    assert other.save() == after
    world.reset()
    step(world, 100)
    begun = world_of(room())
    step(begun, 100)
    assert world.data.qpos == pytest.approx(begun.data.qpos, abs=0.0)


def test_a_session_with_a_script_replays_bit_for_bit_and_with_another_one_is_refused(room: Any, tmp_path: Path) -> None:
    settings = room()
    (tmp_path / "run").mkdir()
    summary = run_laboratory(settings, tmp_path / "run").summary
    assert summary["server"]["scene"]["unused"] == []
    recording, read = open_recording(tmp_path / "run" / SERVER_RECORDING), files_read(settings)
    assert verify(recording).exact
    other = room('scene.put("cart", (-0.3, 0.0, 0.05))')
    assert files_read(other) != read
    with pytest.raises(RecordingError, match="is another scene"):
        verify(recording)


EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "scenes"


def test_the_example_follows_its_recorded_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(registry.ALLOWED, str(EXAMPLES))
    laboratory = Laboratory(load(EXAMPLES / "on_its_way.toml"))
    laboratory.run()
    world = laboratory.room.world
    assert isinstance(world, SceneWorld)
    assert not world.failed
    assert not laboratory.incident
    assert world.data.body("cart").xpos == pytest.approx([-0.2, 0.0, 0.05], abs=0.002)
    assert 0.049 < float(world.data.body("box").xpos[0]) < 0.07, "it was pushed to where the cart turned back"


BAD = {
    'scene.put("box", (0, 0, 0))': "'box' is no mocap body, or a person holds it as a tool",
    'scene.put("cart", (0, 0))': "'cart' is put at (0, 0), turned by None: give three places and a quaternion",
    'scene.put("cart", (0, 0, float("nan")))': "give three places",
    'scene.put("cart", (0, 0, 0), (0, 0, 0, 0))': "give three places and a quaternion",
    'scene.set_control("motor", 1.0)': "there is no actuator 'motor'; there are: servo",
    'scene.set_control("servo", float("inf"))': "the control of 'servo' is inf; give a number",
    'scene.sensor("force")': "there is no sensor 'force'; there are: angle",
    'scene.place("hand")': "there is no body 'hand'; there are: world, arm, cart, box",
    "1 / 0": "ZeroDivisionError: division by zero (line 15) in frame",
    'self.seen = float("nan")': "keeps 2 numbers, at most 10000 and finite ones",
}


@pytest.mark.parametrize("line", BAD)
def test_a_script_that_fails_ends_its_room_with_the_reason_and_is_not_called_again(room: Any, line: str) -> None:
    laboratory = Laboratory(room(line))
    laboratory.run()
    world = laboratory.room.world
    assert world.failed.startswith("python:swing.py:Swing: ")
    assert BAD[line] in world.failed
    assert laboratory.seconds < 0.1


def test_a_script_that_takes_too_long_fails(room: Any) -> None:
    class Late:
        def __enter__(self) -> None: ...
        def __exit__(self, *_: object) -> None:
            raise TooLongError

    world = world_of(room())
    world.limit_calls(Late)
    with pytest.raises(WorldError, match=r"python:swing\.py:Swing: takes too long in frame"):
        step(world, 1)


@pytest.mark.parametrize(
    ("name", "allowed", "words"),
    [
        ("Swung", True, "object.script: .* has no class Swung; name one that is in it"),
        ("sin", True, "is no script; derive it from cogrip.server.worlds.scenes.scene_script.SceneScript"),
        ("Swing", False, "object.script: .*swing.py is a program, and settings may be anybody's"),
    ],
)
def test_a_script_that_cannot_be_had_is_said_before_anything_starts(
    room: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, allowed: bool, words: str
) -> None:
    if not allowed:
        monkeypatch.setenv(registry.ALLOWED, "")
    with pytest.raises(BadInput, match=words):
        room(name=name)
    if not allowed:
        assert load(Path(room.__closure__[0].cell_contents) / "room.toml" if False else _path_of(room), world=False)


def _path_of(room: Any) -> Path:
    return next(
        Path(cell.cell_contents) / "room.toml" for cell in room.__closure__ if isinstance(cell.cell_contents, Path)
    )


def test_a_script_is_for_scenes_alone(room: Any) -> None:
    with pytest.raises(BadInput, match=r"object\.script = .* is for object\.kind = \"scene\""):
        room(CART, "Swing", "object.kind=cube", "object.file=")
