"""Workspace of a scene; which bodies beside its object and tools have left it, and which nobody can reach any more."""

from collections.abc import Sequence

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Row
from cogrip.server.worlds.departures import put_back_text
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.world import Array
from cogrip.server.worlds.world_step import REACH_M, WORKSPACE_M

_POSE, _RATES = 7, 6  # coordinates and rates of a free joint


class Workspace:
    """Cube about the scene's middle (`statistic` of MJCF) in which its bodies are expected.

    half_m: the scene's extent, or more where a body would have less than WORKSPACE_M from its start. Beyond reach is as many
    times that as REACH_M is WORKSPACE_M.
    """

    def __init__(self, scene: Scene) -> None:
        model = scene.model
        self.middle: Array = model.stat.center.copy()
        free = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        starts = np.abs(scene.start.data(model).xpos[free] - self.middle)
        self.half_m = max(float(model.stat.extent), float(starts.max(initial=0.0)) + WORKSPACE_M)
        self._reach_m = self.half_m * REACH_M / WORKSPACE_M

    def has(self, places: Array) -> NDArray[np.bool_]:
        """Return whether places of the world [m], shape (..., 3), are inside."""
        return self._within(places, self.half_m)

    def reaches(self, places: Array) -> NDArray[np.bool_]:
        """Return whether places of the world [m], shape (..., 3), are within reach."""
        return self._within(places, self._reach_m)

    def _within(self, places: Array, half_m: float) -> NDArray[np.bool_]:
        inside: NDArray[np.bool_] = np.logical_and.reduce(np.abs(places - self.middle) <= half_m, axis=-1)
        return inside


class SceneBodies:
    """Watches the bodies that move in the world by joints of their own, and what hangs on them with them.

    One that left the workspace is told once; a free one beyond reach goes back, at rest. Where a tool is tied to something,
    none is put back: what ties it could be stretched by that.
    """

    def __init__(self, scene: Scene, workspace: Workspace, tied: bool) -> None:
        model = scene.model
        self._workspace, self._tied = workspace, tied
        others = {scene.object, *[tool.body for tool in scene.tools]}
        fixed = model.body_weldid[model.body_parentid] == 0
        self._bodies = [
            body
            for body in range(1, model.nbody)
            if fixed[body] and model.body_weldid[body] == body and model.body_jntnum[body] and body not in others
        ]
        self._names = [model.body(body).name or f"body {body}" for body in self._bodies]
        joints = [int(model.body_jntadr[body]) for body in self._bodies]
        self._free = np.array([model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE for joint in joints], dtype=bool)
        self._first = [int(model.jnt_qposadr[joint]) for joint in joints]
        self._dofs = [int(model.jnt_dofadr[joint]) for joint in joints]
        start = scene.start.data(model)
        self._start, self._places = start.qpos.copy(), start.xpos[self._bodies]
        self._left = np.zeros(len(joints), dtype=bool)

    def departed(self, data: mujoco.MjData) -> Sequence[tuple[str, Row]]:
        """Return the bodies that are outside of the workspace for the first time, each with its place from its start [m]."""
        if not self._bodies:
            return ()
        outside = ~self._workspace.has(data.xpos[self._bodies]) & ~self._left
        if not outside.any():
            return ()
        self._left |= outside
        off = data.xpos[self._bodies] - self._places
        return [(self._names[each], tuple(off[each].tolist())) for each in np.flatnonzero(outside).tolist()]

    def put_back(self, data: mujoco.MjData, events: list[str]) -> Sequence[int]:
        """Put bodies that are beyond reach where they started, at rest. Return them; the caller brings data up to it.

        events: where each is told. The energy that bodies get or lose so is nobody's.
        """
        if self._tied or not self._left.any():
            return ()
        beyond = np.flatnonzero(self._free & ~self._workspace.reaches(data.xpos[self._bodies])).tolist()
        for each in beyond:
            pose, rates = self._first[each], self._dofs[each]
            data.qpos[pose : pose + _POSE] = self._start[pose : pose + _POSE]
            data.qvel[rates : rates + _RATES] = 0.0
            events.append(put_back_text(self._names[each]))
        return [self._bodies[each] for each in beyond]
