"""Geometry with which a client renders contact itself (theory 8.7): the balls of its tool, and fixed shapes that they touch.

All else that the tool can touch is an obstacle: bodies that move, and fixed ones that no client renders. The server's contact
counts there.
"""

from dataclasses import dataclass
from math import dist

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_LOCAL, MOST_PAIRS, Shape, ShapeKind
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.scenes.scene_grips import held_by_equality

_CENTRED_M = 1e-9
_MOST_M = 1e3  # largest number of a shape (`SPEC.md` section 3.15)
_G = mujoco.mjtGeom
_SPHERE = int(_G.mjGEOM_SPHERE)
_RENDERED: dict[int, ShapeKind] = {
    int(_G.mjGEOM_PLANE): "plane", int(_G.mjGEOM_BOX): "box", _SPHERE: "sphere", int(_G.mjGEOM_CAPSULE): "capsule",
    int(_G.mjGEOM_CYLINDER): "cylinder",
}  # fmt: skip
_Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LocalGeometry:
    """Geometry of one seat. Where its tool is always driven by its line, all but `why` is empty.

    why        the tool is always driven by its line; "" where it is not
    balls      geoms of the tool
    obstacles  geoms
    touches    whether a ball touches an obstacle, shape (balls, obstacles)
    shapes     what the client is told, in the hand's own frame: what is fixed, then the balls as they are at its middle
    left_out   names of what is fixed and not told
    """

    why: str
    balls: tuple[int, ...] = ()
    obstacles: tuple[int, ...] = ()
    touches: NDArray[np.bool_] | None = None
    shapes: tuple[Shape, ...] = ()
    left_out: tuple[str, ...] = ()


def local_geometry(scene: Scene, seat: int) -> LocalGeometry:
    """Return the geometry of a seat, of a scene as it was loaded: no world has changed its contact yet."""
    model, tool = scene.model, scene.tools[seat]
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    own = model.body_rootid[model.geom_bodyid] == tool.body
    balls = np.flatnonzero(own & solid)
    if why := _why_driven(scene, seat, balls):
        return LocalGeometry(why)
    others = np.flatnonzero(solid & ~own)
    touches = _touching(model, balls, others)
    others, touches = others[touches.any(axis=0)], touches[:, touches.any(axis=0)]
    data = scene.start.data(model)
    start = data.xpos[tool.body]
    fixtures: list[Shape] = []
    left_out: list[str] = []
    obstacles: list[int] = []
    for place, geom in enumerate(others.tolist()):
        if model.body_weldid[model.geom_bodyid[geom]] != 0:
            obstacles.append(place)
            continue
        shape = _shape(model, data, geom, start)
        fixed = len(fixtures) + 1
        if shape is None or fixed + len(balls) > MOST_LOCAL or fixed * len(balls) > MOST_PAIRS:
            obstacles.append(place)
            left_out.append(model.geom(geom).name or f"geom {geom}")
        else:
            fixtures.append(shape)
    middles = data.geom_xpos[balls] - start
    told = [
        Shape("sphere", (float(model.geom_size[ball, 0]), 0.0, 0.0), place_m=tuple(middle.tolist()), seat=seat)
        for ball, middle in zip(balls, middles, strict=True)
    ]
    return LocalGeometry(
        "", tuple(balls.tolist()), tuple(others[obstacles].tolist()), touches[:, obstacles], (*fixtures, *told),
        tuple(left_out),
    )  # fmt: skip


def tree_of(scene: Scene, seat: int) -> NDArray[np.intp]:
    """Return a tool's body and all that hang on it."""
    tree: NDArray[np.intp] = np.flatnonzero(scene.model.body_rootid == scene.tools[seat].body)
    return tree


def _why_driven(scene: Scene, seat: int, balls: NDArray[np.intp]) -> str:
    """Return why a tool cannot be put where its hand is, "" where it can."""
    model, tool, tree = scene.model, scene.tools[seat], tree_of(scene, seat)
    joints = slice(model.body_jntadr[tool.body], model.body_jntadr[tool.body] + model.body_jntnum[tool.body])
    pairs = np.isin(np.concatenate((model.pair_geom1, model.pair_geom2)), balls).any()
    kinds = model.geom_type[balls]
    reasons = [
        (
            (tool.turns and not tool.driven) or int(model.body_dofnum[tree].sum()) != tool.dofs,
            "it turns, or has joints of its own",
        ),
        (
            tool.driven and not _is_one_ball(scene, seat, balls),
            "its hand turns it, and it is not one ball about its own place",
        ),
        (not len(balls) or np.any(kinds != _SPHERE) or len(balls) >= MOST_LOCAL, "it does not touch with balls alone"),
        (np.any(model.jnt_stiffness[joints]) or np.any(model.jnt_limited[joints]), "its joints have springs or limits"),
        (pairs or held_by_equality(model, tree), "it is tied to other bodies, or has contact pairs of its own"),
        (model.ntendon or model.nu or model.nflex, "the scene has tendons, actuators or flexible bodies"),
    ]
    return next((text for found, text in reasons if found), "")


def unfit_tool(user: str, why: str) -> str:
    """Return why a person cannot have a tool, with the cure."""
    return (
        f'coupling.kind = "local": no client renders contact with the tool of user {user!r}: {why}; set tool = "ball" or '
        'orientation = "fixed", or coupling.kind = "wave"'
    )


def _is_one_ball(scene: Scene, seat: int, balls: NDArray[np.intp]) -> bool:
    """Return whether a tool touches the same however it is turned, and turning does not move it: contact makes no torque."""
    data, body = scene.start.data(scene.model), scene.tools[seat].body
    middles = (*data.geom_xpos[balls], data.subtree_com[body])
    return len(balls) == 1 and all(dist(middle, data.xpos[body]) <= _CENTRED_M for middle in middles)


def _touching(model: mujoco.MjModel, ones: NDArray[np.intp], others: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return whether geoms can touch, shape (ones, others)."""
    kind, answers, body = model.geom_contype, model.geom_conaffinity, model.geom_bodyid
    touches: NDArray[np.bool_] = (kind[ones, None] & answers[others]) | (answers[ones, None] & kind[others]) != 0
    one, other = body[ones, None], body[others]
    excluded = np.isin((one << 16) + other, model.exclude_signature) | np.isin(
        (other << 16) + one, model.exclude_signature
    )
    return touches & ~excluded


def _shape(model: mujoco.MjModel, data: mujoco.MjData, geom: int, start: _Array) -> Shape | None:
    """Return a fixed geom as it is told, None where no client renders it."""
    kind, place, size = _RENDERED.get(int(model.geom_type[geom])), data.geom_xpos[geom] - start, model.geom_size[geom]
    if kind is None or max(np.abs(place).max(), size.max()) > _MOST_M:
        return None
    size = np.zeros(3) if kind == "plane" else np.maximum(size, 0.0)  # planes have no end, however they are drawn
    turned = np.zeros(4)
    mujoco.mju_mat2Quat(turned, data.geom_xmat[geom])
    return Shape(kind, tuple(size.tolist()), place_m=tuple(place.tolist()), orientation=tuple(turned.tolist()))
