"""Geometry of which a client makes its own copy of a scene (`coupling.kind = "partner"`, theory 5b.3), and scenes without one.

A copy has one free body, the object, what is fixed, and the tools. It is made of numbers alone: a client reads no scene.
"""

from collections.abc import Iterator

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.protocol.drawing import MOST_COPIED, Shape, ShapeKind, Solid
from cogrip.protocol.laws.scene_contact import GEOM
from cogrip.server.worlds.scenes.scene_file import Scene

_G = mujoco.mjtGeom
_KINDS: dict[int, ShapeKind] = {
    int(_G.mjGEOM_PLANE): "plane", int(_G.mjGEOM_BOX): "box", int(_G.mjGEOM_SPHERE): "sphere",
    int(_G.mjGEOM_CAPSULE): "capsule", int(_G.mjGEOM_CYLINDER): "cylinder", int(_G.mjGEOM_ELLIPSOID): "ellipsoid",
}  # fmt: skip
_USUAL_FLAGS = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET) | int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
UNSEEN_M = 0.001  # radius of the shape that stands for a tool without any
NO_FRICTION = 0.0, 0.0, 0.0
_PLAIN_DOF = ("dof_damping", "dof_frictionloss", "dof_armature")


def copied_geometry(scene: Scene, seat: int) -> tuple[Shape, ...]:
    """Return what the client of a seat is told: shapes in the hand's own frame, of the object in its own, of tools in theirs.

    Where tools turn, frames of object and tools are those that are turned as the world's at the start.

    scene: as it was loaded, no world has changed its contact yet; one of which `unfit_copy` says nothing
    """
    model, data = scene.model, scene.start.data(scene.model)
    start, turning = data.xpos[scene.tools[seat].body], any(tool.turns for tool in scene.tools)
    tools = {tool.body: number for number, tool in enumerate(scene.tools)}
    told: list[Shape] = []
    begun: set[int] = set()
    for geom in np.flatnonzero(_solid(model)).tolist():
        body = int(model.geom_bodyid[geom])
        fixed = body != scene.object and body not in tools
        turned = np.zeros(4)
        if fixed or turning:
            place = data.geom_xpos[geom] - (start if fixed else data.xpos[body])
            mujoco.mju_mat2Quat(turned, data.geom_xmat[geom])
        else:
            place, turned = model.geom_pos[geom], model.geom_quat[geom]
        inertia = () if fixed or body in begun else _inertia(scene, data, body, turning)
        begun.add(body)
        told.append(
            Shape(
                _KINDS[int(model.geom_type[geom])], tuple(model.geom_size[geom].tolist()), place_m=tuple(place.tolist()),
                orientation=tuple(turned.tolist()), seat=tools.get(body), object=body == scene.object,
                solid=Solid(
                    tuple(model.geom_friction[geom].tolist()),
                    (int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])), inertia,
                ),
            )
        )  # fmt: skip
    for body in tools.keys() - begun:  # a tool that touches nothing, but holds
        solid = Solid(NO_FRICTION, (0, 0), _inertia(scene, data, body, turning))
        told.append(Shape("sphere", (UNSEEN_M, 0.0, 0.0), seat=tools[body], solid=solid))
    return tuple(told)


def unfit_copy(scene: Scene) -> str:
    """Return why clients can make no copy of a scene, "" where they can."""
    return next(_unfit(scene), "")


def _unfit(scene: Scene) -> Iterator[str]:
    yield from _unfit_bodies(scene)
    yield from _unfit_forces(scene)
    yield from _unfit_geoms(scene)


def _unfit_bodies(scene: Scene) -> Iterator[str]:
    model, tools = scene.model, [tool.body for tool in scene.tools]
    if scene.object < 0:
        yield "it has no free body for people to hold"
    known = {scene.object, *tools}
    own = [body for body in range(1, model.nbody) if model.body_weldid[body] == body and body not in known]
    if own:
        yield f"{model.body(own[0]).name or f'body {own[0]}'!r} moves as well, and one body is all that may"
    for tool in scene.tools:
        name = model.body(tool.body).name
        if tool.turns and not tool.driven:
            yield f'tool {name!r} turns, and its hand does not turn it; set object.axes = 6 and orientation = "driven"'
        if not tool.turns and model.body_gravcomp[tool.body] != 1.0:
            yield f'tool {name!r} weighs something; give it gravcomp="1"'


