"""Free bodies of a scene beside its object and tools: which have left the workspace, and which nobody can reach any more."""

from collections.abc import Sequence

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.protocol.setting_types import PLACES
from cogrip.server.departures import put_back_text
from cogrip.server.worlds.scene_file import Scene
from cogrip.server.worlds.world_step import REACH_M, WORKSPACE_M, Row

_POSE, _RATES = 7, 6  # coordinates and rates of a free joint


class SceneBodies:
    """Watches where they are, from where each starts. One that left is told once; one beyond reach goes back, at rest.

    Where a tool is tied to something, none is put back: what ties it could be stretched by that.
    """

    def __init__(self, scene: Scene, tied: bool) -> None:
        model = scene.model
        others = {scene.object, *[tool.body for tool in scene.tools]}
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist()
        joints = [joint for joint in free if int(model.jnt_bodyid[joint]) not in others]
        self._numbers = bodies = [int(model.jnt_bodyid[joint]) for joint in joints]
        self._names = [model.body(body).name or f"body {body}" for body in bodies]
        self._first = [int(model.jnt_qposadr[joint]) for joint in joints]
        self._dofs = [int(model.jnt_dofadr[joint]) for joint in joints]
        self._places = np.array([range(first, first + PLACES) for first in self._first], dtype=int)
        self._start = model.qpos0.copy()
        self._left = np.zeros(len(joints), dtype=bool)
        self._tied = tied

    def departed(self, data: mujoco.MjData) -> Sequence[tuple[str, Row]]:
        """Return the bodies that are outside of the workspace for the first time, each with its place from its start [m]."""
        if not self._names:
            return ()
        off = data.qpos[self._places] - self._start[self._places]
        outside = (np.abs(off) > WORKSPACE_M).any(axis=1) & ~self._left
        if not outside.any():
            return ()
        self._left |= outside
        return [(self._names[each], tuple(off[each].tolist())) for each in np.flatnonzero(outside).tolist()]

    def put_back(self, data: mujoco.MjData, events: list[str]) -> Sequence[int]:
        """Put bodies that are beyond reach where they started, at rest. Return them; the caller brings data up to it.

        events: where each is told. The energy that bodies get or lose so is nobody's.
        """
        if self._tied or not self._left.any():
            return ()
        off = data.qpos[self._places] - self._start[self._places]
        beyond = np.flatnonzero((np.abs(off) > REACH_M).any(axis=1)).tolist()
        for each in beyond:
            pose, rates = self._first[each], self._dofs[each]
            data.qpos[pose : pose + _POSE] = self._start[pose : pose + _POSE]
            data.qvel[rates : rates + _RATES] = 0.0
            events.append(put_back_text(self._names[each]))
        return [self._numbers[each] for each in beyond]
