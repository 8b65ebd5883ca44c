"""Shapes that a scene is drawn of, as MuJoCo draws them: its geoms and sites, those that are fixed in the object's frame at the
start; its flexible bodies and tendons, through points that move.

Meshes and height fields are drawn by their triangles, a bounded number of them (`scene_surfaces`); where too few are left for
one it is drawn as the box around it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_SHAPES, Shape, ShapeKind
from cogrip.server.worlds.scene_file import Scene
from cogrip.server.worlds.scene_points import ScenePoints, colour_of
from cogrip.server.worlds.scene_surfaces import FIELD, MESH, shares, surface_of

_KINDS: dict[int, ShapeKind] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
    MESH: "box",
    FIELD: "box",
}
_SHOWN_GROUPS = 3  # MuJoCo's own viewer hides further ones: they are for contact alone
_MOST_M = 1e3  # bounds of a shape (`SPEC.md` section 3.15)


class Drawn(NamedTuple):
    """Parts of a drawn scene.

    bodies    the model's numbers of those that move and have shapes; behind them come the points
    points    what flexes and tendons are drawn through
    boxed     surfaces drawn as boxes
    coarser   surfaces drawn by fewer triangles than they have
    left_out  what MuJoCo draws of the scene and these shapes have not, in words
    """

    shapes: tuple[Shape, ...]
    bodies: list[int]
    points: ScenePoints
    boxed: tuple[str, ...]
    coarser: tuple[str, ...]
    left_out: tuple[str, ...]


class _Thing(NamedTuple):
    """A geom or a site. at, turned: in its body's frame, or in the world where that is fixed."""

    kind: ShapeKind
    size: NDArray[np.float64]
    body: int
    at: NDArray[np.float64]
    turned: NDArray[np.float64]
    rgba: tuple[float, ...] | None
    geom: int | None = None


def shapes_of(scene: Scene, start: NDArray[np.float64]) -> Drawn:
    """Return what a scene is drawn of. start: of the object [m]."""
    model = scene.model
    data = scene.start.data(model)
    seats = {tool.body: seat for seat, tool in enumerate(scene.tools)}
    bodies: list[int] = []
    shapes: list[Shape] = []
    boxed: list[str] = []
    coarser: list[str] = []
    things = list(_things(model, data))
    share = shares(model, [each.geom for each in things if each.geom is not None and _is_surface(model, each.geom)])
    for thing in things:
        size, middle, parts = thing.size, np.zeros(3), []
        if thing.geom in share:
            size, middle = model.geom_aabb[thing.geom, 3:], model.geom_aabb[thing.geom, :3]
            if share[thing.geom]:
                middle, size, parts, fewer = surface_of(model, thing.geom, share[thing.geom])
            name = _name(model, thing.geom)
            boxed += [] if parts else [name]
            coarser += [name] if parts and fewer else []
        place = thing.at + _turned(thing.turned, middle)
        whole = Shape(
            thing.kind,
            _place(np.maximum(size, 0.0)),
            None,
            _place(place - start),
            tuple(thing.turned.tolist()),
            thing.rgba,
        )
        if model.body_weldid[thing.body] != 0:
            if thing.body not in bodies:
                bodies.append(thing.body)
            whole = replace(
                whole, body=bodies.index(thing.body), place_m=_place(place),
                seat=seats.get(int(model.body_rootid[thing.body])), object=thing.body == scene.object,
            )  # fmt: skip
        shapes += [replace(whole, kind="mesh", triangles=part) for part in parts] or [whole]
    points = ScenePoints(model, len(bodies), _SHOWN_GROUPS)
    shapes += points.shapes
    left_out = (*_left_out(model), *points.left_out)
    if len(shapes) > MOST_SHAPES or len(bodies) > MOST_SHAPES:
        left_out = (f"{len(shapes) - MOST_SHAPES} shapes beyond {MOST_SHAPES}", *left_out)
    return Drawn(tuple(shapes[:MOST_SHAPES]), bodies[:MOST_SHAPES], points, tuple(boxed), tuple(coarser), left_out)


def _things(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[_Thing]:
    """Yield geoms, then sites, that MuJoCo's viewer shows at first."""
    rows = (
        (
            model.ngeom, model.geom_type, model.geom_group, model.geom_rgba, model.geom_matid, model.geom_size,
            model.geom_bodyid, model.geom_pos, model.geom_quat, data.geom_xpos, data.geom_xmat,
        ),
        (
            model.nsite, model.site_type, model.site_group, model.site_rgba, model.site_matid, model.site_size,
            model.site_bodyid, model.site_pos, model.site_quat, data.site_xpos, data.site_xmat,
        ),
    )  # fmt: skip
    for is_site, (count, types, groups, rgbas, materials, sizes, owners, places, turns, at, matrices) in enumerate(
        rows
    ):
        for number in range(count):
            kind = _KINDS.get(int(types[number]))
            rgba = colour_of(model, rgbas[number], int(materials[number]))
            if kind is None or groups[number] >= _SHOWN_GROUPS or (rgba is not None and rgba[3] == 0.0):
                continue
            body, place, turned = int(owners[number]), places[number], turns[number]
            if model.body_weldid[body] == 0:
                place, turned = at[number], np.zeros(4)
                mujoco.mju_mat2Quat(turned, matrices[number])
            yield _Thing(kind, sizes[number], body, place, turned, rgba, None if is_site else number)


def _left_out(model: mujoco.MjModel) -> Iterator[str]:
    """Yield what MuJoCo draws of a scene and shapes do not say."""
    if model.nlight:
        yield "lights (a view has its own)"
    if any(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX):
        yield "the skybox"
    used = {
        int(each)
        for each in (*model.geom_matid, *model.site_matid, *model.flex_matid, *model.tendon_matid)
        if each >= 0
    }
    if any((model.mat_texid[each] >= 0).any() for each in used):
        yield "textures"
    if any(model.mat_reflectance[each] > 0.0 for each in used):
        yield "reflections"
    if model.nskin:
        yield "skins"
    hidden = sum(int((groups >= _SHOWN_GROUPS).sum()) for groups in (model.geom_group, model.site_group))
    if hidden:
        yield f"{hidden} geoms and sites of the groups 3 to 5, which MuJoCo's viewer hides at first"


def _is_surface(model: mujoco.MjModel, geom: int) -> bool:
    return model.geom_type[geom] in (MESH, FIELD)


def _name(model: mujoco.MjModel, geom: int) -> str:
    data = model.geom_dataid[geom]
    of = model.mesh(data) if model.geom_type[geom] == MESH else model.hfield(data)
    return str(model.geom(geom).name or of.name)


def _turned(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion)
    return out


def _place(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(np.clip(values, -_MOST_M, _MOST_M).tolist())
