"""Scene of rigid bodies with contact and friction: MuJoCo steps it n times a frame, each person's wave port moves a tool.

Per axis at a tool, T frame, h = T/n step, b impedance, u wave that came, held over the frame, q_k velocity after step k:

    force sqrt(2b) u, damper b to ground      w = (x - x_before) / T      v = sqrt(2b) w - u      F = sqrt(2b) u - b w
    (u^2 - v^2) T/2 = h sum (sqrt(2b) u q_k - b q_k^2) + b h sum (q_k - w)^2          exactly, as x - x_before = h sum q_k

The work of force and damper is what MuJoCo integrates; the last sum is lost. Contact adds nothing where it creates nothing
(`scene_file`), and whatever it does, the limiter bounds what goes back (`energy_limiter`).

A tool that is a gripper has one axis more, of impedance b_g, at the joint of its finger: all of the above, with q_k its rate.

A tool with an orientation that is driven has three axes more, of impedance b_r, waves in the world's frame. MuJoCo turns a body
by rates in its own frame: with R its orientation at the frame's start, u and v are R^T u and R^T v there, of the same squares,
and w is the mean rate. As rotations do not commute, R drifts from the hand's; `orientation_drift` brings it back.

In a step a contact within reach counts by the sign of its force, not of its depth: `efc_margin` is 0 when forces are solved.
Data are kept as after `mj_step1`: places, energies and contacts are those of the present state.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from math import hypot, isfinite
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.axes import GRIP_AXES, PLACES
from cogrip.protocol.laws.rotations import log
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.accounts import Accounts
from cogrip.server.worlds.energy_limiter import EnergyLimiter
from cogrip.server.worlds.scenes.equality_rows import EqualityRows
from cogrip.server.worlds.scenes.opening_ports import OpeningPorts
from cogrip.server.worlds.scenes.scene_accounts import SceneAccounts, SceneProgress
from cogrip.server.worlds.scenes.scene_bodies import SceneBodies, Workspace
from cogrip.server.worlds.scenes.scene_contacts import SceneContacts
from cogrip.server.worlds.scenes.scene_drawing import SceneDrawing
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.scenes.scene_grips import grip_of
from cogrip.server.worlds.scenes.scene_object import SceneObject
from cogrip.server.worlds.scenes.scene_script import RunningScript, ScriptedScene
from cogrip.server.worlds.scenes.scene_state import SceneEnergy, check_memory, check_rates
from cogrip.server.worlds.scenes.turning_ports import TurningPorts
from cogrip.server.worlds.scenes.velocity_forces import VelocityForces
from cogrip.server.worlds.scenes.warm_start import WarmStart
from cogrip.server.worlds.world import Array, World, WorldError, check_saved, dot

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class SceneWorld(World):
    """`position` and `velocity` are those of the scene's object, its start being 0; `orientation` is its quaternion.

    A tool starts where the file has it, for a hand in the middle of its own frame. One that nobody holds touches nothing,
    weighs nothing and stays, and is put where the hand is that takes it; one that is `tied` goes on as a body of the scene, and
    is taken where it is, as to move it would stretch what ties it. Both are taken as they are turned. One that is taken inside
    a body touches nothing until it has left it (`solid`). One that is `kinematic` is put where it is to be, touches nothing and
    is not driven: none here (`local_scene`).
    """

    can_change_gravity = True
    port_damped = True  # a tool that is held has the damper of its wave port

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int) -> None:
        model = scene.model
        self.scene, self.substeps = scene, substeps
        self.data = scene.start.data(model)
        self.object = SceneObject(scene, self.data)
        self.object_name = (self.object.there and model.body(scene.object).name) or World.object_name
        self._energy = SceneEnergy(model)
        self._equalities, self._warm = EqualityRows(model), WarmStart(model)
        self._forces = VelocityForces(model)
        self._down, self._gravity_j = _direction(model.opt.gravity), 0.0
        super().__init__(seats)
        self.limiter = EnergyLimiter(self.frame_s)
        self.contacts = SceneContacts(scene, self.frame_s)
        self.drawing = SceneDrawing(scene, self.data, self.object.start)
        self.accounts: Accounts = SceneAccounts(self, [seat.user for seat in seats])
        self.progress: SceneProgress = SceneProgress(self)
        self.solid, self.kinematic = np.zeros((2, len(seats)), dtype=bool)
        self._dofs = np.array([range(tool.dof, tool.dof + 3) for tool in scene.tools])
        self._places = np.array([range(tool.coordinate, tool.coordinate + 3) for tool in scene.tools])
        self.turning, self.openings = TurningPorts(scene, self.frame_s), OpeningPorts(scene)
        self._drive = np.sqrt(2.0 * self.port_impedance)
        self._driven_axes = np.ones((len(seats), self.axes), dtype=bool)
        self._driven_axes[:, PLACES:] = [[tool.driven or tool.opening >= 0] for tool in scene.tools]
        self._grips = [grip_of(model, tool) for tool in scene.tools]
        self.workspace = Workspace(scene)
        self._free_bodies = SceneBodies(scene, self.workspace, any(grip.tied for grip in self._grips))
        self._begun = scene.start.data(model)  # at the start, for ever
        self._zero = self._begun.qpos[self._places]  # coordinates of a hand at 0
        start = self._begun.xpos[[tool.body for tool in scene.tools]]
        self._from_object = self.object.start - start  # to a hand's own frame, as long as _zero is as it is now
        self.offset[:, :PLACES] = self._from_object
        self._state = np.zeros(mujoco.mj_stateSize(model, _STATE))
        self._script: RunningScript | None = None
        self._scripted = ScriptedScene(model, self.data, scene.sensors, self.frame_s)
        for user in range(len(seats)):
            self._park(user)
        self._refresh()

    def follow(self, script: RunningScript) -> None:
        """Let a script set controls and move mocap bodies, before each step."""
        self._script = script

    def script_account(self) -> dict[str, Any]:
        """Return what a run tells of the script, and of gravity that was set; nothing where there is neither."""
        script = {} if self._script is None else {"mocap_slowed": self._scripted.slowed}
        return {**script, "gravity_j": self._gravity_j} if self._gravity_j else script

    def limit_calls(self, limit: Callable[[], AbstractContextManager[None]]) -> None:
        if self._script is not None:
            self._script.time_limit = limit

    def _call_script(self, script: RunningScript) -> None:
        try:
            script.frame(self._scripted)
        except WorldError as error:
            self.failed = str(error)  # it is not called again
            raise

    # Motion of the object

    @property
    def position(self) -> Array:
        """Place of the object [m] and, of six axes, rotation vector [rad], from its start. To set it puts it there, at rest."""
        return self.object.place(self.axes)

    @position.setter
    def position(self, value: Array) -> None:
        if self.object.there and not np.array_equal(value, self.position):
            bodies: Sequence[int] = (self.scene.object,)
            if any(grip.tied for grip in self._grips):  # the whole scene goes back to its start, with what ties them
                bodies = range(self.scene.model.nbody)
                self.data.qpos[:], self.data.qvel[:] = self._begun.qpos, 0.0
            self.object.put(value)
            self._begin_anew(bodies)

    @property
    def velocity(self) -> Array:
        """Velocity of the object [m/s], and of six axes its angular velocity [rad/s]."""
        return self.object.velocity(self.axes)

    @velocity.setter
    def velocity(self, value: Array) -> None:
        if self.object.there and not np.array_equal(value, self.velocity):
            self.object.push(value)
            self._refresh()

    def motion(self) -> Row:
        return self.object.motion() if self.object.there and self.axes == PLACES else super().motion()

    @property
    def orientation(self) -> Array:
        """Quaternion w, x, y, z of the object."""
        return self.object.orientation

    @property
    def left_workspace(self) -> bool:
        return not self.workspace.has(self._object_at)

    @property
    def out_of_reach(self) -> bool:
        return not self.workspace.reaches(self._object_at)

    @property
    def _object_at(self) -> Array:
        """Place of the object in the world; where there is none it is always within."""
        return self.object.at if self.object.there else self.workspace.middle

    @property
    def energy_j(self) -> float:
        """Kinetic and potential energy of all bodies."""
        return self._energy.now_j

    def bring_to_rest(self) -> None:
        """Leave it moving: bodies come to rest by their own friction."""

    def proxy(self, user: int) -> Array:
        first = self.scene.tools[user].coordinate
        place: Array = self.data.qpos[first : first + PLACES] - self._zero[user]
        if self.axes == PLACES:
            return place
        if self.axes == GRIP_AXES:
            return np.append(place, self.openings.opening(self.data, user))
        return np.concatenate((place, log(self.turning.turned(self.data, user))))

    def set_reported_rotation(self, user: int, rotation_rad: Row, travelled_rad: Row) -> None:
        self.turning.set_hand(user, rotation_rad, travelled_rad)

    # Taking hold and letting go

    def join(self, user: int, position_m: Array) -> None:
        data, grip, places, tool = self.data, self._grips[user], self._places[user], self.scene.tools[user]
        if grip.tied:
            self._begin_at(user, data.qpos[places] - position_m[:PLACES])
        else:
            data.qpos[places] = self._zero[user] + position_m[:PLACES]
            data.qvel[tool.dof : tool.dof + tool.dofs] = 0.0  # its fingers may have moved it while nobody held it
        self.turning.take(data, user, position_m[PLACES:].tolist())
        self.openings.place(data, user, float(position_m[-1]))
        self.openings.rest(data, user)
        self._damp(user)
        self.scene.model.body_gravcomp[tool.body] = grip.gravcomp
        self.holding[user] = True
        self._touch(user, False)
        self._refresh()
        self._make_solid()

    def _begin_at(self, user: int, zero: Array) -> None:
        self._zero[user] = zero
        self.offset[user, :PLACES] = self._from_object[user] + self._begun.qpos[self._places[user]] - zero

    def _damp(self, user: int) -> None:
        """Give a held tool the damper of its port."""
        tool = self.scene.tools[user]
        turning = self.turning.damping(user, self.further_impedance[user])
        damping = np.concatenate((np.repeat(self.impedance[user], PLACES), turning))
        dofs = slice(tool.dof, tool.dof + tool.dofs)
        self.scene.model.dof_damping[dofs] = self._grips[user].damping + self.port_damped * damping
        self.openings.damp(user, float(self.further_impedance[user, 0]))

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        self._drive = np.sqrt(2.0 * self.port_impedance)
        if self.holding[user]:
            self._damp(user)
            self._refresh()

    def leave(self, user: int) -> None:
        self._park(user)
        self._refresh()

    def reset(self) -> None:
        self.scene.start.begin(self.scene.model, self.data)
        self.contacts.forget()
        self._warm.forget()
        self._forces.forget()
        if self._script is not None:
            self._script.reset()
        self.limiter = EnergyLimiter(self.frame_s)
        for user in range(len(self.holding)):
            self._park(user)
        self._begin_anew(range(self.scene.model.nbody))

    def _park(self, user: int) -> None:
        model, tool = self.scene.model, self.scene.tools[user]
        dofs = slice(tool.dof, tool.dof + tool.dofs)
        self.holding[user] = False
        self.force[user] = 0.0
        self.turning.begin(user)
        self.data.qfrc_applied[dofs] = 0.0
        model.dof_damping[dofs] = self._grips[user].damping
        self.openings.damp(user, 0.0)
        self.openings.rest(self.data, user)
        if not self._grips[user].tied:
            self.data.qvel[dofs] = 0.0
            model.body_gravcomp[tool.body] = 1.0
        self._touch(user, False)

    def _touch(self, user: int, solid: bool) -> None:
        model, grip = self.scene.model, self._grips[user]
        model.geom_contype[grip.geoms] = grip.contype if solid else 0
        model.geom_conaffinity[grip.geoms] = grip.conaffinity if solid else 0
        self.solid[user] = solid

    def _make_solid(self) -> None:
        """Let tools touch that are held and inside of nothing: contact begins without energy."""
        if self.solid.tolist() == self.holding.tolist():
            return
        for user in np.flatnonzero(self.holding & ~self.solid & ~self.kinematic).tolist():
            self._touch(user, True)
            self._refresh()
            contact, geoms = self.data.contact, self._grips[user].geoms
            if np.any(np.isin(contact.geom, geoms).any(axis=1) & (contact.dist < 0.0)):
                self._touch(user, False)
                self._refresh()

    # Gravity

    @property
    def gravity_mps2(self) -> float:
        return hypot(*self.scene.model.opt.gravity.tolist())

    def set_gravity(self, gravity_mps2: float) -> None:
        """Set its size; it acts where the scene's own did, else along the third axis, down. What this gives is told."""
        self.scene.model.opt.gravity[:] = gravity_mps2 * self._down
        before_j = self.energy_j
        self._refresh()
        self._gravity_j += self.energy_j - before_j

    def _refresh(self) -> None:
        """Bring data up to a state that was changed by hand, whose energy is then the one to count from."""
        mujoco.mj_step1(self.scene.model, self.data)
        self._equalities.arrange(self.data)
        self._energy.begin(self.data)

    def _gain(self) -> float:
        """Return how much energy the bodies have got since the frame before [J]; by hand none is given them."""
        gained_j = self._energy.gain(self.data)
        self.gained_j += gained_j
        return gained_j

    # Stepping

    def step(self, inputs: Array) -> Array:
        data, turning, b = self.data, self.turning, self.port_impedance
        held = self.holding[:, None] & self._driven_axes
        all_held = bool(held.all())
        theirs = u = inputs if all_held else np.where(held, inputs, 0.0)  # of the hands; u: what drives the tools
        local = u
        frames = turning.frames(data)
        if turning.driven:
            u = turning.corrected(u, b, self.limiter.level_j)
            local = turning.to_tools(frames, u)
        drive = self._drive * local
        before = data.qpos[self._places]
        moved, squares = self.integrate(drive)
        period, substep = self.frame_s, self.frame_s / self.substeps
        w = moved / self.substeps
        w[:, :PLACES] = (data.qpos[self._places] - before) / period
        if not all_held:
            w = np.where(held, w, 0.0)
        back = self._drive * w - local
        given = substep * (drive * moved - b * squares)
        lost = b * substep * (squares - 2.0 * w * moved + self.substeps * w * w)
        error = (0.5 * period) * (local * local - back * back) - given - lost
        error_j = float((error if all_held else np.where(held, error, 0.0)).sum())
        self.balance_error_j = max(self.balance_error_j, abs(error_j))
        force = drive - b * w
        if turning.driven:
            back, force = turning.to_world(frames, back), turning.to_world(frames, force)
            poses = [turning.turned(data, user) for user in turning.driven]
            turning.watch(poses, turning.to_world(frames, w), u - theirs, b)
        self.force = force

        factor = self.limiter.limit(dot(theirs, theirs), dot(back, back), self._gain())
        if factor < 1.0:
            back = factor * back
        self._count_work(((0.5 * period) * (theirs * theirs - back * back)).sum(axis=1))
        self._make_solid()
        return back

    def integrate(self, force: Array) -> tuple[Array, Array]:
        """Step through a frame, these forces on the tools [N, N m]. Return the sums of q_k and q_k^2. Raises WorldError."""
        model, data, dofs = self.scene.model, self.data, self._dofs
        turning = self.turning.driven
        if put_back := self._free_bodies.put_back(data, self.events):
            self._begin_anew(put_back)
        data.qfrc_applied[dofs] = force[:, :PLACES]
        if turning:
            data.qfrc_applied[self.turning.dofs] = force[turning, PLACES:]
        grippers = self.openings.users
        if grippers:
            data.qfrc_applied[self.openings.dofs] = force[grippers, PLACES]
        if self._script is not None:
            self._call_script(self._script)
        rates = np.zeros((self.substeps, *force.shape))
        for number, rate in enumerate(rates, 1):
            data.efc_margin[:] = 0.0
            self._equalities.correct(data)
            self._warm.extrapolate(data)
            self._forces.correct(data)
            mujoco.mj_step2(model, data)
            check_rates(model, data)
            self._forces.follow(data)
            rate[:, :PLACES] = data.qvel[dofs]
            if turning:
                rate[turning, PLACES:] = data.qvel[self.turning.dofs]
            if grippers:
                rate[grippers, PLACES] = data.qvel[self.openings.dofs]
            if number == self.substeps:
                self.contacts.read(data)
            if self._script is not None:
                self._scripted.move(number / self.substeps)
            self.between_steps()
            mujoco.mj_step1(model, data)
        check_memory(data)
        self.departed += self._free_bodies.departed(data)
        self.events += self.progress.frame()
        moved: Array = np.add.reduce(rates, axis=0, initial=0.0)
        squares: Array = np.add.reduce(rates * rates, axis=0, initial=0.0)
        return moved, squares

    def between_steps(self) -> None:
        """Change what drives the tools, after each step; a wave drives them alike for a whole frame."""

    def _begin_anew(self, put_back: Sequence[int]) -> None:
        """Bring data up to bodies that were put where they started."""
        self.progress.put_back(put_back)
        self._refresh()

    # Saving

    def coordinates(self) -> tuple[str, Row]:
        return self.scene.digest, tuple(self.data.qpos.tolist())

    def restore_coordinates(self, position_m: Row, scene: str, coordinates: Row) -> None:
        if scene != self.scene.digest or len(coordinates) != len(self.data.qpos):
            raise WorldError("its scene is another one: the file has been changed")
        if not all(map(isfinite, coordinates)):
            raise WorldError("its coordinates are not all finite")
        self.reset()
        self.data.qpos[:] = coordinates
        self._refresh()

    def save(self) -> Row:
        mujoco.mj_getState(self.scene.model, self.data, self._state, _STATE)
        limiter = self.limiter
        seats = np.concatenate((self.holding, self.solid, self.port_work, self._work_error)).tolist()
        ledger = limiter.level_j, limiter.paid_j, float(limiter.limited), self.balance_error_j
        zero = self._zero.ravel().tolist()
        script = self._script.save() if self._script is not None else ()
        solver = *self._warm.save(), *self._forces.save()
        gravity = self.scene.model.opt.gravity.tolist()
        return (*script, *self.turning.save(), *solver, *self._state.tolist(), *seats, *zero, *ledger, *gravity)

    def restore(self, saved: Row) -> None:
        seats, physics = len(self.holding), self._state.size
        if self._script is not None:
            kept = self._script.numbers
            self._script.restore(saved[:kept])
            saved = saved[kept:]
        turned = self.turning.saved_numbers
        warm = turned + self._warm.numbers
        first = warm + self._forces.numbers
        check_saved(saved, first + physics + 7 * seats + 7)
        state = np.array(saved[first:])
        holding, solid, work, work_error = state[physics : physics + 4 * seats].reshape(4, seats)
        zeros = state[physics + 4 * seats : -7].reshape(seats, PLACES)
        for user in range(seats):
            self._park(user)
            if holding[user]:
                self.join(user, np.zeros(self.axes))
        for user in np.flatnonzero(holding).tolist():  # after all have joined, which may change those before
            self._touch(user, bool(solid[user]))
        for user, zero in enumerate(zeros):
            self._begin_at(user, zero)
        mujoco.mj_setState(self.scene.model, self.data, state[:physics], _STATE)
        self.turning.restore(saved[:turned])
        self._warm.restore(saved[turned:warm])
        self._forces.restore(saved[warm:first])
        self.limiter.level_j, self.limiter.paid_j, limited, self.balance_error_j = saved[-7:-3]
        self.limiter.limited = int(limited)
        self.scene.model.opt.gravity[:] = saved[-3:]
        self.port_work, self._work_error = work, work_error
        self._refresh()


def _direction(gravity: Array) -> Array:
    """Return where gravity acts, a vector of length 1; down where there is none."""
    size = hypot(*gravity.tolist())
    return gravity / size if size else np.array([0.0, 0.0, -1.0])
