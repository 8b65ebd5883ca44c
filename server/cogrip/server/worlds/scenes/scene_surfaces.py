"""Surfaces of a scene as they are drawn: triangles of its meshes and height fields, as MuJoCo draws them, bounded.

What has a texture is drawn by triangles small enough that each has one colour of it, other forms than meshes, too. A surface of
more triangles than its share is drawn by fewer: corners that lie in one cell of a grid become one, a height field loses rows
and columns. Contact keeps the whole.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_COLOURED, MOST_TRIANGLES, pack_triangles
from cogrip.server.worlds.scenes.scene_textures import Texture, colours_of, texture_of

MOST_SCENE_TRIANGLES = 12_000  # most triangles of all surfaces; told one part a view, all are there after four seconds
MESH, FIELD = int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD)
_BALL, _EGG = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
_BOX, _PLANE = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_PLANE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_TEXTURED = 2000  # least number of triangles that a surface with a texture is to have
_MOST_PARTS = 64  # most parts of a triangle along one of its edges
_FEWEST = 12  # least number of triangles that are left of a larger surface: of fewer it has no form
_FINEST, _TRIES = 256, 12
"""Cells along the longest side of the finest grid for a coarser surface, and number of coarser ones that are tried."""


Array = NDArray[np.float64]
Triangles = NDArray[np.float64]  # corners [m] in the frame of their geom, outside counter-clockwise: (n, 3, 3)


class Surface(NamedTuple):
    """A surface in the box around it. middle, half: of the box, in the geom's frame [m]; coarser: by fewer triangles.

    colours: of each part's triangles, as a `Shape` has them; none without a texture
    """

    middle: Array
    half: Array
    parts: list[bytes]
    colours: list[bytes]
    coarser: bool


def textured(model: mujoco.MjModel, geom: int) -> Texture | None:
    """Return the texture that a geom is drawn with; None where it has none, or one that its form has no rule for."""
    texture, kind = texture_of(model, int(model.geom_matid[geom])), model.geom_type[geom]
    if texture is None or texture.cube:
        return texture if kind != _PLANE else None
    flat = kind in (_PLANE, FIELD) or (kind == MESH and model.mesh_texcoordadr[model.geom_dataid[geom]] >= 0)
    return texture if flat else None


def is_surface(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether a geom is drawn by triangles."""
    kind, data = model.geom_type[geom], model.geom_dataid[geom]
    if kind == MESH:
        return bool(model.mesh_facenum[data] > 0)
    if kind == FIELD:
        return bool(min(model.hfield_nrow[data], model.hfield_ncol[data]) > 1)
    return kind != _PLANE and textured(model, geom) is not None


