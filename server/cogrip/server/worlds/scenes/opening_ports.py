"""Ports of tools that are grippers: the opening, one axis behind the places, whose force acts between finger and thumb.

It is a port as those of the places are (`scene`, theory 8.1), with an impedance b_g of its own: a force sqrt(2 b_g) u and a
damper b_g at the finger's joint. Rows are those of `World.step`, shape (n, 4), of which the last column of grippers is meant.
"""

import mujoco  # type: ignore[import-untyped]

from cogrip.server.worlds.scenes.scene_file import Scene


class OpeningPorts:
    """users: numbers of the seats whose tools are grippers; dofs: one of each.

    An opening of 0 is the coordinate that the joint has in the file.
    """

    def __init__(self, scene: Scene) -> None:
        model = scene.model
        self._model = model
        self.users = [user for user, tool in enumerate(scene.tools) if tool.opening >= 0]
        joints = [scene.tools[user].opening for user in self.users]
        self.dofs = model.jnt_dofadr[joints].tolist()
        self._coordinates = dict(zip(self.users, model.jnt_qposadr[joints].tolist(), strict=True))
        self._dof_of = dict(zip(self.users, self.dofs, strict=True))
        self._own_damping = {user: float(model.dof_damping[dof]) for user, dof in self._dof_of.items()}

    def damp(self, user: int, damping: float) -> None:
        """Give a gripper the damper of its port; 0: nobody holds it."""
        if user in self._dof_of:
            self._model.dof_damping[self._dof_of[user]] = self._own_damping[user] + damping

    def rest(self, data: mujoco.MjData, user: int) -> None:
        """Let a finger stand still, without force."""
        if user in self._dof_of:
            data.qvel[self._dof_of[user]] = data.qfrc_applied[self._dof_of[user]] = 0.0

    def place(self, data: mujoco.MjData, user: int, opening_m: float) -> None:
        """Open a gripper as far as its hand has."""
        if user in self._coordinates:
            at = self._coordinates[user]
            data.qpos[at] = self._model.qpos0[at] + opening_m

    def opening(self, data: mujoco.MjData, user: int) -> float:
        """Return the opening of a tool [m], 0 of one that is no gripper."""
        if user not in self._coordinates:
            return 0.0
        at = self._coordinates[user]
        return float(data.qpos[at] - self._model.qpos0[at])
