"""A seat's tool in the model of a scene as the scene has it: what comes back when somebody takes it."""

from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]

from cogrip.server.worlds.scene_file import Tool
from cogrip.server.worlds.world import Array


class Grip(NamedTuple):
    """Values of a seat's tool in the model as the scene has them."""

    geoms: list[int]
    contype: Array
    conaffinity: Array
    damping: Array
    gravcomp: float


def grip_of(model: mujoco.MjModel, tool: Tool) -> Grip:
    """Return these values of a tool."""
    body, dofs = tool.body, slice(tool.dof, tool.dof + tool.dofs)
    geoms = [geom for geom in range(model.ngeom) if model.body_rootid[model.geom_bodyid[geom]] == body]
    contact = model.geom_contype[geoms].copy(), model.geom_conaffinity[geoms].copy()
    return Grip(geoms, *contact, model.dof_damping[dofs].copy(), float(model.body_gravcomp[body]))
