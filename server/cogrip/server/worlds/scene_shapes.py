"""Shapes that a scene is drawn of: its geoms as MuJoCo has them, those that are fixed in the object's frame at the start.

A mesh is drawn as its hull (`scene_surfaces`), beyond MOST_MESHES, and where it has none, as the box around it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_SHAPES, Shape, ShapeKind
from cogrip.server.worlds.scene_file import Scene
from cogrip.server.worlds.scene_surfaces import MOST_MESHES, surface_parts

_KINDS: dict[int, ShapeKind] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
}
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_SHOWN_GROUPS = 3
"""Number of geom groups that are shown: MuJoCo's own viewer hides further ones, which are for contact alone."""
_NO_COLOUR = (0.5, 0.5, 0.5, 1.0)  # colour of a geom that sets none
_MOST_M = 1e3  # largest number of a shape (`SPEC.md` section 3.15)


class Drawn(NamedTuple):
    """Parts of a drawn scene. bodies: the model's numbers of those that move and have shapes; boxed: meshes drawn as boxes."""

    shapes: tuple[Shape, ...]
    bodies: list[int]
    boxed: tuple[str, ...]


def shapes_of(scene: Scene, start: NDArray[np.float64]) -> Drawn:
    """Return what a scene is drawn of. start: of the object [m]."""
    model = scene.model
    data = scene.start.data(model)
    seats = {tool.body: seat for seat, tool in enumerate(scene.tools)}
    bodies: list[int] = []
    shapes: list[Shape] = []
    boxed: list[str] = []
    meshes = 0
    for geom in range(model.ngeom):
        mesh = model.geom_type[geom] == _MESH
        kind, rgba = "box" if mesh else _KINDS.get(int(model.geom_type[geom])), _colour(model, geom)
        if kind is None or model.geom_group[geom] >= _SHOWN_GROUPS or (rgba is not None and rgba[3] == 0.0):
            continue
        body = int(model.geom_bodyid[geom])
        half = model.geom_aabb[geom, 3:] if mesh else model.geom_size[geom]
        size = tuple(np.clip(half, 0.0, _MOST_M).tolist())
        surface: Sequence[bytes] = ()
        if mesh:
            surface = surface_parts(model, geom) if meshes < MOST_MESHES else ()
            meshes += bool(surface)
            if not surface:
                boxed.append(model.geom(geom).name or model.mesh(model.geom_dataid[geom]).name)
        middle = model.geom_aabb[geom, :3] if mesh else np.zeros(3)  # of the box around a mesh, in its frame
        if model.body_weldid[body] == 0:
            turned = np.zeros(4)
            mujoco.mju_mat2Quat(turned, data.geom_xmat[geom])
            place = data.geom_xpos[geom] + _turned(turned, middle) - start
            shapes += _parts(Shape(kind, size, None, _place(place), tuple(turned.tolist()), rgba), surface)
            continue
        if body not in bodies:
            bodies.append(body)
        whole = Shape(
            kind, size, bodies.index(body), _place(model.geom_pos[geom] + _turned(model.geom_quat[geom], middle)),
            tuple(model.geom_quat[geom].tolist()), rgba,
            seats.get(int(model.body_rootid[body])), body == scene.object,
        )  # fmt: skip
        shapes += _parts(whole, surface)
    return Drawn(tuple(shapes[:MOST_SHAPES]), bodies[:MOST_SHAPES], tuple(boxed))


def _parts(whole: Shape, surface: Sequence[bytes]) -> list[Shape]:
    """Return the shapes of a surface instead of a box; the box where there is none."""
    return [replace(whole, kind="mesh", triangles=part) for part in surface] or [whole]


def _turned(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion)
    return out


def _place(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(np.clip(values, -_MOST_M, _MOST_M).tolist())


def _colour(model: mujoco.MjModel, geom: int) -> tuple[float, ...] | None:
    """Return the colour of a geom or of its material; None where it has neither."""
    own = tuple(model.geom_rgba[geom].tolist())
    if own == _NO_COLOUR and model.geom_matid[geom] >= 0:
        own = tuple(model.mat_rgba[model.geom_matid[geom]].tolist())
    return None if own == _NO_COLOUR else tuple([min(max(round(each, 4), 0.0), 1.0) for each in own])
