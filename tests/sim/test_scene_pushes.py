"""Scenes of the kinds that people write, pushed at random: none makes more than 1 mJ, or it is refused with what to change."""

import re
from pathlib import Path

import pytest

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.analysis.advice.scene_pushed import pushed
from cogrip.cli.settings.before_run import check_settings
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds.scenes.scene_pushes import MOST_MADE_J

from tests.extent import long

FLOOR = '<geom type="plane" size="1 1 .1"/>'
BOX = '<body name="box" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>'
SLIM = '<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/>'
GROUND = '<hfield name="t" nrow="4" ncol="4" size=".3 .3 .02 .01" elevation="0 1 0 1 1 0 1 0 0 1 0 1 1 0 1 0"/>'
GRID = '<flexcomp name="f" type="grid" count="{}" dim="{}" spacing=".02 .02 .02" pos="0 0 .1" radius=".003" mass=".1">'
FLEX = GRID + "{}</flexcomp>"


def scene(bodies: str = FLOOR + BOX, option: str = "", default: str = "", rest: str = "", flag: str = "") -> str:
    options = f"<option {option}><flag {flag}/></option><default>{default}</default>"
    return f"<mujoco>{options}<worldbody>{bodies}</worldbody>{rest}</mujoco>"


def chain(joint: str, links: int, link_m: float = 0.1) -> str:
    """Return links that hang on each other by these joints, from a height of 0.3 m."""
    geom = f'<geom type="capsule" fromto="0 0 0 {link_m} 0 0" size=".01" mass=".1"/>'
    text = ""
    for _ in range(links):
        text = f'<body pos="{link_m} 0 0">{joint}{geom}{text}</body>'
    return scene(f'<body pos="0 0 .3">{text}</body>')


def geoms(values: str, option: str = "") -> str:
    return scene(default=f"<geom {values}/>", option=option)


