"""Scene whose tools the server drives with models of the hands (`coupling.kind = "partner"`, theory 5b.3, 5b.4).

It owns the scene; each client steps a copy of its own. Inputs are those of `worlds.partners`, answers as well, with the
object's rotation vector behind its place, and its angular velocity behind its velocity. No energy of this scene passes a line,
so no work is counted.
"""

from collections.abc import Sequence

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.drawing import Shape
from cogrip.protocol.laws.partner_model import Model, ToolDrive
from cogrip.protocol.laws.poses import IN_PLACES, Poses
from cogrip.protocol.laws.rotations import log
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.partners import told_partners
from cogrip.server.worlds.scenes.copied_geometry import copied_geometry, unfit_copy
from cogrip.server.worlds.scenes.driven_scene import DrivenScene
from cogrip.server.worlds.scenes.scene_drawing import SceneDrawing
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.scenes.scene_text import SceneError
from cogrip.server.worlds.world import Array, check_saved


class PartnersScene(DrivenScene):
    """`hand` is where each model's device is, in its own frame; `speed` how fast it goes.

    Raises SceneError for a scene of which clients can make no copy.
    """

    inputs_per_axis = 6
    can_change_gravity = False  # clients have copies of the bodies, which fall by their own

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int) -> None:
        if why := unfit_copy(scene):
            raise SceneError(
                f'coupling.kind = "partner" has no copies of this scene: {why}; set coupling.kind = "wave"'
            )
        copied = [copied_geometry(scene, seat) for seat in range(len(seats))]
        super().__init__(seats, scene, substeps)
        self.drawing = CopiedDrawing(scene, self.data, self.object.start, copied)
        self.hand, self.speed = np.zeros((2, len(seats), self.axes))  # in lengths
        self._lengths_m = [seat.coupling.length_scale if self.axes == POSE_AXES else 1.0 for seat in seats]
        self._units = np.ones((len(seats), self.axes))
        self._units[:, PLACES:] = np.array(self._lengths_m)[:, None]
        self._spaces = [Poses(length) if self.axes == POSE_AXES else IN_PLACES for length in self._lengths_m]
        self._held: dict[int, Model] = {}  # of each person who holds a tool, in this frame
        self._drives: dict[int, ToolDrive] = {}

    def join(self, user: int, position_m: Array) -> None:
        """Put a tool into the hand; one that is welded stays where it is, as the hand's client takes it."""
        if self._grips[user].tied:
            position_m = self.proxy(user)
        elif self.axes == POSE_AXES:
            self.turning.put(self.data, user, position_m[PLACES:].tolist())
        super().join(user, position_m)
        self.hand[user], self.speed[user] = position_m * self._units[user], 0.0

    def leave(self, user: int) -> None:
        super().leave(user)
        self.speed[user] = 0.0

    def step(self, inputs: Array) -> Array:
        rows = inputs.reshape(len(self.holding), self.inputs_per_axis, self.axes)
        self._held = {}
        for user in np.flatnonzero(self.holding).tolist():
            self._held[user] = model = Model(self.hand[user].tolist(), self._spaces[user])
            model.velocity_mps = self.speed[user].tolist()
            model.intention_m = (rows[user, 0] * self._units[user]).tolist()
            model.stiffness_npm = float(rows[user, 3, 0])
        self._hold_tools()
        mujoco.mj_step1(self.scene.model, self.data)  # with the dampers of these models
        self.drive(self._driving())
        self._drives = {}
        self.force[:] = 0.0
        for user, model in self._held.items():
            self.hand[user], self.speed[user] = model.place_m, model.velocity_mps
            stretch = np.array(model.space.way(self._at(user), model.place_m))
            relative = self.speed[user] - self._rates(user)
            force = self.target_stiffness[user] * stretch + self.target_damping[user] * relative
            self.force[user] = force * self._units[user]
        place, velocity = self.position.tolist(), self.object.velocity(POSE_AXES).tolist()
        if self.axes == PLACES:
            place += log(self.orientation.tolist())
        state = place, velocity
        return np.array(told_partners(state, inputs.tolist(), self.offset.tolist(), self.holding.tolist()))

    def between_steps(self) -> None:
        for user, drive in self._drives.items():
            drive.end(self._rates(user))
        self._hold_tools()
        force, turning = self._driving(), self.turning.driven
        self.data.qfrc_applied[self._dofs] = force[:, :PLACES]
        if turning:
            self.data.qfrc_applied[self.turning.dofs] = force[turning, PLACES:]

    def _at(self, user: int) -> list[float]:
        """Return place or pose of a tool, in lengths, in its hand's own frame."""
        at: list[float] = (self.data.qpos[self._places[user]] - self._zero[user]).tolist()
        if self.axes == POSE_AXES:
            at += [self._lengths_m[user] * each for each in log(self.turning.turned(self.data, user))]
        return at

    def _rates(self, user: int) -> list[float]:
        """Return its velocity, in lengths, in the world's frame."""
        rates: list[float] = self.data.qvel[self._dofs[user]].tolist()
        if self.axes == POSE_AXES:
            rates += [self._lengths_m[user] * each for each in self.turning.rates(self.data, user)]
        return rates

    def _hold_tools(self) -> None:
        """Let the models hold the tools for the next step."""
        model, step_s = self.scene.model, self.frame_s / self.substeps
        for user, held in self._held.items():
            spring = float(self.target_stiffness[user, 0]), float(self.target_damping[user, 0])
            self._drives[user] = drive = ToolDrive(step_s, spring, held, self._at(user))
            grip, tool, length = self._grips[user], self.scene.tools[user], self._lengths_m[user]
            damping = np.full(tool.dofs, drive.damping_nspm)
            damping[PLACES:] *= length * length
            model.dof_damping[tool.dof : tool.dof + tool.dofs] = grip.damping + damping

    def _driving(self) -> Array:
        """Return the forces on the tools, shape (n, axes): of turning in each tool's own frame, as MuJoCo takes them."""
        force = np.zeros((len(self.holding), self.axes))
        for user, drive in self._drives.items():
            force[user] = drive.force_n
            if self.axes == POSE_AXES:
                torque = [self._lengths_m[user] * each for each in drive.force_n[PLACES:]]
                force[user, PLACES:] = self.turning.in_tool(self.data, user, torque)
        return force

    def save(self) -> Row:
        return (*self.hand.ravel().tolist(), *self.speed.ravel().tolist(), *super().save())

    def restore(self, saved: Row) -> None:
        check_saved(saved, len(self.save()))
        own = self.hand.size
        hand, speed = np.array(saved[: 2 * own]).reshape(2, *self.hand.shape)
        super().restore(saved[2 * own :])
        self.hand, self.speed = hand, speed


class CopiedDrawing(SceneDrawing):
    """Drawing of a scene, and the shapes of which each client makes its copy."""

    def __init__(self, scene: Scene, data: mujoco.MjData, start: Array, copied: Sequence[Sequence[Shape]]) -> None:
        super().__init__(scene, data, start)
        self._copied = copied

    def local_shapes(self, user: int) -> Sequence[Shape]:
        return self._copied[user]
