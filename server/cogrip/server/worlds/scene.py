"""Scene of rigid bodies with contact and friction: MuJoCo steps it n times a frame, each person's wave port moves a tool.

Per axis at a tool, T frame, h = T/n step, b impedance, u wave that came, held over the frame, q_k velocity after step k:

    force sqrt(2b) u, damper b to ground      w = (x - x_before) / T      v = sqrt(2b) w - u      F = sqrt(2b) u - b w
    (u^2 - v^2) T/2 = h sum (sqrt(2b) u q_k - b q_k^2) + b h sum (q_k - w)^2          exactly, as x - x_before = h sum q_k

The work of force and damper is what MuJoCo integrates; the last sum is lost. Contact adds nothing where it creates nothing
(`scene_file`), and whatever it does, the limiter bounds what goes back (`energy_limiter`).

A tool with an orientation that is driven has three axes more, of impedance b_r, waves in the world's frame. MuJoCo turns a body
by rates in its own frame: with R its orientation at the frame's start, u and v are R^T u and R^T v there, of the same squares,
and w is the mean rate. As rotations do not commute, R drifts from the hand's; `orientation_drift` brings it back.

In a step a contact within reach counts by the sign of its force, not of its depth: `efc_margin` is 0 when forces are solved.
Data are kept as after `mj_step1`: places, energies and contacts are those of the present state.
"""

from collections.abc import Sequence
from math import isfinite
from typing import Any, NamedTuple

import msgspec
import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.protocol.drawing import Shape
from cogrip.protocol.rotations import UNTURNED, Quaternion, exp, inverse, log, product, turned
from cogrip.protocol.settings import PLACES, SeatSettings
from cogrip.protocol.task import Task
from cogrip.server.worlds.energy_limiter import EnergyLimiter
from cogrip.server.worlds.orientation_drift import OrientationDrift
from cogrip.server.worlds.scene_file import MOST_RATE, Scene, Tool, body_of
from cogrip.server.worlds.scene_shapes import shapes_of
from cogrip.server.worlds.task_watch import TaskWatch
from cogrip.server.worlds.world import Array, Row, World, WorldError, dot

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_FULL = (mujoco.mjtWarning.mjWARN_CONTACTFULL, mujoco.mjtWarning.mjWARN_CNSTRFULL)


class Saved(msgspec.Struct, frozen=True):
    """State of a scene. physics: MuJoCo's own; ledger: of the limiter, level, paid [J] and frames limited."""

    physics: bytes
    holding: tuple[bool, ...]
    solid: tuple[bool, ...]
    ledger: tuple[float, float, int]
    work: tuple[float, ...]
    work_error: tuple[float, ...]
    balance_error_j: float


class Grip(NamedTuple):
    """Values of a seat's tool in the model as the scene has them."""

    geoms: list[int]
    contype: Array
    conaffinity: Array
    damping: Array
    gravcomp: float


