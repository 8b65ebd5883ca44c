"""Ports of a scene's tools whose orientation is driven: their last three axes, in the world's frame (theory 8.5).

A tool stays as it is turned when somebody takes it, however the hand is turned: D = R_tool^-1 R_hand is kept for that hold, and
R_tool D is compared with the hand. Both turning by the same rotation leaves D as it is.

Rows are those of `World.step`, shape (n, 6), of which the last three columns of driven tools are meant.
"""

from collections.abc import Sequence

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.machine.rows import Vector
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.laws.rotations import UNTURNED, Quaternion, exp, inverse, product, turned
from cogrip.server.worlds.orientation_drift import Array, DriftCorrection
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.world import turn


class TurningPorts(DriftCorrection):
    """dofs: three of each driven tool, shape (driven, 3)."""

    def __init__(self, scene: Scene, frame_s: float) -> None:
        super().__init__([user for user, tool in enumerate(scene.tools) if tool.driven], frame_s)
        self._begun, self._tools = scene.start.data(scene.model).qpos, scene.tools
        self.dofs = np.array([range(scene.tools[user].dof + 3, scene.tools[user].dof + 6) for user in self.driven])
        self._bodies = [scene.tools[user].body for user in self.driven]
        self._held = dict.fromkeys(self.driven, UNTURNED)  # D

    def damping(self, user: int, impedance_nms: Array) -> Array:
        """Return the damper of b_r, shape (1,), that a held tool turns against, shape (3,), or (0,) where it does not turn."""
        tool = self._tools[user]
        if not tool.turns:
            return np.zeros(0)
        return np.repeat(impedance_nms if tool.orientation in ("driven", "damped") else 0.0, 3)

    def take(self, data: mujoco.MjData, user: int, rotation_rad: Sequence[float]) -> None:
        """Let a hand that is turned so take hold of a driven tool as that is turned."""
        if user in self.drift:
            self._held[user] = product(inverse(self._tool(data, user)), exp(rotation_rad))
            self.begin(user)

    def put(self, data: mujoco.MjData, user: int, rotation_rad: Sequence[float]) -> None:
        """Turn a driven tool as its hand is turned, at rest."""
        if user in self._held:
            at, dof = self._quaternion(user), self._tools[user].dof
            data.qpos[at] = product(exp(rotation_rad), self._begun[at].tolist())
            data.qvel[dof + PLACES : dof + POSE_AXES] = 0.0

    def rates(self, data: mujoco.MjData, user: int) -> Vector:
        """Return the angular velocity of a tool that turns, in the world's frame."""
        dof = self._tools[user].dof
        return turned(data.qpos[self._quaternion(user)].tolist(), data.qvel[dof + PLACES : dof + POSE_AXES].tolist())

    def in_tool(self, data: mujoco.MjData, user: int, torque_nm: Sequence[float]) -> Vector:
        """Return a torque of the world's frame in the tool's own."""
        return turned(inverse(data.qpos[self._quaternion(user)].tolist()), torque_nm)

    def turned(self, data: mujoco.MjData, user: int) -> Quaternion:
        """Return how the proxy of a hand is turned: R_tool D; R_tool, the turn from its start, of a tool that is not driven."""
        if not self._tools[user].turns:
            return UNTURNED
        turned = self._tool(data, user)
        return product(turned, self._held[user]) if user in self._held else turned

    def _tool(self, data: mujoco.MjData, user: int) -> Quaternion:
        at = self._quaternion(user)
        return product(data.qpos[at].tolist(), inverse(self._begun[at].tolist()))

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
        out[self.driven, PLACES:] = turn(matrices, rows[self.driven, PLACES:])
        return out

    @property
    def saved_numbers(self) -> int:
        return super().saved_numbers + 4 * len(self.driven)

    def save(self) -> tuple[float, ...]:
        return (*super().save(), *[number for held in self._held.values() for number in held])

    def restore(self, saved: Sequence[float]) -> None:
        drifts = super().saved_numbers
        super().restore(saved[:drifts])
        for place, user in enumerate(self.driven):
            w, x, y, z = saved[drifts + 4 * place : drifts + 4 * place + 4]
            self._held[user] = w, x, y, z
