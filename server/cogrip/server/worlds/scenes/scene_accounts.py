"""Accounts of a scene: contact at its tools, its sensors, what was changed of it, and how far its task has come."""

from collections.abc import Sequence
from typing import Any, Protocol

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Row
from cogrip.protocol.settings.task import Task
from cogrip.server.worlds.accounts import ToolAccounts
from cogrip.server.worlds.energy_limiter import EnergyLimiter
from cogrip.server.worlds.progress import Progress
from cogrip.server.worlds.scenes.scene_contacts import SceneContacts, Touch
from cogrip.server.worlds.scenes.scene_file import Scene, body_of
from cogrip.server.worlds.scenes.task_watch import ADDED, TaskWatch


class Told(Protocol):
    """A world of a scene, as it is told of here."""

    scene: Scene
    data: mujoco.MjData
    contacts: SceneContacts
    limiter: EnergyLimiter
    frame_s: float
    holding: NDArray[np.bool_]
    stiffness: NDArray[np.float64]
    target_stiffness: NDArray[np.float64]

    def script_account(self) -> dict[str, Any]:
        """Return what a run tells of the scene's script."""
        ...


class SceneAccounts(ToolAccounts):
    """Those of a scene whose tools wave ports move."""

    def __init__(self, world: Told, users: Sequence[str]) -> None:
        super().__init__(world)
        self._of, self._users = world, users

    def limiter(self) -> dict[str, float] | None:
        return self._of.limiter.account()

    def scene(self) -> dict[str, Any]:
        world, scene = self._of, self._of.scene
        told = {
            "changed": list(scene.changed),
            "own": list(scene.own),
            "unused": list(scene.unused),
            "actuators": scene.model.nu,
        }
        return world.contacts.account(self._users) | told | world.script_account()

    def contact(self, user: int) -> Touch:
        return self._of.contacts.touches[user]

    def sensor_names(self) -> Sequence[str]:
        return self._of.scene.sensors

    def sensors(self) -> Row:
        return tuple(self._of.data.sensordata[: len(self._of.scene.sensors)].tolist())


class DrivenAccounts(SceneAccounts):
    """Those of a scene whose tools are driven by forces: a spring for each hand that holds on, and no limiter of waves."""

    def limiter(self) -> None:
        return None

    def stiffness(self, user: int) -> float | None:
        return float(self._of.target_stiffness[user, 0]) if self._of.holding[user] else 0.0


class SceneProgress(Progress):
    """Contacts so far, and a task if one is watched."""

    def __init__(self, world: Told) -> None:
        self._world = world
        self._watched: tuple[int, TaskWatch] | None = None  # body of the task, and its progress

    def watch(self, task: Task) -> None:
        """Watch how far a task comes, if it states one. Raises SceneError for a body that the scene has not."""
        if task.stated:
            body = body_of(self._world.scene, task.body)
            self._watched = body, TaskWatch(task, self._world.frame_s, *self._pose_of(body))
            self.unsaved = ADDED

    def frame(self) -> Sequence[str]:
        """Go on by a frame. Return what has happened of the task, a marker each."""
        if self._watched is None:
            return ()
        body, task = self._watched
        return task.frame(*self._pose_of(body), self._world.holding.tolist())

    def put_back(self, bodies: Sequence[int]) -> None:
        """Enter that bodies were put where they started: what a task asks for there is nobody's doing."""
        if self._watched is not None and self._watched[0] in bodies:
            self._watched[1].put_back()

    def account(self) -> dict[str, Any] | None:
        return self._watched[1].account() if self._watched else None

    def save(self) -> Row:
        return (*self._world.contacts.save(), *(self._watched[1].save() if self._watched else ()))

    def restore(self, saved: Row) -> None:
        own = len(self._world.contacts.save())
        self._world.contacts.restore(saved[:own])
        if self._watched:
            body, watch = self._watched
            watch.restore(saved[own:], self._pose_of(body)[1])

    def _pose_of(self, body: int) -> tuple[list[float], list[float]]:
        return self._world.data.xpos[body].tolist(), self._world.data.xquat[body].tolist()
