"""Scene of rigid bodies with contact and friction: MuJoCo steps it n times a frame, each person's wave port moves a tool.

Per axis at a tool, T frame, h = T/n step, b impedance, u wave that came, held over the frame, q_k velocity after step k:

    force sqrt(2b) u, damper b to ground      w = (x - x_before) / T      v = sqrt(2b) w - u      F = sqrt(2b) u - b w
    (u^2 - v^2) T/2 = h sum (sqrt(2b) u q_k - b q_k^2) + b h sum (q_k - w)^2          exactly, as x - x_before = h sum q_k

The work of force and damper is what MuJoCo integrates; the last sum is lost. Contact adds nothing where it creates nothing
(`scene_file`), and whatever it does, the limiter bounds what goes back (`energy_limiter`).

In a step a contact within reach counts by the sign of its force, not of its depth: `efc_margin` is 0 when forces are solved.
Data are kept as after `mj_step1`: places, energies and contacts are those of the present state.
"""

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings import SeatSettings
from cogrip.server.worlds.energy_limiter import EnergyLimiter
from cogrip.server.worlds.scene_file import MOST_RATE, Scene
from cogrip.server.worlds.scene_shapes import shapes_of
from cogrip.server.worlds.world import Array, Row, World, WorldError, check_saved, dot

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_FULL = (mujoco.mjtWarning.mjWARN_CONTACTFULL, mujoco.mjtWarning.mjWARN_CNSTRFULL)


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

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int) -> None:
        model = scene.model
        self.scene, self.substeps = scene, substeps
        self.data = mujoco.MjData(model)
        self._object = -1 if scene.object < 0 else int(model.jnt_qposadr[model.body_jntadr[scene.object]])
        self._object_dof = -1 if scene.object < 0 else int(model.jnt_dofadr[model.body_jntadr[scene.object]])
        self._start = model.qpos0[self._object : self._object + 3].copy() if scene.object >= 0 else np.zeros(3)
        self._shapes, self._drawn = shapes_of(scene, self._start)
        self._energy = 0.0
        super().__init__(seats)
        self.limiter = EnergyLimiter(self.frame_s)
        self.solid = np.zeros(len(seats), dtype=bool)
        self._dofs = np.array([range(tool.dof, tool.dof + 3) for tool in scene.tools])
        self._places = np.array([range(tool.coordinate, tool.coordinate + 3) for tool in scene.tools])
        self._drive = np.sqrt(2.0 * self.impedance)
        self._grips = [self._grip(tool.body, tool.dof) for tool in scene.tools]
        start = np.array([model.body_pos[tool.body] for tool in scene.tools])
        self.offset = self._start - start  # from the object's frame to each hand's own
        self._zero = model.qpos0[self._places]  # coordinates of a hand at 0
        self._state = np.zeros(mujoco.mj_stateSize(model, _STATE))
        for user in range(len(seats)):
            self._park(user)
        self._refresh()

    def _grip(self, body: int, dof: int) -> Grip:
        model = self.scene.model
        geoms = [geom for geom in range(model.ngeom) if model.body_rootid[model.geom_bodyid[geom]] == body]
        contact = model.geom_contype[geoms].copy(), model.geom_conaffinity[geoms].copy()
        return Grip(geoms, *contact, model.dof_damping[dof : dof + 3].copy(), float(model.body_gravcomp[body]))

    # Motion of the object

    @property
    def position(self) -> Array:
        """Place of the object [m], its start being 0. To set it puts the object there, at rest."""
        if self._object < 0:
            return np.zeros(3)
        place: Array = self.data.qpos[self._object : self._object + 3] - self._start
        return place

    @position.setter
    def position(self, value: Array) -> None:
        if self._object >= 0 and not np.array_equal(value, self.position):
            self.data.qpos[self._object : self._object + 3] = self._start + value
            self.data.qvel[self._object_dof : self._object_dof + 6] = 0.0
            self._refresh()

    @property
    def velocity(self) -> Array:
        """Velocity of the object [m/s]."""
        return np.zeros(3) if self._object < 0 else self.data.qvel[self._object_dof : self._object_dof + 3].copy()

    @velocity.setter
    def velocity(self, value: Array) -> None:
        if self._object >= 0 and not np.array_equal(value, self.velocity):
            self.data.qvel[self._object_dof : self._object_dof + 3] = value
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
        return place

    def stiffness_of(self, user: int) -> float | None:
        return None

    # Taking hold and letting go

    def join(self, user: int, position_m: Array) -> None:
        data, grip, tool = self.data, self._grips[user], self.scene.tools[user]
        data.qpos[self._places[user]] = self._zero[user] + position_m
        data.qvel[self._dofs[user]] = 0.0
        self.scene.model.dof_damping[self._dofs[user]] = grip.damping + self.impedance[user]
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
        model, dofs, tool = self.scene.model, self._dofs[user], self.scene.tools[user]
        self.holding[user] = False
        self.force[user] = 0.0
        self.data.qfrc_applied[dofs] = 0.0
        self.data.qvel[tool.dof : tool.dof + (6 if tool.free else 3)] = 0.0
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
        model, data, dofs, b = self.scene.model, self.data, self._dofs, self.impedance
        u = np.where(self.holding[:, None], inputs, 0.0)
        drive = self._drive * u
        data.qfrc_applied[dofs] = drive
        before = data.qpos[self._places]
        moved, squares = np.zeros_like(u), np.zeros_like(u)  # sums of q_k, q_k^2
        for _ in range(self.substeps):
            data.efc_margin[:] = 0.0
            mujoco.mj_step2(model, data)
            everything = data.qvel
            if not everything.dot(everything) < MOST_RATE**2:
                raise WorldError(
                    f"the scene left all bounds at {data.time:.3f} s: velocities are {_largest(everything)}"
                )
            rates = everything[dofs]
            moved += rates
            squares += rates * rates
            mujoco.mj_step1(model, data)
        if any(data.warning[kind].number for kind in _FULL):
            raise WorldError(
                f"the scene has more contacts than its memory at {data.time:.3f} s: raise <size memory> in it"
            )
        period, substep = self.frame_s, self.frame_s / self.substeps
        held = self.holding[:, None]
        w = np.where(held, (data.qpos[self._places] - before) / period, 0.0)
        back = self._drive * w - u
        given = substep * (drive * moved - b * squares)
        lost = b * substep * (squares - 2.0 * w * moved + self.substeps * w * w)
        port = (0.5 * period) * (u * u - back * back)
        error = np.where(held, port - given - lost, 0.0)
        self.balance_error_j = max(self.balance_error_j, abs(float(error.sum())))
        self.force = drive - b * w

        energy = self._measure()
        factor = self.limiter.limit(dot(u, u), dot(back, back), energy - self._energy)
        self._energy = energy
        if factor < 1.0:
            back = factor * back
            port = (0.5 * period) * (u * u - back * back)
        self._book(port.sum(axis=1))
        if np.any(self.holding & ~self.solid):
            self._make_solid()
        return back

    def limiter_account(self) -> dict[str, float]:
        return self.limiter.account()

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

    def save(self) -> Row:
        mujoco.mj_getState(self.scene.model, self.data, self._state, _STATE)
        limiter = self.limiter
        seats = np.concatenate((self.holding, self.solid, self.port_work, self._work_error)).tolist()
        return (
            *self._state.tolist(), *seats, limiter.level_j, limiter.paid_j, float(limiter.limited), self.balance_error_j
        )  # fmt: skip

    def restore(self, saved: Row) -> None:
        seats, physics = len(self.holding), self._state.size
        check_saved(saved, physics + 4 * seats + 4)
        state = np.array(saved)
        holding, solid, work, work_error = state[physics:-4].reshape(4, seats)
        for user in range(seats):
            self._park(user)
            if holding[user]:
                self.join(user, np.zeros(3))
                self._touch(user, bool(solid[user]))
        mujoco.mj_setState(self.scene.model, self.data, state[:physics], _STATE)
        self.limiter.level_j, self.limiter.paid_j, limited, self.balance_error_j = saved[-4:]
        self.limiter.limited = int(limited)
        self.port_work, self._work_error = work, work_error
        self._refresh()


def _largest(velocities: Array) -> str:
    return f"up to {np.abs(velocities).max():.3g}"
