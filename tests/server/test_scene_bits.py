"""Contact of added tools with bodies of any contype, and what a scene says for all contact and all bodies."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.protocol.settings.room import resolve
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_file import Held, make_scene

from tests.server.scene_worlds import hold, world_of

SCENE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="box"><freejoint/>
<geom type="box" size=".03 .03 .03" mass=".2" contype="{}" conaffinity="{}"/>{}</body></worldbody></mujoco>"""
PUSH = np.array([[1.0, 0.0, 0.0]])  # sqrt(W), along x, from the left


def pushed(world: SceneWorld) -> float:
    hold(world)
    for _ in range(64):
        world.step(PUSH)
    return float(world.contacts.account(["anna"])["peak_contact_n"])


@pytest.mark.parametrize(("contype", "conaffinity"), [(1, 1), (1, 0), (0, 1), (2, 4), (0, 8), (6, 0)])
def test_an_added_tool_touches_bodies_of_any_bits(contype: int, conaffinity: int) -> None:
    assert pushed(world_of(SCENE.format(contype, conaffinity, ""), ["pad"])) > 0.5


def test_what_touches_nothing_is_not_touched_and_parts_of_other_bits_are_left_alone() -> None:
    assert pushed(world_of(SCENE.format(0, 0, ""), ["pad"])) == 0.0
    ball = '<geom name="ball" size=".05" mass="0" contype="2" conaffinity="2"/>'
    scene = make_scene(SCENE.format(1, 1, ball), [Held("", "left", "")], 1 / 512)
    tool = scene.model.geom_bodyid == scene.tools[0].body
    assert scene.model.geom_contype[tool].tolist() == scene.model.geom_conaffinity[tool].tolist() == [1, 1, 1, 1]


def test_one_setting_for_all_contact_does_not_hold() -> None:
    text = """<mujoco><option o_margin=".01" o_solref=".02 1"><flag override="enable"/></option><worldbody>
    <geom type="plane" size="1 1 1"/><body name="box" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
    </worldbody></mujoco>"""
    scene = make_scene(text, [], 1 / 512)
    assert scene.changed == ("flag override (enable > disable)",)
    assert not scene.model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE


@pytest.mark.parametrize(
    ("option", "geom", "words"),
    [
        ('density="1000" wind="1 0 0"', "", "the scene's medium (density 1000, wind 1, 0, 0 m/s) acts on added tools"),
        ("", 'margin=".01"', "bodies rest where their surfaces meet, whatever margin the scene sets"),
        ("", "", ""),
    ],
)
def test_advice_tells_of_a_medium_and_of_margins(tmp_path: Path, option: str, geom: str, words: str) -> None:
    file = tmp_path / "scene.xml"
    file.write_text(
        f"<mujoco><option {option}/><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .05'><freejoint/>"
        f"<geom type='box' size='.03 .03 .03' {geom}/></body></worldbody></mujoco>"
    )
    settings = resolve({"object": {"kind": "scene", "file": str(file), "axes": 3}})
    told = [each.text for each in scene_findings(settings)]
    assert any(text.startswith(words) for text in told) if words else not any("medium" in text for text in told)
    assert any("surfaces meet" in text for text in told) == bool(geom)
