"""Energy in the springs of a scene's contacts and equalities, which is none of its bodies' own (theory 8.2).

A spring of D0 K I at a stretch r holds D0 K I r^2 / 2. MuJoCo's integrator solves

    f = D0 (-a - B v+ - K I (r + h v+))        D = D0 (1 + h B + h^2 K I)

and gives D, after a step only: it is done with a copy, so that to ask costs a step and changes nothing.
"""

from functools import lru_cache

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_state import SceneEnergy
from cogrip.server.worlds.world import World

_SLIDES = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@lru_cache(maxsize=1)
def _spare(model: mujoco.MjModel) -> mujoco.MjData:
    """Return memory for a copy of a state: to ask for it takes longer than a step."""
    return mujoco.MjData(model)


def uncounted_j(world: World) -> float:
    """Return what a world holds beside its own energy, less what came in beside the waves of its hands [J].

    Of a scene: springs, and what turned its tools back to their hands, which the limiter's ledger paid (theory 8.5).
    """
    return springs_j(world) - world.turning.brought_j if isinstance(world, SceneWorld) else 0.0


def springs_j(world: SceneWorld) -> float:
    """Return what the springs of contacts, equalities and limits hold [J]."""
    if not world.data.nefc:
        return 0.0
    model, data = world.scene.model, _spare(world.scene.model)
    mujoco.mj_copyData(data, model, world.data)
    h = float(model.opt.timestep)
    data.efc_margin[:] = 0.0
    mujoco.mj_step2(model, data)
    stiffness, damping = data.efc_KBIP[:, 0] * data.efc_KBIP[:, 2], data.efc_KBIP[:, 1]
    spring = data.efc_D * stiffness / (1.0 + h * damping + h * h * stiffness)
    both_ways = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    stretched = np.where(both_ways, data.efc_pos, np.minimum(data.efc_pos, 0.0))
    return 0.5 * float((spring * stretched**2).sum())


def half_step_j(world: SceneWorld) -> float:
    """Return how much more energy a scene has at the places of half a step before, with the velocities that it has now [J].

    MuJoCo steps as a leapfrog does, velocities half a step before places: M(x) (v+ - v)/h = f(x) is symmetric, and what it
    keeps is E(x - h/2 v, v). As a pendulum swings E(x, v) goes up and down by h/2 times its power. 0 of free bodies
    and slides alone.
    """
    model = world.scene.model
    if np.isin(model.jnt_type, _SLIDES).all():
        return 0.0
    data = _spare(model)
    mujoco.mj_copyData(data, model, world.data)
    mujoco.mj_integratePos(model, data.qpos, data.qvel, -0.5 * float(model.opt.timestep))
    for compute in (
        mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_flex, mujoco.mj_tendon, mujoco.mj_crb, mujoco.mj_comVel,
        mujoco.mj_energyPos, mujoco.mj_energyVel,
    ):  # fmt: skip
        compute(model, data)
    energy = SceneEnergy(model)
    now, before = (energy.of(each) for each in (world.data, data))
    return before - now
