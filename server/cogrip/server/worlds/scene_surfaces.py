"""Surfaces of a scene's meshes as they are drawn: their convex hulls, which are what contact takes them for.

A hull of more than MOST_CORNERS corners is drawn as the one of fewer that MuJoCo finds inside of it: contact keeps the whole.
"""

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_TRIANGLES, pack_triangles
from cogrip.server.worlds.world import turn

PARTS = 4  # most shapes of one mesh
MOST_CORNERS = PARTS * MOST_TRIANGLES // 2 + 2
"""Most corners of a mesh's surface: a closed one of n corners has 2 n - 4 triangles."""
MOST_MESHES = 16  # most meshes of a scene that are drawn as hulls; told one a view, all are there after a second


def surface_parts(model: mujoco.MjModel, geom: int) -> list[bytes]:
    """Return the hull of a mesh in the parts of a shape each, in the box around it; none where MuJoCo makes no hull of it."""
    mesh = model.geom_dataid[geom]
    first = model.mesh_vertadr[mesh]
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    triangles = (_hull(model.mesh_vert[first : first + model.mesh_vertnum[mesh]]) - middle).tolist()
    return [
        pack_triangles(triangles[at : at + MOST_TRIANGLES], half.tolist())
        for at in range(0, len(triangles), MOST_TRIANGLES)
    ]


def _hull(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the triangles of the corners' hull, outside counter-clockwise, shape (triangles, 3, 3); none of what is flat."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="hull", uservert=corners.ravel().tolist(), maxhullvert=MOST_CORNERS)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
    try:
        hull = spec.compile()
    except ValueError:  # flat, or too small
        return np.zeros((0, 3, 3))
    frame = np.zeros(9)
    mujoco.mju_quat2Mat(frame, hull.mesh_quat[0])
    placed: NDArray[np.float64] = turn(frame.reshape(3, 3), hull.mesh_vert) + hull.mesh_pos[0]
    count = int(hull.mesh_graph[1])  # behind it the faces come last
    triangles: NDArray[np.float64] = placed[hull.mesh_graph[-3 * count :].reshape(count, 3)]
    return triangles