class SceneWorld(World):
    """`position` and `velocity` are those of the scene's object, its start being 0; `orientation` is its quaternion.

    A tool starts where the file has it, for a hand in the middle of its own frame. One that nobody holds touches nothing,
    weighs nothing and stays; one that is taken inside a body touches nothing until it has left it (`solid`).
    """

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int, task: Task | None = None) -> None:
        """Raise SceneError for a task with a body that the scene has not."""
        model = scene.model
        self.scene, self.substeps = scene, substeps
        self.data = mujoco.MjData(model)
        self._object = -1 if scene.object < 0 else int(model.jnt_qposadr[model.body_jntadr[scene.object]])
        self._object_dof = -1 if scene.object < 0 else int(model.jnt_dofadr[model.body_jntadr[scene.object]])
        self._start = model.qpos0[self._object : self._object + 3].copy() if scene.object >= 0 else np.zeros(3)
        self._unturned = model.qpos0[self._object + 3 : self._object + 7].tolist() if scene.object >= 0 else UNTURNED
        self._shapes, self._drawn = shapes_of(scene, self._start)
        self._energy = 0.0
        super().__init__(seats)
        self.limiter = EnergyLimiter(self.frame_s)
        self.solid = np.zeros(len(seats), dtype=bool)
        self._driven = [user for user, tool in enumerate(scene.tools) if tool.driven]
        self._dofs = np.array([range(tool.dof, tool.dof + 3) for tool in scene.tools])
        self._places = np.array([range(tool.coordinate, tool.coordinate + 3) for tool in scene.tools])
        self._turning_dofs = self._dofs[self._driven] + 3
        self._turning_impedance = np.array([[seat.coupling.rotational_impedance_nms] for seat in seats])
        self._port_impedance = np.repeat(self.impedance, self.axes, axis=1)
        self._port_impedance[:, PLACES:] = self._turning_impedance
        self._drive = np.sqrt(2.0 * self._port_impedance)
        self._driven_axes = np.ones((len(seats), self.axes), dtype=bool)
        self._driven_axes[:, PLACES:] = [[tool.driven] for tool in scene.tools]
        self._turning_gain = np.sqrt(2.0 / self._turning_impedance)
        self._drift = {user: OrientationDrift(self.frame_s) for user in self._driven}
        self._grips = [self._grip(tool) for tool in scene.tools]
        start = np.array([model.body_pos[tool.body] for tool in scene.tools])
        self.offset[:, :PLACES] = self._start - start  # from the object's frame to each hand's own
        self._zero = model.qpos0[self._places]  # coordinates of a hand at 0
        self._state = np.zeros(mujoco.mj_stateSize(model, _STATE))
        for user in range(len(seats)):
            self._park(user)
        self._refresh()
        self.task = None
        if task is not None and task.stated:
            self._body = body_of(scene, task.body)
            self.task = TaskWatch(task, self.frame_s, self.data.xpos[self._body], self.data.xquat[self._body])

    def _grip(self, tool: Tool) -> Grip:
        model, body, dof = self.scene.model, tool.body, tool.dof
        geoms = [geom for geom in range(model.ngeom) if model.body_rootid[model.geom_bodyid[geom]] == body]
        contact = model.geom_contype[geoms].copy(), model.geom_conaffinity[geoms].copy()
        return Grip(
            geoms,
            *contact,
            model.dof_damping[dof : dof + (6 if tool.turns else 3)].copy(),
            float(model.body_gravcomp[body]),
        )

    # Motion of the object

    @property
    def position(self) -> Array:
        """Place of the object [m] and, of six axes, rotation vector [rad], from its start. To set it puts it there, at rest."""
        if self._object < 0:
            return np.zeros(self.axes)
        at = self.data.qpos[self._object : self._object + 7]
        turned = log(product(at[3:].tolist(), inverse(self._unturned))) if self.axes > PLACES else ()
        return np.concatenate((at[:3] - self._start, turned))

    @position.setter
    def position(self, value: Array) -> None:
        if self._object >= 0 and not np.array_equal(value, self.position):
            self.data.qpos[self._object : self._object + 3] = self._start + value[:PLACES]
            if self.axes > PLACES:
                self.data.qpos[self._object + 3 : self._object + 7] = product(
                    exp(value[PLACES:].tolist()), self._unturned
                )
            self.data.qvel[self._object_dof : self._object_dof + 6] = 0.0
            self._refresh()

    @property
    def velocity(self) -> Array:
        """Velocity of the object [m/s], and of six axes its angular velocity [rad/s]."""
        if self._object < 0:
            return np.zeros(self.axes)
        rates: Array = self.data.qvel[self._object_dof : self._object_dof + self.axes].copy()
        if self.axes > PLACES:
            rates[PLACES:] = turned(self.orientation.tolist(), rates[PLACES:].tolist())
        return rates

    @velocity.setter
    def velocity(self, value: Array) -> None:
        if self._object >= 0 and not np.array_equal(value, self.velocity):
            self.data.qvel[self._object_dof : self._object_dof + 3] = value[:PLACES]
            self._refresh()

    @property
    def orientation(self) -> Array:
        """Quaternion w, x, y, z of the object."""
        if self._object < 0:
            return np.array([1.0, 0.0, 0.0, 0.0])
        turned: Array = self.data.qpos[self._object + 3 : self._object + 7].copy()
        return turned

    @property
    def poses(self) -> Array:
        """Place [m] and quaternion of every body in the world, shape (bodies, 7)."""
        return np.concatenate((self.data.xpos, self.data.xquat), axis=1)

    def geoms(self) -> Sequence[Shape]:
        return self._shapes

    def poses_of_bodies(self) -> Array:
        return np.concatenate((self.data.xpos[self._drawn] - self._start, self.data.xquat[self._drawn]), axis=1)

    @property
    def energy_j(self) -> float:
        """Kinetic and potential energy of all bodies."""
        return self._energy

    def rest(self) -> None:
        """Leave it moving: bodies come to rest by their own friction."""

    def proxy(self, user: int) -> Array:
        place: Array = self.data.qpos[self._places[user]] - self._zero[user]
        return place if self.axes == PLACES else np.concatenate((place, log(self._turned(user))))

    def _turned(self, user: int) -> Quaternion:
        """Return by how much a tool is turned from its start."""
        tool = self.scene.tools[user]
        if not tool.turns:
            return UNTURNED
        at = slice(tool.coordinate + 3, tool.coordinate + 7)
        return product(self.data.qpos[at].tolist(), inverse(self.scene.model.qpos0[at].tolist()))

    def drift_rad(self, user: int) -> Row:
        """Return the drift of a tool's orientation from its hand's, as last known (`orientation_drift`)."""
        return self._drift[user].drift_rad

    def hand_turned(self, user: int, rotation_rad: Row, travelled_rad: Row) -> None:
        if user in self._drift:
            self._drift[user].report(rotation_rad, travelled_rad)

    def stiffness_of(self, user: int) -> float | None:
        return None

    # Taking hold and letting go

    def join(self, user: int, position_m: Array) -> None:
        data, grip, tool = self.data, self._grips[user], self.scene.tools[user]
        data.qpos[self._places[user]] = self._zero[user] + position_m[:PLACES]
        data.qvel[tool.dof : tool.dof + (6 if tool.turns else 3)] = 0.0
        damping = np.repeat(self.impedance[user], 3)
        if tool.turns:
            turning = self._turning_impedance[user] if tool.orientation in ("driven", "damped") else np.zeros(1)
            damping = np.concatenate((damping, np.repeat(turning, 3)))
        self.scene.model.dof_damping[tool.dof : tool.dof + len(damping)] = grip.damping + damping
        if tool.driven:
            at = slice(tool.coordinate + 3, tool.coordinate + 7)
            data.qpos[at] = product(exp(position_m[PLACES:].tolist()), self.scene.model.qpos0[at].tolist())
            self._drift[user].begin()
        self.scene.model.body_gravcomp[tool.body] = grip.gravcomp
        self.holding[user] = True
        self._touch(user, False)
        self._refresh()
        self._make_solid()

    def leave(self, user: int) -> None:
        self._park(user)
        self._refresh()

    def reset(self) -> None:
        mujoco.mj_resetData(self.scene.model, self.data)
        self.limiter = EnergyLimiter(self.frame_s)
        for user in range(len(self.holding)):
            self._park(user)
        self._refresh()

    def _park(self, user: int) -> None:
        model, tool = self.scene.model, self.scene.tools[user]
        dofs = slice(tool.dof, tool.dof + (6 if tool.turns else 3))
        self.holding[user] = False
        self.force[user] = 0.0
        self.data.qfrc_applied[dofs] = 0.0
        self.data.qvel[dofs] = 0.0
        model.dof_damping[dofs] = self._grips[user].damping
        model.body_gravcomp[tool.body] = 1.0
        self._touch(user, False)

    def _touch(self, user: int, solid: bool) -> None:
        model, grip = self.scene.model, self._grips[user]
        model.geom_contype[grip.geoms] = grip.contype if solid else 0
        model.geom_conaffinity[grip.geoms] = grip.conaffinity if solid else 0
        self.solid[user] = solid

    def _make_solid(self) -> None:
        """Let tools touch that are held and inside of nothing: contact begins without energy."""
        for user in np.flatnonzero(self.holding & ~self.solid).tolist():
            self._touch(user, True)
            self._refresh()
            contact, geoms = self.data.contact, self._grips[user].geoms
            if np.any(np.isin(contact.geom, geoms).any(axis=1) & (contact.dist < 0.0)):
                self._touch(user, False)
                self._refresh()

    def _refresh(self) -> None:
        """Bring data up to a state that was changed by hand, whose energy is then the one to count from."""
        mujoco.mj_step1(self.scene.model, self.data)
        self._energy = self._measure()

    def _measure(self) -> float:
        """Return kinetic and potential energy [J]; MuJoCo's potential counts weight that `gravcomp` carries."""
        model, data = self.scene.model, self.data
        carried = np.flatnonzero(model.body_gravcomp)
        weight = (model.body_gravcomp[carried] * model.body_mass[carried])[:, None] * model.opt.gravity
        return float(data.energy[0] + data.energy[1]) + dot(weight, data.xipos[carried])

    # Stepping

    def step(self, inputs: Array) -> Array:
        model, data, dofs, b = self.scene.model, self.data, self._dofs, self._port_impedance
        held = self.holding[:, None] & self._driven_axes
        given_u = u = np.where(held, inputs, 0.0)
        frames = self._frames()
        local = u
        if frames is not None:
            u = self._corrected(u)
            local = self._turn(frames, u, back=True)
        drive = self._drive * local
        data.qfrc_applied[dofs] = drive[:, :PLACES]
        if frames is not None:
            data.qfrc_applied[self._turning_dofs] = drive[self._driven, PLACES:]
        before = data.qpos[self._places]
        moved, squares, rates = np.zeros_like(u), np.zeros_like(u), np.zeros_like(u)  # sums of q_k, q_k^2
        for _ in range(self.substeps):
            data.efc_margin[:] = 0.0
            mujoco.mj_step2(model, data)
            everything = data.qvel
            if not everything.dot(everything) < MOST_RATE**2:
                raise WorldError(
                    f"the scene left all bounds at {data.time:.3f} s: velocities are {_largest(everything)}"
                )
            rates[:, :PLACES] = everything[dofs]
            if frames is not None:
                rates[self._driven, PLACES:] = everything[self._turning_dofs]
            moved += rates
            squares += rates * rates
            mujoco.mj_step1(model, data)
        if any(data.warning[kind].number for kind in _FULL):
            raise WorldError(
                f"the scene has more contacts than its memory at {data.time:.3f} s: raise <size memory> in it"
            )
        period, substep = self.frame_s, self.frame_s / self.substeps
        w = moved / self.substeps
        w[:, :PLACES] = (data.qpos[self._places] - before) / period
        w = np.where(held, w, 0.0)
        back = self._drive * w - local
        given = substep * (drive * moved - b * squares)
        lost = b * substep * (squares - 2.0 * w * moved + self.substeps * w * w)
        error = np.where(held, (0.5 * period) * (local * local - back * back) - given - lost, 0.0)
        self.balance_error_j = max(self.balance_error_j, abs(float(error.sum())))
        force = drive - b * w
        if frames is not None:
            back, force = self._turn(frames, back), self._turn(frames, force)
            self._watch_drift(self._turn(frames, w), u - given_u)
        self.force = force

        energy = self._measure()
        factor = self.limiter.limit(dot(given_u, given_u), dot(back, back), energy - self._energy)
        self._energy = energy
        if factor < 1.0:
            back = factor * back
        self._book(((0.5 * period) * (given_u * given_u - back * back)).sum(axis=1))
        if np.any(self.holding & ~self.solid):
            self._make_solid()
        if self.task is not None:
            self.task.step(data.xpos[self._body].tolist(), data.xquat[self._body].tolist(), bool(self.holding.any()))
        return back

    # Rotation

    def _frames(self) -> Array | None:
        """Return the orientation of each driven tool as a matrix, shape (driven, 3, 3); None where none is driven."""
        if not self._driven:
            return None
        bodies = [self.scene.tools[user].body for user in self._driven]
        frames: Array = self.data.xmat[bodies].reshape(-1, 3, 3)
        return frames

    def _turn(self, frames: Array, rows: Array, back: bool = False) -> Array:
        """Return rows of the ports whose last three axes are turned from the tools' own frames to the world's, or back."""
        out = rows.copy()
        turning = rows[self._driven, PLACES:]
        matrices = frames.transpose(0, 2, 1) if back else frames
        out[self._driven, PLACES:] = (matrices * turning[:, None, :]).sum(axis=2)
        return out

    def _corrected(self, u: Array) -> Array:
        """Return the waves with what turns tools back to their hands, as far as the limiter's ledger pays for it."""
        out = u.copy()
        for user in self._driven:
            out[user, PLACES:] += np.array(self._drift[user].correction_radps) / self._turning_gain[user]
        cost_j = 0.5 * self.frame_s * (dot(out, out) - dot(u, u))
        if cost_j > 0.0 and cost_j > self.limiter.level_j:
            return u
        return out

    def _watch_drift(self, rates: Array, added: Array) -> None:
        """Enter how the driven tools have turned; added: waves that were not the hand's."""
        for user in self._driven:
            turned_by = rates[user, PLACES:] - added[user, PLACES:] / self._drive[user, PLACES:]  # sqrt(2b) w = u + v
            self._drift[user].step(self._turned(user), turned_by.tolist())

    def limiter_account(self) -> dict[str, float]:
        limiter = self.limiter
        return {"level_j": limiter.level_j, "paid_j": limiter.paid_j, "limited_frames": limiter.limited}

    def task_account(self) -> dict[str, Any] | None:
        return self.task.account() if self.task is not None else None

    # Saving

    def coordinates(self) -> tuple[str, Row]:
        return self.scene.digest, tuple(self.data.qpos.tolist())

    def place(self, position_m: Row, scene: str, coordinates: Row) -> None:
        if scene != self.scene.digest or len(coordinates) != len(self.data.qpos):
            raise WorldError("its scene is another one: the file has been changed")
        if not all(map(isfinite, coordinates)):
            raise WorldError("its coordinates are not all finite")
        self.reset()
        self.data.qpos[:] = coordinates
        self._refresh()

    def save(self) -> Saved:
        """Return the state between two frames; a world of the same scene continues from it bit for bit."""
        mujoco.mj_getState(self.scene.model, self.data, self._state, _STATE)
        limiter = self.limiter
        return Saved(
            self._state.tobytes(), tuple(self.holding.tolist()), tuple(self.solid.tolist()),
            (limiter.level_j, limiter.paid_j, limiter.limited), tuple(self.port_work.tolist()),
            tuple(self._work_error.tolist()), self.balance_error_j,
        )  # fmt: skip

    def restore(self, saved: Saved) -> None:
        """Continue from a saved state. Raises WorldError for one of another scene, and nothing has changed."""
        if len(saved.physics) != self._state.nbytes or len(saved.holding) != len(self.holding):
            raise WorldError("the saved state is of another scene: its size or its seats differ")
        for user, (holding, solid) in enumerate(zip(saved.holding, saved.solid, strict=True)):
            self._park(user)
            if holding:
                self.join(user, np.zeros(3))
                self._touch(user, solid)
        mujoco.mj_setState(self.scene.model, self.data, np.frombuffer(saved.physics), _STATE)
        self.limiter.level_j, self.limiter.paid_j, self.limiter.limited = saved.ledger
        self.port_work, self._work_error = np.array(saved.work), np.array(saved.work_error)
        self.balance_error_j = saved.balance_error_j
        self._refresh()


def _largest(velocities: Array) -> str:
    return f"up to {np.abs(velocities).max():.3g}"
