"""Surfaces of a scene as they are drawn: triangles of its meshes and height fields, as MuJoCo draws them, bounded.

A surface of more triangles than its share is drawn by fewer: corners that lie in one cell of a grid become one, a height field
loses rows and columns. Contact keeps the whole.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_TRIANGLES, pack_triangles

MOST_SCENE_TRIANGLES = 12_000  # of all surfaces; told one part a view, all are there after four seconds
MESH, FIELD = int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD)
_FEWEST = 12  # triangles: of a share of less a surface has no form
_FINEST, _TRIES = 256, 12  # cells along the longest side of a coarser surface's box; coarser ones that are tried

Triangles = NDArray[
    np.float64
]  # corners [m] in the frame of their geom, outside counter-clockwise, shape (triangles, 3, 3)


class Surface(NamedTuple):
    """A surface in the box around it. middle, half: of the box, in the geom's frame [m]; coarser: by fewer triangles."""

    middle: NDArray[np.float64]
    half: NDArray[np.float64]
    parts: list[bytes]
    coarser: bool


def shares(model: mujoco.MjModel, geoms: Sequence[int]) -> dict[int, int]:
    """Return how many triangles each geom may have: what small ones leave goes to large ones; 0 where too little is left."""
    left, found = MOST_SCENE_TRIANGLES, {}
    sizes = sorted((_count(model, geom), geom) for geom in geoms)
    for at, (size, geom) in enumerate(sizes):
        share = min(size, left // (len(sizes) - at))
        found[geom] = share if share >= min(size, _FEWEST) else 0
        left -= found[geom]
    return found


def surface_of(model: mujoco.MjModel, geom: int, most: int) -> Surface:
    """Return a mesh or a height field by at most so many triangles."""
    if model.geom_type[geom] == FIELD:
        triangles = _field(model, int(model.geom_dataid[geom]), most)
    else:
        triangles = _coarser(_mesh(model, int(model.geom_dataid[geom])), most)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    placed = (triangles - middle).tolist()
    parts = [
        pack_triangles(placed[at : at + MOST_TRIANGLES], half.tolist()) for at in range(0, len(placed), MOST_TRIANGLES)
    ]
    return Surface(middle, half, parts, len(triangles) < _count(model, geom))


def _count(model: mujoco.MjModel, geom: int) -> int:
    data = model.geom_dataid[geom]
    if model.geom_type[geom] == MESH:
        return int(model.mesh_facenum[data])
    return _field_count(int(model.hfield_nrow[data]), int(model.hfield_ncol[data]))


def _field_count(rows: int, columns: int) -> int:
    """Return the triangles of a height field: two a cell, two a cell of its border, two of its bottom."""
    return 2 * (rows - 1) * (columns - 1) + 4 * (rows - 1) + 4 * (columns - 1) + 2


def _mesh(model: mujoco.MjModel, mesh: int) -> Triangles:
    corner, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    corners = model.mesh_vert[corner : corner + model.mesh_vertnum[mesh]]
    triangles: Triangles = corners[model.mesh_face[face : face + model.mesh_facenum[mesh]]].astype(np.float64)
    return triangles


def _coarser(triangles: Triangles, most: int) -> Triangles:
    """Return the triangles, or of more than `most` what is left of them where the corners in each cell of a grid are one."""
    cells = float(_FINEST)
    corners = triangles.reshape(-1, 3)
    low = corners.min(axis=0)
    widest = max(float((corners.max(axis=0) - low).max()), 1e-12)
    for _ in range(_TRIES):
        if len(triangles) <= most:
            break
        _, cell, count = np.unique(
            np.floor((corners - low) * (cells / widest)), axis=0, return_inverse=True, return_counts=True
        )
        cell = cell.reshape(-1)
        middles = np.stack([np.bincount(cell, corners[:, axis]) / count for axis in range(3)], axis=1)
        faces = cell.reshape(-1, 3)
        apart = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        triangles = middles[faces[apart]]
        cells *= min(0.9, (most / max(1, len(triangles))) ** 0.5)
    return triangles[:most]


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
