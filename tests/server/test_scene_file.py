"""Scenes as people bring them: what is applied to them, which tools they give, and a line for each that cannot be used."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cogrip.server.worlds.scenes.scene_file import SPARSE_FROM, Held, load_scene, make_scene
from cogrip.server.worlds.scenes.scene_text import MOST_BYTES, SceneError

from tests.server.scene_worlds import SCENES, SHIPPED, SLIDES, hold, world_of

STEP = 1 / 512
SEAT = [Held("", "left", "")]
BALL = "<body name='ball'><freejoint/><geom size='.02' mass='.1'/></body>"
URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint></robot>"""


def scene_of(bodies: str, *tools: str, more: str = ""):
    seats = [Held(tool, ("left", "right")[seat % 2], "") for seat, tool in enumerate(tools or ("",))]
    return make_scene(f"<mujoco>{more}<worldbody>{bodies}</worldbody></mujoco>", seats, STEP)


@pytest.mark.parametrize("name", SHIPPED)
def test_scenes_that_come_with_cogrip_leave_contact_to_it(name: str) -> None:
    scene = load_scene(SCENES / f"{name}.xml", [Held("", "left", ""), Held("", "right", "")], STEP)
    assert scene.own == ()
    assert "geom solref" in scene.filled
    assert scene.model.opt.timestep == STEP
    assert scene.model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    assert len({tool.body for tool in scene.tools}) == 2


def test_contact_that_a_scene_sets_is_kept_and_named() -> None:
    more = "<option integrator='Euler' cone='pyramidal'/><default><geom solref='.01 1'/></default>"
    scene = scene_of("<geom type='plane' size='1 1 1' margin='.002'/>" + BALL, "ball", more=more)
    assert scene.own == ("option cone", "geom margin", "geom solref")
    assert scene.changed == ("integrator (euler > discrete)",)
    assert scene.filled == ("option impratio", "option jacobian", "geom margin", "geom condim", "geom solimp")
    assert scene.model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    assert scene.model.geom_margin.tolist() == [0.002, 0.005]
    assert scene.model.geom_solref[:, 0].tolist() == [0.01, 0.01]


def test_pairs_have_contact_of_their_own() -> None:
    pair = "<contact><pair geom1='a' geom2='b'/></contact>"
    bodies = "<geom name='a' type='plane' size='1 1 1'/><body><freejoint/><geom name='b' size='.1'/></body>"
    scene = make_scene(f"<mujoco><worldbody>{bodies}</worldbody>{pair}</mujoco>", SEAT, STEP)
    assert scene.model.pair_solref[0].tolist() == [-360000.0, -1170.0]
    assert "pair solref" in scene.filled


def test_what_would_break_a_port_is_switched_back() -> None:
    scene = scene_of(
        BALL, more="<option timestep='.1'><flag damper='disable' eulerdamp='disable' autoreset='enable'/></option>"
    )
    off = scene.model.opt.disableflags
    assert not off & mujoco.mjtDisableBit.mjDSBL_DAMPER
    assert not off & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    assert off & mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert scene.model.opt.timestep == STEP


@pytest.mark.parametrize(
    ("bodies", "own", "sparse"), [(4, "", False), (5, "", True), (5, "dense", False), (4, "sparse", True)]
)
def test_a_crowded_scene_has_sparse_matrices(bodies: int, own: str, sparse: bool) -> None:
    crowd = "<body><freejoint/><geom size='.01'/></body>" * bodies  # of 6 degrees of freedom, a tool of 3
    scene = scene_of(crowd, "ball", "ball", more=f"<option jacobian='{own}'/>" if own else "")
    assert (scene.model.nv >= SPARSE_FROM) == (bodies == 5)
    assert bool(mujoco.mj_isSparse(scene.model)) == sparse


@pytest.mark.parametrize(("balls", "searched"), [(16, False), (17, True)])
def test_bodies_of_few_geoms_in_a_crowded_scene_are_tried_one_by_one(balls: int, searched: bool) -> None:
    large = "<body><freejoint/>" + "<geom size='.01'/>" * balls + "</body>"
    crowd = "<body><freejoint/><geom size='.01'/></body>" * 5
    off = scene_of(large + crowd, "ball").model.opt.disableflags
    assert bool(off & mujoco.mjtDisableBit.mjDSBL_MIDPHASE) != searched
    assert not scene_of(BALL, "ball").model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_MIDPHASE


# Tools ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tool", "balls", "boxes"), [("", 4, 0), ("pad", 4, 0), ("ball", 1, 0), ("box", 0, 1)])
def test_tools_that_are_added(tool: str, balls: int, boxes: int) -> None:
    scene = scene_of("", tool)
    kinds = [scene.model.geom_type[geom] for geom in range(scene.model.ngeom)]
    assert kinds.count(mujoco.mjtGeom.mjGEOM_SPHERE) == balls
    assert kinds.count(mujoco.mjtGeom.mjGEOM_BOX) == boxes
    assert scene.model.body_mass[scene.tools[0].body] == pytest.approx(0.05)
    assert not scene.tools[0].turns


def test_added_tools_start_beside_the_object_each_on_its_side() -> None:
    world = world_of(
        "<mujoco><worldbody><body pos='1 2 3'><freejoint/><geom size='.1'/></body></worldbody></mujoco>", [""] * 4
    )
    starts = world.data.xpos[[tool.body for tool in world.scene.tools]]
    expected = [[0.87, 2, 3], [1.13, 2, 3], [0.87, 2.05, 3], [1.13, 2.05, 3]]
    assert starts == pytest.approx(np.array(expected))


