"""Ports of tools whose orientation is driven: their last three axes, in the world's frame (theory 8.5).

Rows are those of `World.step`, shape (n, 6), of which the last three columns of driven tools are meant.
"""

from collections.abc import Sequence

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.rotations import UNTURNED, Quaternion, exp, inverse, product
from cogrip.protocol.setting_types import PLACES
from cogrip.protocol.settings import SeatSettings
from cogrip.server.worlds.orientation_drift import SAVED, OrientationDrift
from cogrip.server.worlds.scene_file import Scene

Array = NDArray[np.float64]
Row = tuple[float, ...]


class TurningPorts:
    """driven: numbers of the seats that turn their tools; dofs: three of each, shape (driven, 3); impedance: b_r, shape (n, 1),
    or b_g of a gripper (`opening_ports`).

    drift: of each driven tool, by number of its seat
    """

    def __init__(self, scene: Scene, seats: Sequence[SeatSettings], frame_s: float) -> None:
        self._model, self._tools, self._half_frame_s = scene.model, scene.tools, 0.5 * frame_s
        self.driven = [user for user, tool in enumerate(scene.tools) if tool.driven]
        self.dofs = np.array([range(scene.tools[user].dof + 3, scene.tools[user].dof + 6) for user in self.driven])
        self.impedance = np.array([[seat.coupling.behind] for seat in seats])
        self._square_m = np.array([[seat.coupling.unit**2] for seat in seats])
        self._bodies = [scene.tools[user].body for user in self.driven]
        self.drift = {user: OrientationDrift(frame_s) for user in self.driven}

    def set_impedance(self, user: int, impedance_nspm: float) -> None:
        """Go with the impedance of a seat's places: the characteristic length stays."""
        self.impedance[user] = self._square_m[user] * impedance_nspm

    def damping(self, user: int) -> Array:
        """Return the damper that a held tool turns against, shape (3,), or (0,) where it does not turn."""
        tool = self._tools[user]
        if not tool.turns:
            return np.zeros(0)
        return np.repeat(self.impedance[user] if tool.orientation in ("driven", "damped") else 0.0, 3)

    def place(self, data: mujoco.MjData, user: int, rotation_rad: Sequence[float]) -> None:
        """Turn a driven tool as its hand is turned."""
        if user in self.drift:
            at = self._quaternion(user)
            data.qpos[at] = product(exp(rotation_rad), self._model.qpos0[at].tolist())
            self.drift[user].begin()

    def turned(self, data: mujoco.MjData, user: int) -> Quaternion:
        """Return by how much a tool is turned from its start."""
        if not self._tools[user].turns:
            return UNTURNED
        at = self._quaternion(user)
        return product(data.qpos[at].tolist(), inverse(self._model.qpos0[at].tolist()))

    def _quaternion(self, user: int) -> slice:
        return slice(self._tools[user].coordinate + 3, self._tools[user].coordinate + 7)

    def frames(self, data: mujoco.MjData) -> Array:
        """Return the orientation of each driven tool as a matrix, shape (driven, 3, 3)."""
        frames: Array = data.xmat[self._bodies].reshape(-1, 3, 3) if self._bodies else np.zeros((0, 3, 3))
        return frames

    def to_world(self, frames: Array, rows: Array) -> Array:
        """Return rows turned from the tools' own frames to the world's."""
        return self._turn(frames, rows)

    def to_tools(self, frames: Array, rows: Array) -> Array:
        """Return rows turned from the world's frame to the tools' own."""
        return self._turn(frames.transpose(0, 2, 1), rows)

    def _turn(self, matrices: Array, rows: Array) -> Array:
        out = rows.copy()
        out[self.driven, PLACES:] = (matrices * rows[self.driven, PLACES:][:, None, :]).sum(axis=2)
        return out

    def corrected(self, u: Array, level_j: float) -> Array:
        """Return the waves with what turns tools back to their hands, as far as a ledger at this level pays for it."""
        out = u.copy()
        for user, drift in self.drift.items():
            out[user, PLACES:] += np.array(drift.correction_radps) * np.sqrt(0.5 * self.impedance[user])
        cost_j = self._half_frame_s * float(np.add.reduce(out * out - u * u, axis=None))
        return u if cost_j > max(0.0, level_j) else out

    def watch(self, data: mujoco.MjData, rates: Array, added: Array) -> None:
        """Enter a step: mean rates of the tools, and the waves in it that were not their hands'."""
        for user, drift in self.drift.items():
            theirs = rates[user, PLACES:] - added[user, PLACES:] / np.sqrt(
                2.0 * self.impedance[user]
            )  # sqrt(2b) w = u + v
            drift.step(self.turned(data, user), theirs.tolist())

    @property
    def saved_numbers(self) -> int:
        """Return the length of a saved state."""
        return SAVED * len(self.driven)

    def save(self) -> Row:
        """Return the state between two frames."""
        return tuple([number for drift in self.drift.values() for number in drift.save()])

    def restore(self, saved: Row) -> None:
        """Continue from a saved state."""
        for place, drift in enumerate(self.drift.values()):
            drift.restore(saved[SAVED * place : SAVED * (place + 1)])
