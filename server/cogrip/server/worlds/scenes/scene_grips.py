"""A seat's tool in the model of a scene as the scene has it: what comes back when somebody takes it."""

from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.server.worlds.scenes.scene_file import Tool
from cogrip.server.worlds.world import Array


class Grip(NamedTuple):
    """Values of a seat's tool in the model as the scene has them. tied: more than contact holds it (`is_tied`)."""

    geoms: list[int]
    contype: Array
    conaffinity: Array
    damping: Array
    gravcomp: float
    tied: bool


def grip_of(model: mujoco.MjModel, tool: Tool) -> Grip:
    """Return these values of a tool."""
    body, dofs = tool.body, slice(tool.dof, tool.dof + tool.dofs)
    geoms = [geom for geom in range(model.ngeom) if model.body_rootid[model.geom_bodyid[geom]] == body]
    contact = model.geom_contype[geoms].copy(), model.geom_conaffinity[geoms].copy()
    return Grip(geoms, *contact, model.dof_damping[dofs].copy(), float(model.body_gravcomp[body]), is_tied(model, tool))


def is_tied(model: mujoco.MjModel, tool: Tool) -> bool:
    """Return whether more than contact can hold a tool: to put it elsewhere would then stretch something."""
    tree = np.flatnonzero(model.body_rootid == tool.body)
    joints = slice(model.body_jntadr[tool.body], model.body_jntadr[tool.body] + model.body_jntnum[tool.body])
    return bool(
        held_by_equality(model, tree)
        or np.any(model.jnt_stiffness[joints])
        or np.any(model.jnt_limited[joints])
        or model.ntendon
        or model.nu
        or model.nflex
    )


def held_by_equality(model: mujoco.MjModel, tree: NDArray[np.intp]) -> bool:
    """Return whether an equality holds one of these bodies."""
    bodies: list[int] = []
    for kind, *ends in zip(model.eq_objtype, model.eq_obj1id, model.eq_obj2id, strict=True):
        of = {int(mujoco.mjtObj.mjOBJ_SITE): model.site_bodyid, int(mujoco.mjtObj.mjOBJ_JOINT): model.jnt_bodyid}
        places = of.get(int(kind), np.arange(model.nbody))
        bodies += [int(places[end]) for end in ends if 0 <= end < len(places)]
    return bool(np.isin(bodies, tree).any())
