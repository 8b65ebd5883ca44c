"""State of a scene's bodies: their energy, and the bounds beyond which nobody goes on from it."""

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.server.worlds.scenes.scene_file import MOST_RATE
from cogrip.server.worlds.world import WorldError, dot

_CONTACTS_FULL, _ROWS_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL)


class SceneEnergy:
    """Kinetic and potential energy of all bodies. MuJoCo's potential counts weight that `gravcomp` carries: here it does not.

    now_j  as measured last
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self.now_j = 0.0

    def begin(self, data: mujoco.MjData) -> None:
        """Count from this state, which was changed by hand."""
        self._weigh()
        self.gain(data)

    def _weigh(self) -> None:
        model = self._model
        self._carried = carried = np.flatnonzero(model.body_gravcomp)
        self._weight = (model.body_gravcomp[carried] * model.body_mass[carried])[:, None] * model.opt.gravity

    def of(self, data: mujoco.MjData) -> float:
        """Return the energy of a state [J], as of now."""
        self._weigh()
        self.gain(data)
        return self.now_j

    def gain(self, data: mujoco.MjData) -> float:
        """Return how much energy the bodies have got since the call before [J]."""
        before, carried_j = self.now_j, 0.0
        if len(self._carried):
            carried_j = dot(self._weight, data.xipos[self._carried])
        self.now_j = float(data.energy[0] + data.energy[1]) + carried_j
        return self.now_j - before


def check_rates(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Raise WorldError where a velocity is beyond MOST_RATE, or no number: which body was so fast, and where that was."""
    rates = data.qvel
    if not dot(rates, rates) < MOST_RATE**2:
        sizes = np.where(np.isfinite(rates), np.abs(rates), np.inf)
        fastest = int(np.argmax(sizes))
        body = int(model.dof_bodyid[fastest])
        x, y, z = 1e3 * data.xpos[body]
        raise WorldError(
            f"the scene left all bounds at {data.time:.3f} s: {model.body(body).name or f'body {body}'}, last at "
            f"{x:.3g}, {y:.3g}, {z:.3g} mm, has a velocity of {sizes[fastest]:.3g}"
        )


def check_memory(data: mujoco.MjData) -> None:
    """Raise WorldError where contacts were left out."""
    warnings = data.warning.number
    if warnings[_CONTACTS_FULL] or warnings[_ROWS_FULL]:
        raise WorldError(f"the scene has more contacts than its memory at {data.time:.3f} s: raise <size memory> in it")
