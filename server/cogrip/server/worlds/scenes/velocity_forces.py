"""Coriolis and gyroscopic forces of linked bodies, taken at the middle of a step: at its start they make energy as bodies spin.

    M (v+ - v) / h + C(v) = f        f: all other forces        h step, M mass matrix, v and v+ velocity before and after

C does no work at the velocity it is taken at. Of a body on a ball joint, thin and spinning at w about its axis, C(v) lets what
is across the axis grow by 1 + (h w)^2 / 2 a step; a chain of two hinges gains as well. With C at w = (v + v+) / 2,

    v+ - v = h M^-1 (f - C(w))        w = v + h/2 M^-1 (f - C(w)),  by iteration

it does none over the step. f is taken to be what it was in the step before, M (v+ - v) / h + C(w) of that: it includes contact,
dampers and whatever else MuJoCo solved. A free body alone, a hinge alone and slides have no such forces, or MuJoCo's are good.
"""

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers
from cogrip.machine.rows import Row

Array = NDArray[np.float64]
MOST_ITERATIONS = 20
TOLERANCE = 1e-8  # largest change of w in an iteration after which it ends, as a share of 1 and of the fastest velocity
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


class VelocityForces:
    """numbers: of a saved state. Where a scene has no such trees of bodies it does nothing and has none."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._dofs = linked_dofs(model)
        self.numbers = model.nv + 1 if len(self._dofs) else 0
        self._h = float(model.opt.timestep)
        self._velocity, self._force, self._moved = np.zeros((3, model.nv))
        self._acceleration = np.zeros((1, model.nv))
        self.forget()

    def forget(self) -> None:
        """Begin anew: f is not known, and in the next step C is that of its start."""
        self._known = False
        self._others: Array = np.zeros(self._model.nv)

    def correct(self, data: mujoco.MjData) -> None:
        """Replace C(v) by C(w), once after each `mj_step1`."""
        if not self.numbers:
            return
        model, dofs, velocity, bias = self._model, self._dofs, data.qvel.copy(), data.qfrc_bias
        self._velocity = velocity
        if not self._known:
            return
        least = TOLERANCE * (1.0 + float(np.abs(velocity).max()))
        middle = velocity.copy()
        for _ in range(MOST_ITERATIONS):
            mujoco.mj_solveM(model, data, self._acceleration, (self._others - bias)[None])
            nearer = velocity[dofs] + 0.5 * self._h * self._acceleration[0, dofs]
            change = float(np.abs(nearer - middle[dofs]).max())
            middle[dofs] = nearer
            data.qvel[:] = middle
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 0, self._force)
            bias[dofs] = self._force[dofs]
            if not change > least:
                break
        data.qvel[:] = velocity
        mujoco.mj_comVel(model, data)

    def follow(self, data: mujoco.MjData) -> None:
        """Find f of the step that was solved, once after each `mj_step2`."""
        if self.numbers:
            mujoco.mj_mulM(self._model, data, self._moved, (data.qvel - self._velocity) / self._h)
            self._others = self._moved + data.qfrc_bias
            self._known = True

    def save(self) -> Row:
        """Return the state between two steps."""
        return (float(self._known), *self._others.tolist()) if self.numbers else ()

    def restore(self, saved: Row) -> None:
        """Continue from a saved state."""
        if self.numbers:
            known, *others = saved
            self._known, self._others = bool(known), np.array(others)


def linked_dofs(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Return the degrees of freedom of trees of bodies that turn, and have more than one joint or a ball joint."""
    found: list[int] = []
    for tree in range(model.ntree):
        dofs = np.flatnonzero(model.dof_treeid == tree)
        kinds = model.jnt_type[np.unique(model.dof_jntid[dofs])]
        ball = bool(np.any(kinds == mujoco.mjtJoint.mjJNT_BALL))
        if ball or (len(kinds) > 1 and add_integers((kinds != _SLIDE).tolist())):
            found += dofs.tolist()
    return np.array(found, dtype=np.intp)