def shares(model: mujoco.MjModel, geoms: Sequence[int]) -> dict[int, int]:
    """Return how many triangles each geom may have: what small ones leave goes to large ones; 0 where too little is left."""
    left, found = MOST_SCENE_TRIANGLES, {}
    sizes = sorted((_count(model, geom), geom) for geom in geoms)
    for at, (size, geom) in enumerate(sizes):
        share = min(size, left // (len(sizes) - at))
        found[geom] = share if share >= min(size, _FEWEST) else 0
        left -= found[geom]
    return found


def surface_of(model: mujoco.MjModel, geom: int, most: int, rgb: Array) -> Surface:
    """Return a surface by at most so many triangles. rgb: colour of the geom, which a texture is multiplied by."""
    data, texture = int(model.geom_dataid[geom]), textured(model, geom)
    half_m, places = model.geom_size[geom].astype(float), None
    if model.geom_type[geom] == FIELD:
        triangles, half_m = _field(model, data, most), model.hfield_size[data, :3]
    elif model.geom_type[geom] == MESH:
        triangles, places = _coarser(*_mesh(model, data), most)
        triangles, places = _divided(triangles, places, most) if texture else (triangles, places)
        half_m = np.ones(3)
    else:
        triangles, half_m = _form(int(model.geom_type[geom]), half_m, most)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    placed, size = (triangles - middle).tolist(), MOST_COLOURED if texture else MOST_TRIANGLES
    cuts = range(0, len(placed), size)
    colours: list[bytes] = []
    if texture is not None:
        found = colours_of(texture, triangles, half_m, None if texture.cube else places) * rgb
        painted = np.round(255.0 * np.clip(found, 0.0, 1.0)).astype(np.uint8)
        colours = [painted[at : at + size].tobytes() for at in cuts]
    parts = [pack_triangles(placed[at : at + size], half.tolist()) for at in cuts]
    return Surface(middle, half, parts, colours, most < _count(model, geom))


def _count(model: mujoco.MjModel, geom: int) -> int:
    data, kind = model.geom_dataid[geom], model.geom_type[geom]
    if kind == FIELD:
        return _field_count(int(model.hfield_nrow[data]), int(model.hfield_ncol[data]))
    own = int(model.mesh_facenum[data]) if kind == MESH else 12
    return own * _parts(own, _TEXTURED) ** 2 if textured(model, geom) else own


def _parts(triangles: int, most: int) -> int:
    """Return into how many parts each edge of so many triangles is to be divided."""
    return max(1, min(_MOST_PARTS, int((most / triangles) ** 0.5)))


def _field_count(rows: int, columns: int) -> int:
    """Return the triangles of a height field: two a cell, two a cell of its border, two of its bottom."""
    return 2 * (rows - 1) * (columns - 1) + 4 * (rows - 1) + 4 * (columns - 1) + 2


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[Triangles, Array | None]:
    """Return the triangles of a mesh, and the coordinates of their corners on a texture, where it has some."""
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corners = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
    triangles: Triangles = corners[model.mesh_face[faces]].astype(np.float64)
    if model.mesh_texcoordadr[mesh] < 0:
        return triangles, None
    places = model.mesh_texcoord[model.mesh_texcoordadr[mesh] :][: model.mesh_texcoordnum[mesh]]
    return triangles, places[model.mesh_facetexcoord[faces]].astype(np.float64)


def _coarser(triangles: Triangles, places: Array | None, most: int) -> tuple[Triangles, Array | None]:
    """Return the triangles, or of more than `most` what is left of them where the corners in each cell of a grid are one."""
    cells = float(_FINEST)
    low = triangles.min(axis=(0, 1))
    widest = max(float((triangles.max(axis=(0, 1)) - low).max()), 1e-12)
    for _ in range(_TRIES):
        if len(triangles) <= most:
            break
        corners = triangles.reshape(-1, 3)
        _, cell, count = np.unique(
            np.floor((corners - low) * (cells / widest)), axis=0, return_inverse=True, return_counts=True
        )
        cell = cell.reshape(-1)
        middles = np.stack([np.bincount(cell, corners[:, axis]) / count for axis in range(3)], axis=1)
        faces = cell.reshape(-1, 3)
        apart = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        triangles, places = middles[faces[apart]], None if places is None else places[apart]
        cells *= min(0.9, (most / max(1, len(triangles))) ** 0.5)
    return triangles[:most], None if places is None else places[:most]


def _divided(triangles: Triangles, places: Array | None, most: int) -> tuple[Triangles, Array | None]:
    """Return each triangle as the k^2 of its form that it has room for."""
    k = _parts(len(triangles), min(most, _TEXTURED))
    upright = [[(i, j), (i + 1, j), (i, j + 1)] for i in range(k) for j in range(k - i)]
    turned = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i in range(k) for j in range(k - i - 1)]
    at = np.array(upright + turned) / k
    weights = np.stack([1.0 - at.sum(axis=2), at[..., 0], at[..., 1]], axis=2)
    parts, of = (
        None
        if each is None
        else np.add.reduce(weights[..., None] * each[:, None, None], axis=3).reshape(-1, 3, each.shape[2])
        for each in (triangles, places)
    )
    assert parts is not None
    return parts, of