def _unfit_forces(scene: Scene) -> Iterator[str]:
    model = scene.model
    dofs = np.isin(model.dof_bodyid, [scene.object, *[tool.body for tool in scene.tools]])
    if any(np.any(getattr(model, key)[dofs]) for key in _PLAIN_DOF) or np.any(model.jnt_stiffness):
        yield "joints have springs, dampers, friction or armature of their own"
    if np.any(model.jnt_limited):
        yield "joints have limits"
    if model.ntendon or model.nu or model.nflex or model.npair or model.nexclude:
        yield "it has tendons, actuators, flexible bodies, or pairs of geoms of its own"
    if model.neq != len(_welded(scene)):
        yield "it has other equalities than a weld of the object's frame and that of a tool that turns"
    option = model.opt
    if option.disableflags & ~_USUAL_FLAGS:
        yield "its flags disable a part of the physics"
    if model.body_gravcomp[scene.object] or option.density or option.viscosity or np.any(option.wind):
        yield "its object floats in something, or weighs less than gravity says"


def _unfit_geoms(scene: Scene) -> Iterator[str]:
    model = scene.model
    if scene.own or np.any(model.geom_gap) or len(set(model.geom_priority.tolist())) > 1:
        yield f"it sets contact of its own ({', '.join(scene.own) or 'gap or priority of geoms'})"
    solid = np.flatnonzero(_solid(model)).tolist()
    for geom in solid:
        name = model.geom(geom).name or f"geom {geom}"
        if int(model.geom_type[geom]) not in _KINDS:
            yield f"{name!r} is no plane, box, sphere, capsule, cylinder or ellipsoid"
        if model.geom_condim[geom] != GEOM["condim"]:
            yield f"{name!r} sets contact of its own"
    if len(solid) > MOST_COPIED:
        yield f"it has {len(solid)} geoms that touch something, and a copy has {MOST_COPIED} at most"


def _solid(model: mujoco.MjModel) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    found: np.ndarray[tuple[int], np.dtype[np.bool_]] = (model.geom_contype | model.geom_conaffinity) != 0
    return found


def _welded(scene: Scene) -> set[int]:
    """Return the tools that are welded to the object as they both begin."""
    model, tools, found = scene.model, {tool.body for tool in scene.tools if tool.driven}, set()
    begun = scene.start.data(model)
    for number in range(model.neq):
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        anchor, place, turn = np.split(model.eq_data[number, :10], (3, 6))
        there, turned = np.zeros(3), np.zeros(4)
        mujoco.mju_rotVecQuat(there, place, begun.xquat[first])
        mujoco.mju_mulQuat(turned, begun.xquat[first], turn)
        if (
            model.eq_type[number] == mujoco.mjtEq.mjEQ_WELD
            and model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_BODY
            and model.eq_active0[number]
            and first == scene.object
            and second in tools
            and not anchor.any()
            and model.eq_data[number, 10] == 1.0
            and np.allclose(there, begun.xpos[second] - begun.xpos[first], atol=1e-6)
            and abs(float(np.add.reduce(turned * begun.xquat[second]))) > 1.0 - 1e-9
        ):
            found.add(second)
    return found


def _inertia(scene: Scene, data: mujoco.MjData, body: int, turning: bool) -> tuple[float, ...]:
    model = scene.model
    mass, middle, axes = float(model.body_mass[body]), model.body_ipos[body], model.body_iquat[body]
    if turning:
        middle, axes = data.xipos[body] - data.xpos[body], np.zeros(4)
        mujoco.mju_mat2Quat(axes, data.ximat[body])
    elif body != scene.object:
        return (mass,)
    parts = [middle, model.body_inertia[body], axes]
    if body == scene.object:
        parts.append(model.opt.gravity)
    else:
        parts.append(model.body_gravcomp[body : body + 1])
        if body in _welded(scene):
            parts.append(data.xpos[body] - data.xpos[scene.object])
    return (mass, *[each for part in parts for each in part.tolist()])
