"""Start of a scene: as its bodies stand, or one of its keyframes; and the constant controls of its actuators."""

from collections.abc import Collection, Sequence
from math import isfinite
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.texts import shown
from cogrip.server.worlds.scenes.scene_text import SceneError, listed

Array = NDArray[np.float64]
_WIDTHS = {
    int(mujoco.mjtJoint.mjJNT_FREE): (7, 6), int(mujoco.mjtJoint.mjJNT_BALL): (4, 3), int(mujoco.mjtJoint.mjJNT_SLIDE): (1, 1),
    int(mujoco.mjtJoint.mjJNT_HINGE): (1, 1),
}  # fmt: skip
"""Coordinates and rates of each kind of joint."""


class Start(NamedTuple):
    """Values of a scene's own bodies and actuators at its start. What tools are added has its own, as the model has it.

    coordinates, dofs, mocaps  places of the values in the model
    """

    coordinates: NDArray[np.intp]
    dofs: NDArray[np.intp]
    mocaps: NDArray[np.intp]
    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    mocap_pos: Array
    mocap_quat: Array

    def begin(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Put data to the start."""
        mujoco.mj_resetData(model, data)
        data.qpos[self.coordinates], data.qvel[self.dofs] = self.qpos, self.qvel
        data.act[:], data.ctrl[:] = self.act, self.ctrl
        data.mocap_pos[self.mocaps], data.mocap_quat[self.mocaps] = self.mocap_pos, self.mocap_quat

    def data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Return data at the start, with the places of all bodies."""
        data = mujoco.MjData(model)
        self.begin(model, data)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return data


def start_of(
    bare: mujoco.MjModel, keyframe: str, ctrl: Sequence[float], name: str, model: mujoco.MjModel | None = None,
    added: Collection[int] = (),
) -> Start:  # fmt: skip
    """Return the start of a scene. Raises SceneError for a keyframe that it has not, or controls that do not fit.

    bare: the scene as its author has it; model: with its tools, whose bodies with new joints are `added`; None: none yet
    """
    key = _key(bare, keyframe, name)
    reset = mujoco.MjData(bare)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(bare, reset, key)
    if ctrl:
        _check(bare, ctrl, name)
        reset.ctrl[:] = ctrl
    model = model or bare
    coordinates: list[int] = []
    dofs: list[int] = []
    for joint in range(model.njnt):
        if int(model.jnt_bodyid[joint]) not in added:
            width, rates = _WIDTHS[int(model.jnt_type[joint])]
            coordinates += range(model.jnt_qposadr[joint], model.jnt_qposadr[joint] + width)
            dofs += range(model.jnt_dofadr[joint], model.jnt_dofadr[joint] + rates)
    kept = [body for body in range(model.nbody) if model.body_mocapid[body] >= 0]
    mocaps = model.body_mocapid[kept]
    own = bare.body_mocapid[kept]
    return Start(
        np.array(coordinates, dtype=np.intp), np.array(dofs, dtype=np.intp), mocaps.astype(np.intp), reset.qpos.copy(),
        reset.qvel.copy(), reset.act.copy(), reset.ctrl.copy(), reset.mocap_pos[own].copy(), reset.mocap_quat[own].copy(),
    )  # fmt: skip


def names_of(model: mujoco.MjModel, count: int, of: str) -> list[str]:
    """Return the names of a model's elements of a kind, their numbers where they have none."""
    return [getattr(model, of)(number).name or str(number) for number in range(count)]


def _key(bare: mujoco.MjModel, keyframe: str, name: str) -> int:
    """Return the number of a keyframe, which is its name where it has none; -1 where none is asked for."""
    if not keyframe:
        return -1
    names = names_of(bare, bare.nkey, "key")
    if keyframe not in names:
        there = f"its keyframes are {listed(names)}" if names else "it has none; leave object.keyframe out"
        raise SceneError(f"{name}: there is no keyframe {shown(keyframe)!r}; {there}")
    return names.index(keyframe)


def _check(bare: mujoco.MjModel, ctrl: Sequence[float], name: str) -> None:
    names = names_of(bare, bare.nu, "actuator")
    if len(ctrl) != bare.nu or not all(map(isfinite, ctrl)):
        has = f"{bare.nu} actuators, {listed(names)}" if names else "no actuators"
        raise SceneError(f"{name}: object.ctrl has {len(ctrl)} values, and the scene {has}; give a finite one for each")
    for actuator, value in enumerate(ctrl):
        low, high = bare.actuator_ctrlrange[actuator]
        if bare.actuator_ctrllimited[actuator] and not low <= value <= high:
            raise SceneError(
                f"{name}: object.ctrl of {names[actuator]!r} is {value:g}, outside of its ctrlrange, {low:g} to {high:g}"
            )
