"""Motion of a scene's object: its place from its start [m] and, of six axes, its rotation vector [rad] in the world's frame."""

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.laws.rotations import UNTURNED, exp, inverse, log, product, turned
from cogrip.server.worlds.scenes.scene_file import Scene

Array = NDArray[np.float64]


class SceneObject:
    """The first free body that is no tool; where there is none, all is 0. It has no opening: 0 on the axis of a gripper.

    start  its place at the start [m]
    """

    def __init__(self, scene: Scene, data: mujoco.MjData) -> None:
        model = scene.model
        self._data, self.there = data, scene.object >= 0
        joint = model.body_jntadr[scene.object]
        first = int(model.jnt_qposadr[joint]) if self.there else 0
        self._dof = int(model.jnt_dofadr[joint]) if self.there else 0
        self._places, self._quaternion = slice(first, first + 3), slice(first + 3, first + 7)
        begun = scene.start.data(model).qpos
        self.start: Array = begun[self._places].copy() if self.there else np.zeros(3)
        self._unturned = begun[self._quaternion].tolist() if self.there else UNTURNED

    @property
    def at(self) -> Array:
        """Place in the world [m]."""
        found: Array = self._data.qpos[self._places]
        return found

    def place(self, axes: int) -> Array:
        """Return where it is, shape (axes,)."""
        place = np.zeros(axes)
        if self.there:
            place[:PLACES] = self._data.qpos[self._places] - self.start
            if axes == POSE_AXES:
                place[PLACES:] = log(product(self._data.qpos[self._quaternion].tolist(), inverse(self._unturned)))
        return place

    def put(self, value: Array) -> None:
        """Put it there, at rest."""
        self._data.qpos[self._places] = self.start + value[:PLACES]
        if len(value) == POSE_AXES:
            self._data.qpos[self._quaternion] = product(exp(value[PLACES:].tolist()), self._unturned)
        self._data.qvel[self._dof : self._dof + 6] = 0.0

    def velocity(self, axes: int) -> Array:
        """Return its velocity [m/s], and of six axes its angular velocity [rad/s]."""
        rates = np.zeros(axes)
        if self.there:
            rates[:PLACES] = self._data.qvel[self._dof : self._dof + 3]
            if axes == POSE_AXES:
                rates[PLACES:] = turned(
                    self.orientation.tolist(), self._data.qvel[self._dof + 3 : self._dof + 6].tolist()
                )
        return rates

    def push(self, value: Array) -> None:
        """Give it this velocity."""
        self._data.qvel[self._dof : self._dof + 3] = value[:PLACES]

    def motion(self) -> Row:
        """Return place and velocity of three axes, in plain floats."""
        moved = self._data.qpos[self._places] - self.start
        return (*moved.tolist(), *self._data.qvel[self._dof : self._dof + 3].tolist())

    @property
    def orientation(self) -> Array:
        """Quaternion w, x, y, z."""
        if not self.there:
            return np.array([1.0, 0.0, 0.0, 0.0])
        found: Array = self._data.qpos[self._quaternion].copy()
        return found
