"""Accelerations from which the solver of a crowded scene starts: a straight line through those of the two steps before.

    a = 2 a_1 - a_2        a_1: solved in the last step, where MuJoCo would start from, a_2 in the one before

Where many bodies are pushed together this spares a quarter of the work. The answers are the same within the solver's tolerance.
"""

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Row


class WarmStart:
    """numbers: of a saved state. Where a scene is not crowded it does nothing and has none."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._crowded = bool(mujoco.mj_isSparse(model))
        self.numbers = model.nv if self._crowded else 0
        self.forget()

    def forget(self) -> None:
        """Begin anew, at rest."""
        self._before: NDArray[np.float64] = np.zeros(self.numbers)

    def extrapolate(self, data: mujoco.MjData) -> None:
        """Set where the next step starts from, once before each."""
        if self._crowded:
            last = data.qacc_warmstart.copy()
            data.qacc_warmstart[:] = 2.0 * last - self._before
            self._before = last

    def save(self) -> Row:
        """Return the state between two steps."""
        return tuple(self._before.tolist())

    def restore(self, saved: Row) -> None:
        """Continue from a saved state."""
        self._before = np.array(saved)
