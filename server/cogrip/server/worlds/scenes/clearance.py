"""Distance of a tool's balls from all that they are to keep clear of: how far the tool can go before it is near anything.

    gap = least over balls and obstacles of (distance - NEAR_M - s T)        s: bound of an obstacle's speed, T frame

A tool that goes by less than its gap, whatever the direction, passes through nothing (conservative advancement).
"""

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.server.worlds.scenes.local_geometry import LocalGeometry
from cogrip.server.worlds.scenes.scene_file import Scene

NEAR_M = 0.005  # distance within which contacts are looked for
_PLANE, _FIELD = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)
_Array = NDArray[np.float64]


class Clearance:
    """Clearance of one seat's tool; `geometry` has its balls and obstacles."""

    def __init__(self, scene: Scene, geometry: LocalGeometry, frame_s: float) -> None:
        model = scene.model
        seats = {tool.body: seat for seat, tool in enumerate(scene.tools)}
        self._model, self._frame_s = model, frame_s
        self._balls, self._obstacles = np.array(geometry.balls), np.array(geometry.obstacles, dtype=int)
        self._touches = geometry.touches
        self._bodies = model.geom_bodyid[self._obstacles]
        self._roots = model.body_rootid[self._bodies]
        self._tools = np.array([seats.get(int(root), -1) for root in self._roots], dtype=int)  # seat whose tool it is
        self._bounds = model.geom_rbound[self._obstacles]
        self._reach = self._bounds + model.geom_size[self._balls, :1]  # of both about their middles
        self._reach[:, model.geom_type[self._obstacles] == _PLANE] = np.inf
        self._fields = (
            model.geom_type[self._obstacles] == _FIELD
        )  # MuJoCo knows no distance from one: of a ball around it

    def gap(self, data: mujoco.MjData, most_m: float, holding: NDArray[np.bool_]) -> float:
        """Return the gap [m], at most most_m. holding: of all seats; a tool that nobody holds touches nothing."""
        if not len(self._obstacles):
            return most_m
        places = data.geom_xpos
        at = places[self._obstacles]
        away = places[self._balls][:, None, :] - at
        moved = NEAR_M + self._frame_s * self._speeds(data, at)
        least = np.sqrt(np.add.reduce(away * away, axis=2)) - self._reach - moved
        there = (self._tools < 0) | holding[self._tools]
        for ball, other in zip(*np.nonzero((least < most_m) & self._touches & there), strict=True):
            near = float(least[ball, other])
            if near < most_m and not self._fields[other]:
                pad, one, two = moved[other], int(self._balls[ball]), int(self._obstacles[other])
                away_m = mujoco.mj_geomDistance(self._model, data, one, two, most_m + pad, None)
                near = float(away_m - pad) if away_m < most_m + pad else most_m
            most_m = min(most_m, near)
        return most_m

    def _speeds(self, data: mujoco.MjData, at: _Array) -> _Array:
        """Return a bound of the speed of every point of each obstacle [m/s]."""
        rates = data.cvel[self._bodies]
        arms = at - data.subtree_com[self._roots]
        arm = np.sqrt(np.add.reduce(arms * arms, axis=1)) + self._bounds
        turning, moving = rates[:, :3], rates[:, 3:]
        turning, moving = (np.sqrt(np.add.reduce(each * each, axis=1)) for each in (turning, moving))
        speeds: _Array = moving + turning * arm
        return speeds
