"""Shapes that a scene is drawn of, as MuJoCo draws them: its geoms and sites, those that are fixed in the object's frame at the
start; its flexible bodies and tendons, through points that move.

Meshes and height fields are drawn by their triangles, a bounded number of them (`scene_surfaces`); where too few are left for
one it is drawn as the box around it.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers
from cogrip.protocol.drawing import MOST_SHAPES, Shape, ShapeKind
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.scenes.scene_points import NO_COLOUR, ScenePoints, colour_of, with_mean
from cogrip.server.worlds.scenes.scene_surfaces import FIELD, MESH, is_surface, shares, surface_of, textured
from cogrip.server.worlds.scenes.scene_textures import texture_of, tile_of

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
_SHOWN_GROUPS = 3
"""Number of geom groups that are shown: MuJoCo's own viewer hides further ones, which are for contact alone."""
_MOST_M = 1e3  # largest number of a shape (`SPEC.md` section 3.15)


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
    share = shares(model, [each.geom for each in things if each.geom is not None and is_surface(model, each.geom)])
    for thing in things:
        size, middle, rgba = thing.size, np.zeros(3), thing.rgba
        parts: list[dict[str, object]] = []
        if thing.geom in share:
            own = np.array(rgba or NO_COLOUR)
            surface = surface_of(model, thing.geom, share[thing.geom], own[:3]) if share[thing.geom] else None
            if surface is not None:
                middle, size = surface.middle, surface.half
                parts = [{"kind": "mesh", "triangles": part} for part in surface.parts]
                for part, colours in zip(parts, surface.colours, strict=False):
                    part["colours"] = colours
                if surface.colours:
                    rgba = _mean_colour(surface.colours, own[3])
                coarser += [_name(model, thing.geom)] if surface.coarser else []
            elif model.geom_type[thing.geom] in (MESH, FIELD):
                size, middle = model.geom_aabb[thing.geom, 3:], model.geom_aabb[thing.geom, :3]
                boxed.append(_name(model, thing.geom))
        elif thing.geom is not None and (texture := textured(model, thing.geom)):  # of a plane
            own = np.array(rgba or NO_COLOUR)
            cells, period = tile_of(texture, size)
            tile = np.round(255.0 * np.clip(cells * own[:3], 0.0, 1.0)).astype(np.uint8).tobytes()
            rgba, parts = _mean_colour([tile], own[3]), [{"colours": tile, "period_m": period}]
        place = thing.at + _turned(thing.turned, middle)
        sizes, turned = _place(np.maximum(size, 0.0)), tuple(thing.turned.tolist())
        whole = Shape(thing.kind, sizes, None, _place(place - start), turned, rgba)
        if model.body_weldid[thing.body] != 0:
            if thing.body not in bodies:
                bodies.append(thing.body)
            whole = replace(
                whole, body=bodies.index(thing.body), place_m=_place(place),
                seat=seats.get(int(model.body_rootid[thing.body])), object=thing.body == scene.object,
            )  # fmt: skip
        shapes += [replace(whole, **part) for part in parts] or [whole]
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
            if is_site or textured(model, number) is None:
                rgba = with_mean(model, rgba, int(materials[number]))
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
    others = {int(each) for each in (*model.site_matid, *model.flex_matid, *model.tendon_matid)}
    geoms = [geom for geom in range(model.ngeom) if texture_of(model, int(model.geom_matid[geom])) is not None]
    if any(texture_of(model, each) for each in others) or not all(textured(model, geom) for geom in geoms):
        yield "textures but on planes, height fields and meshes with coordinates, and cubes of textures (the mean colour is)"
    if any(model.mat_reflectance[each] > 0.0 for each in used):
        yield "reflections"
    if model.nskin:
        yield "skins"
    hidden = add_integers(int((groups >= _SHOWN_GROUPS).sum()) for groups in (model.geom_group, model.site_group))
    if hidden:
        yield f"{hidden} geoms and sites of the groups 3 to 5, which MuJoCo's viewer hides at first"


def _mean_colour(colours: Sequence[bytes], alpha: float) -> tuple[float, ...]:
    """Return the mean of red, green, blue, a byte each, with an alpha: for what cannot draw each of them."""
    mean = np.frombuffer(b"".join(colours), dtype=np.uint8).reshape(-1, 3).mean(axis=0) / 255.0
    return tuple(np.round([*mean, alpha], 4).tolist())


def _name(model: mujoco.MjModel, geom: int) -> str:
    data, kind = model.geom_dataid[geom], model.geom_type[geom]
    of = model.mesh(data).name if kind == MESH else model.hfield(data).name if kind == FIELD else f"geom {geom}"
    return str(model.geom(geom).name or of)


def _turned(quaternion: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion)
    return out


def _place(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(np.clip(values, -_MOST_M, _MOST_M).tolist())