KINDS = {
    "plain": scene(),
    **{name: scene(option=f'integrator="{name}"') for name in ("Euler", "implicit", "implicitfast", "RK4")},
    "MJX": scene(option='iterations="1" ls_iterations="4" solver="CG"', flag='eulerdamp="disable"'),
    "PGS": scene(option='solver="PGS" iterations="20" noslip_iterations="5"'),
    "time step": scene(option='timestep="0.01"'),
    **{
        f"{cone}, impratio {ratio}": scene(option=f'cone="{cone}" impratio="{ratio}"')
        for cone in ("pyramidal", "elliptic") for ratio in (1, 10)
    },
    **{f"condim {number}": geoms(f'condim="{number}"') for number in (1, 3, 4, 6)},
    **{f"condim {number}, pyramidal": geoms(f'condim="{number}"', 'cone="pyramidal" impratio="1"') for number in (1, 3, 4, 6)},
    "multiccd": scene(flag='multiccd="enable"'),
    "no nativeccd": scene(flag='nativeccd="disable"'),
    "solref .004 1": geoms('solref=".004 1"'),
    "solref .01 .5": geoms('solref=".01 .5"'),
    "solref -1000 -50": geoms('solref="-1000 -50"'),
    "solimp .99": geoms('solimp=".99 .99 .001"'),
    "robosuite": geoms('solref=".001 1" solimp=".998 .998 .001"'),
    "menagerie": geoms(
        'friction="1" solimp=".99 .99 .01" solref=".01 1" condim="4"', 'integrator="implicitfast" cone="elliptic" impratio="10"'
    ),
    "margin and gap": geoms('margin=".01" gap=".01"'),
    "slippery": geoms('friction="0 0 0"'),
    "rough": geoms('friction="3 .1 .01"'),
    "capsule": scene(
        FLOOR + '<body pos="0 0 .03"><freejoint/><geom type="capsule" size=".03 .04" euler="0 90 0" mass=".2"/></body>'
    ),
    "cylinder": scene(FLOOR + '<body pos="0 0 .04"><freejoint/><geom type="cylinder" size=".03 .04" mass=".2"/></body>'),
    "ellipsoid": scene(FLOOR + '<body pos="0 0 .03"><freejoint/><geom type="ellipsoid" size=".05 .03 .03" mass=".2"/></body>'),
    "two boxes": scene(FLOOR + BOX + '<body pos="0 0 .09"><freejoint/><geom type="box" size=".03 .03 .03" mass=".1"/></body>'),
    "door": scene(
        FLOOR + '<body pos="0 .05 0"><joint axis="0 0 1" damping=".02" range="-60 60"/>'
        '<geom type="box" size=".005 .06 .08" pos="0 -.06 .085" mass=".2"/></body>'
    ),
    "drawer": scene(
        FLOOR + '<body pos=".1 0 .035"><joint type="slide" axis="1 0 0" frictionloss=".5" range="-.1 .1"/>'
        '<geom type="box" size=".03 .03 .03" mass=".2"/></body>'
    ),
    "spring": scene('<body pos="0 0 .1"><joint type="slide" axis="1 0 0" stiffness="50"/><geom size=".03" mass=".2"/></body>'),
    "arm": scene(
        FLOOR + f'<body pos="0 0 .05"><joint axis="0 0 1" damping=".1"/>{SLIM}'
        f'<body pos=".1 0 0"><joint axis="0 1 0" damping=".1" armature=".001"/>{SLIM}</body></body>'
    ),
    "weld": scene(
        FLOOR + BOX + '<body name="b" pos=".1 0 .03"><freejoint/><geom size=".02" mass=".05"/></body>',
        rest='<equality><weld body1="box" body2="b"/></equality>',
    ),
    "tendon": scene(
        '<body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0"/><geom size=".02" mass=".1"/></body>',
        rest='<tendon><fixed stiffness="100" range="-.05 .05"><joint joint="x" coef="1"/></fixed></tendon>',
    ),
    "height field": scene(
        '<geom type="hfield" hfield="t"/><body pos="0 0 .06"><freejoint/><geom size=".02" mass=".05"/></body>',
        rest=f"<asset>{GROUND}</asset>",
    ),
    "soft body": scene(FLOOR + FLEX.format("4 4 4", 3, '<edge equality="true" damping="1"/><contact selfcollide="none"/>')),
    "a top": scene('<body pos="0 0 .1"><joint type="ball"/><geom type="capsule" fromto="0 0 0 0 0 -.1" size=".003"/></body>'),
    "double pendulum": chain('<joint axis="0 1 0"/>', 2),
    "arm of three hinges": chain('<joint axis="0 1 0"/>', 3),
    "two ball joints": chain('<joint type="ball"/>', 2),
    "ragdoll": scene(
        FLOOR + '<body pos="0 0 .1"><freejoint/><geom type="capsule" fromto="0 0 0 0 0 .1" size=".02" mass=".2"/>'
        f'<body pos="0 0 .1"><joint type="ball"/>{SLIM}</body></body>'
    ),
}  # fmt: skip
LINKED = ("a top", "double pendulum", "arm of three hinges", "two ball joints")
WORSE = {
    "contacts found late": (geoms('margin=".0001"'), "leave geom margin out of the scene"),
    "a pin through two bodies": (
        scene(
            f'<body name="a" pos="0 0 .3"><joint axis="0 1 0"/>{SLIM}</body>'
            f'<body name="b" pos=".1 0 .3"><freejoint/>{SLIM}</body>',
            rest='<equality><connect body1="a" body2="b" anchor=".1 0 0"/></equality>',
        ),
        r'bodies a and b are 20 mm inside of each other as .* by <exclude body1="a" body2="b"/>',
    ),
    "four ball joints": (chain('<joint type="ball"/>', 4, 0.05), "raise object.substeps, or give its joints damping"),
}  # fmt: skip


def settings_of(folder: Path, text: str, *tools: str, substeps: int = 4) -> Settings:
    file = folder / "scene.xml"
    file.write_text(text)
    users = [{"tool": tool, "side": side} for tool, side in zip(tools, ("left", "right"), strict=False)]
    return resolve({"object": {"kind": "scene", "file": str(file), "axes": 3, "substeps": substeps}, "users": users})


