"""Measures of a scene's run, upon which no step depends: contact, and how far its task has come."""

from collections.abc import Sequence
from typing import Any

import mujoco  # type: ignore[import-untyped]

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.task import Task
from cogrip.server.worlds.scene_contacts import SceneContacts, Touch
from cogrip.server.worlds.scene_file import Scene, body_of
from cogrip.server.worlds.task_watch import ADDED, TaskWatch
from cogrip.server.worlds.world import Row, World


class SceneMeasures(World):
    """Base of a scene: what it measures. The scene itself sets `scene`, `data` and `contacts`."""

    scene: Scene
    data: mujoco.MjData
    contacts: SceneContacts

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self._users = [seat.user for seat in seats]
        self._watch: tuple[int, TaskWatch] | None = None  # body of the task, and its progress

    def watch(self, task: Task) -> None:
        """Watch how far a task comes, if it states one. Raises SceneError for a body that the scene has not."""
        if task.stated:
            body = body_of(self.scene, task.body)
            self._watch = body, TaskWatch(task, self.frame_s, *self._pose_of(body))
            self.unsaved_progress = ADDED

    def _pose_of(self, body: int) -> tuple[list[float], list[float]]:
        return self.data.xpos[body].tolist(), self.data.xquat[body].tolist()

    def contact_of(self, user: int) -> Touch:
        return self.contacts.touches[user]

    def sensor_names(self) -> Sequence[str]:
        return self.scene.sensors

    def sensors(self) -> Row:
        return tuple(self.data.sensordata[: len(self.scene.sensors)].tolist())

    def progress(self) -> Row:
        return (*self.contacts.save(), *(self._watch[1].save() if self._watch else ()))

    def restore_progress(self, progress: Row) -> None:
        own = len(self.contacts.save())
        self.contacts.restore(progress[:own])
        if self._watch:
            body, watch = self._watch
            watch.restore(progress[own:], self._pose_of(body)[1])

    def scene_account(self) -> dict[str, Any]:
        scene = self.scene
        told = {
            "changed": list(scene.changed),
            "own": list(scene.own),
            "unused": list(scene.unused),
            "actuators": scene.model.nu,
        }
        return self.contacts.account(self._users) | told

    def task_account(self) -> dict[str, Any] | None:
        return self._watch[1].account() if self._watch else None