@pytest.mark.parametrize("joints", [SLIDES, SLIDES.replace("/>", " ref='.5'/>"), "<freejoint/>"])
def test_bodies_of_the_scene_are_tools_and_begin_where_they_stand(joints: str) -> None:
    body = f"<body name='ball' pos='.1 .2 .3' gravcomp='1'>{joints}<geom size='.02' mass='.1'/></body>"
    world = hold(world_of(f"<mujoco><worldbody>{body}</worldbody></mujoco>", ["ball"]))
    assert world.data.xpos[world.scene.tools[0].body] == pytest.approx([0.1, 0.2, 0.3])
    assert world.proxy(0) == pytest.approx(np.zeros(3), abs=1e-15)
    for _ in range(100):
        world.step(np.array([[0.1, 0.0, 0.0]]))
    assert world.proxy(0)[0] > 0.01
    assert world.balance_error_j <= 1e-14


def test_a_body_of_that_name_comes_before_the_word() -> None:
    scene = scene_of(BALL, "ball", "box")
    assert scene.model.body("ball").id == scene.tools[0].body
    assert scene.tools[0].turns
    assert scene.object == -1, "the only free body is a tool"


def test_urdf_is_read() -> None:
    scene = make_scene(URDF, SEAT, STEP)
    assert scene.model.body("arm").id > 0
    assert scene.object == -1


# Scenes that cannot be used ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bodies", "tools", "words"),
    [
        ("<bad/>", [""], r"x\.xml: does not load: XML Error: Schema violation: unrecognized element Element 'bad', line 1$"),
        ("<geom>", [""], r"does not load: mismatched tag: line 1, column \d+$"),
        ("<body name='b'><freejoint/></body>", [""], r"mass and inertia .* name 'b', id 1, .*; give the body a geom with mass"),
        (BALL, ["bull"], r"""no body 'bull' to be a tool; its bodies are ball; or take "pad", "ball", "box" or "pinch"$"""),
        ("", ["hand"], r"""there is no body 'hand' to be a tool; or take"""),
        (BALL, ["ball", "ball"], r"two seats have the tool 'ball'; name a body for each"),
        ("<body name='b'><joint/><geom size='.1'/></body>", ["b"], r"body 'b' cannot be a tool: it needs a free joint"),
        (f"<body name='b' euler='0 0 90'>{SLIDES}<geom size='.1'/></body>", ["b"], r"cannot be a tool: .* unturned$"),
        ("<body name='b'><geom size='.1'/></body>", ["b"], r"body 'b' cannot be a tool"),
        ("<geom type='mesh' mesh='m'/></worldbody><asset><mesh name='m' file='cup.msh'/></asset><worldbody>", [""],
         r"^x\.xml: mesh 'cup\.msh' is a file, and the scene has no folder that it is in$"),
        ("</worldbody><include file='/etc/passwd'/><worldbody>", [""], r"include '/etc/passwd' is a file"),
        ("<geom size='nan'/>", [""], r"does not load: "),
        ("</worldbody><option gravity='0 0 nan'/><worldbody>" + BALL, [""], r"leave all bounds in the first step; look"),
        ("</worldbody><option gravity='0 0 -1e30'/><worldbody>" + BALL, [""], r"leave all bounds in the first step"),
        ("</worldbody><size memory='100G'/><worldbody>", [""], r"allocate memory; make it smaller: a scene has 1024 MB$"),
        ("<geom size='1'/>" * 20000, [""], r"has more than 20000 elements; leave some out$"),
    ],
)  # fmt: skip
def test_a_scene_that_cannot_be_used_has_its_line(bodies: str, tools: list[str], words: str) -> None:
    text = f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
    with pytest.raises(SceneError, match=words) as caught:
        make_scene(text, [Held(tool, "left", "") for tool in tools], STEP, "x.xml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("part", "compiler", "refused"),
    [("visual", "", False), ("visual", '<compiler discardvisual="false"/>', True), ("collision", "", True)],
)
def test_what_a_urdf_shows_is_left_out_as_mujoco_does_and_said(part: str, compiler: str, refused: bool) -> None:
    mesh = f'<{part}><geometry><mesh filename="package://arm.stl"/></geometry></{part}></link>'
    text = URDF.replace("</link>", mesh, 1).replace("</robot>", f"<mujoco>{compiler}</mujoco></robot>")
    if refused:
        with pytest.raises(SceneError, match=r"mesh 'package://arm\.stl' is a file, and the scene has no folder"):
            make_scene(text, SEAT, STEP)
    else:
        scene = make_scene(text, SEAT, STEP)
        assert scene.unused == ("1 mesh file that a URDF shows (package://arm.stl)",)


def test_document_types_with_which_another_reader_could_see_other_elements_are_refused() -> None:
    levels = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 12))
    with pytest.raises(SceneError, match=r"has a document type, which MuJoCo does not read; take the <!DOCTYPE> out"):
        make_scene(f'<!DOCTYPE mujoco [<!ENTITY e0 "spam">{levels}]><mujoco model="&e11;"/>', SEAT, STEP)


def test_files_that_are_none(tmp_path: Path) -> None:
    large, raw, pipe = tmp_path / "large.xml", tmp_path / "raw.xml", tmp_path / "pipe.xml"
    with large.open("wb") as file:
        file.truncate(1_000_000_000)  # sparse
    raw.write_bytes(b"<mujoco>\xff</mujoco>")
    os.mkfifo(pipe)
    for path, words in (
        (tmp_path / "none.xml", "there is no such file; give MJCF or URDF"),
        (tmp_path, "is no regular file"),
        (pipe, "is no regular file"),
        (large, f"has more than {MOST_BYTES // 10**6} MB; make it smaller"),
        (raw, "cannot be read: 'utf-8' codec"),
    ):
        with pytest.raises(SceneError, match=words) as caught:
            load_scene(path, SEAT, STEP)
        assert str(path) in str(caught.value)