@pytest.mark.sample(17)
@pytest.mark.parametrize(
    ("name", "tools", "pushes"),
    [
        *[(name, ("pad", "pad"), 40 if name in LINKED else 12) for name in KINDS],
        *[long(name, tools, 100) for name in KINDS for tools in (("pad", "pad"), ("ball", "box"))],
    ],
)
def test_scenes_of_the_kinds_that_people_write_make_no_energy(
    tmp_path: Path, name: str, tools: tuple[str, ...], pushes: int
) -> None:
    found = pushed(settings_of(tmp_path, KINDS[name], *tools), pushes)
    assert not found.refused, found.text
    assert found.level == "ok"


@pytest.mark.parametrize("name", WORSE)
def test_a_scene_that_makes_energy_is_refused_with_what_to_change(tmp_path: Path, name: str) -> None:
    text, cure = WORSE[name]
    settings = settings_of(tmp_path, text, "ball" if name != "a pin through two bodies" else "pad", "box")
    found = pushed(settings, 40)
    assert found.refused
    assert found.text.startswith("in 40 random pushes ")
    assert re.search(cure, found.text)


def test_a_cloth_that_makes_energy_makes_none_in_more_steps(tmp_path: Path) -> None:
    cloth = scene(
        FLEX.format("6 6 1", 2, '<pin id="0 5 30 35"/><edge equality="true"/>').replace('mass=".1"', 'mass=".05"')
    )
    assert not pushed(settings_of(tmp_path, cloth, "pad", "pad", substeps=8), 40).refused
    assert MOST_MADE_J == 1e-3


def test_a_chain_of_ball_joints_that_makes_energy_makes_none_in_more_steps(tmp_path: Path) -> None:
    text = WORSE["four ball joints"][0]
    assert not pushed(settings_of(tmp_path, text, "ball", "box", substeps=8), 40).refused


def test_a_run_of_a_scene_that_makes_energy_by_its_own_contact_is_refused_before_it_begins(tmp_path: Path) -> None:
    late = settings_of(tmp_path, WORSE["contacts found late"][0], "ball", "box")
    with pytest.raises(
        BadInput, match=r"^refused: in 20 random pushes .* leave geom margin out of the scene; --allow-unstable"
    ):
        check_settings(late)
    check_settings(late, allow_unstable=True)
    check_settings(settings_of(tmp_path, KINDS["menagerie"], "pad", "pad"))


def test_bodies_that_overlap_as_a_scene_begins_are_told_and_others_are_not(tmp_path: Path) -> None:
    told = [
        each.text for each in scene_findings(settings_of(tmp_path, WORSE["a pin through two bodies"][0], "pad", "pad"))
    ]
    assert sum("are 20 mm inside of each other" in text for text in told) == 1
    assert not any(
        "inside of each other" in each.text for each in scene_findings(settings_of(tmp_path, scene(), "pad", "pad"))
    )


DRAWER = '<body name="drawer" pos="0 0 .2"><joint {} limited="true"/><geom type="box" size=".03 .03 .03"/></body>'
OUTSIDE = {
    'name="d" type="slide" range=".05 .1"': "joint d begins 50 mm outside of its range",
    'type="hinge" range="-90 -30"': "joint of body drawer begins 30 degrees outside of its range",
    'type="slide" range="0 .1"': "",
    'type="ball" range="0 .1"': "",
}


@pytest.mark.parametrize("joint", OUTSIDE)
def test_a_joint_that_begins_outside_of_its_range_is_told(tmp_path: Path, joint: str) -> None:
    told = [each.text for each in scene_findings(settings_of(tmp_path, scene(DRAWER.format(joint)), "pad", "pad"))]
    assert any(text.startswith(OUTSIDE[joint]) for text in told if OUTSIDE[joint]) == bool(OUTSIDE[joint])
    assert OUTSIDE[joint] or not any("outside of its range" in text for text in told)