def _form(kind: int, size_m: Array, most: int) -> tuple[Triangles, Array]:
    """Return a form that is no mesh by about so many triangles, and half of the box around it."""
    a, b, _ = size_m.tolist()
    k = _parts(12, min(most, _TEXTURED))
    if kind == _BOX:
        cube = _divided(_CUBE, None, most)[0]
        return cube * size_m, size_m
    sectors, rows = 4 * k, max(2, k + 1)
    angle = np.linspace(0.0, 2.0 * np.pi, sectors + 1)
    if kind in (_BALL, _EGG):
        half = np.array([a, a, a]) if kind == _BALL else size_m
        rises = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows + 1)
        radii, heights, scale = np.cos(rises), np.sin(rises), half
    elif kind == _CAPSULE:
        rises = np.linspace(0.0, 0.5 * np.pi, max(2, rows // 2) + 1)
        ends = np.cos(rises), b + a * np.sin(rises)
        radii = np.concatenate((ends[0][::-1], ends[0]))
        heights, scale, half = np.concatenate((-ends[1][::-1], ends[1])), np.array([a, a, 1.0]), np.array([a, a, a + b])
    else:
        radii = np.concatenate(([0.0], np.ones(max(2, rows - 1)), [0.0]))
        heights = np.concatenate(([-1.0], np.linspace(-1.0, 1.0, len(radii) - 2), [1.0]))
        half = scale = np.array([a, a, b])
    around = radii[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grid = np.concatenate((around, np.broadcast_to(heights[:, None, None], (*around.shape[:2], 1))), axis=2) * scale
    triangles = _sheet(grid)
    sides = np.sqrt(np.add.reduce(np.square(triangles - np.roll(triangles, 1, axis=1)), axis=2))
    return triangles[(sides > 1e-9 * sides.max()).all(axis=1)], half


def _field(model: mujoco.MjModel, field: int, most: int) -> Triangles:
    """Return the top, the four sides and the bottom of a height field."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first = model.hfield_adr[field]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    x_m, y_m, top_m, base_m = model.hfield_size[field].tolist()
    kept = [np.arange(rows), np.arange(columns)]
    while _field_count(len(kept[0]), len(kept[1])) > most and max(map(len, kept)) > 2:
        longer = 0 if len(kept[0]) >= len(kept[1]) else 1
        size = (rows, columns)[longer]
        kept[longer] = np.unique(np.linspace(0, size - 1, max(2, int(0.9 * len(kept[longer])))).round().astype(int))
    v, u = np.meshgrid(*kept, indexing="ij")
    top = np.stack(
        [x_m * (2 * u / (columns - 1) - 1), y_m * (2 * v / (rows - 1) - 1), top_m * heights[v, u]], axis=2
    ).astype(np.float64)
    low = top.copy()
    low[..., 2] = -base_m
    edges = (np.s_[0, :], np.s_[-1, ::-1], np.s_[::-1, 0], np.s_[:, -1])  # to the right, as seen from outside
    sides = [np.stack([low[edge], top[edge]]) for edge in edges]
    return np.concatenate([_sheet(each) for each in (top, *sides, low[np.ix_((0, -1), (-1, 0))])])


def _sheet(grid: Triangles) -> Triangles:
    """Return two triangles a cell of a grid of places, columns to the right and rows upwards as seen from outside."""
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    return np.concatenate([np.stack(each, axis=2).reshape(-1, 3, 3) for each in ((a, b, c), (a, c, d))])


def _cube() -> Triangles:
    """Return the twelve triangles of a box with half edges of 1."""
    square = np.array([[[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0]], [[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]])
    up = _sheet(square)
    sides = [np.roll(up, axis, axis=2) for axis in range(3)]
    return np.concatenate([*sides, *[-each[:, ::-1] for each in sides]])


_CUBE = _cube()
