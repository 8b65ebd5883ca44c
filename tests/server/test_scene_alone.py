"""A scene whose tools nobody holds moves as in MuJoCo alone, with the options and contact that the scene's account names."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from cogrip.server.worlds.scenes import scene_file
from cogrip.server.worlds.scenes.scene_text import scene_of

from tests.server.scene_worlds import world_of

STEP_S, SUBSTEPS, FRAMES, SAME = 1 / 512, 4, 640, 1e-9  # 5 s
FLOOR = '<geom type="plane" size="1 1 .1"/>'
FREE = {
    "pendulum": '<body pos="0 0 .5"><joint axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/></body>',
    "arm": '<body pos="0 0 .5"><joint axis="0 1 0" damping=".01"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/>'
    '<body pos=".1 0 0"><joint axis="0 1 0" armature=".001"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/></body>'
    "</body>",
    "spring": '<body><joint type="slide" stiffness="50" damping=".5" frictionloss=".1"/><geom size=".03" mass=".2"/></body>',
    "free body": '<body><freejoint/><geom type="box" size=".01 .02 .03" mass=".2"/></body>',
    "ball joint": '<body pos="0 0 .5"><joint type="ball" damping=".001"/><geom size=".02" pos="0 0 -.1" mass=".1"/></body>',
    "servo": '<body><joint name="x" axis="0 1 0" damping=".01"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/></body>'
    '</worldbody><actuator><position joint="x" kp="1" ctrlrange="-1 1"/></actuator><worldbody>',
    "tendon": '<body><joint name="x" type="slide"/><geom size=".02" mass=".1"/></body>'
    '</worldbody><tendon><fixed stiffness="100" damping="1"><joint joint="x" coef="1"/></fixed></tendon><worldbody>',
}  # fmt: skip
"""Scenes without contact and equalities."""
LINKED = ("arm", "ball joint")
"""Those whose Coriolis and gyroscopic forces are taken at the middle of a step."""
CONTACT = {
    "box": FLOOR + '<body pos="0 0 .05"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>',
    "door": FLOOR + '<body><joint axis="0 0 1" damping=".02" range="-20 20"/>'
    '<geom type="box" size=".005 .06 .08" pos="0 -.06 .085" mass=".2"/></body>',
    "pile": FLOOR + '<body pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>'
    '<body pos="0 0 .1"><freejoint/><geom size=".03" mass=".1"/></body>',
}  # fmt: skip


def alone(text: str) -> mujoco.MjModel:
    """Return a scene without tools, with what `Scene.changed` and `Scene.filled` say."""
    spec, options = mujoco.MjSpec.from_string(text), scene_of(text, "x.xml").options
    scene_file._solved(spec, options, STEP_S)
    scene_file._complete(spec, options, STEP_S)
    return spec.compile()


@pytest.mark.sample(7)
@pytest.mark.parametrize(
    "options", ["", '<option integrator="implicitfast" timestep=".002"/>'], ids=["plain", "implicitfast"]
)
@pytest.mark.parametrize("name", [name for name in (*FREE, *CONTACT) if name not in LINKED])
def test_a_scene_moves_as_in_mujoco_alone_for_five_seconds(name: str, options: str, tmp_path: Path) -> None:
    """Where there is contact, a force counts by its sign from the margin on: `efc_margin` is 0 then."""
    text = f"<mujoco>{options}<worldbody>{ {**FREE, **CONTACT}[name] }</worldbody></mujoco>"
    model, world = alone(text), world_of(text, ["pad"])
    assert bool(world.scene.changed) == bool(options)
    data = mujoco.MjData(model)
    begun = 0.5 * np.random.default_rng(1).normal(size=model.nv)
    data.qvel[:], world.data.qvel[: model.nv] = begun, begun
    mujoco.mj_step1(model, data)
    world._refresh()
    for _ in range(FRAMES):
        world.step(np.zeros((1, 3)))
        for _ in range(SUBSTEPS):
            if name in CONTACT:
                data.efc_margin[:] = 0.0
            mujoco.mj_step2(model, data)
            mujoco.mj_step1(model, data)
        assert np.abs(world.data.qpos[: model.nq] - data.qpos).max() <= SAME
        assert np.abs(world.data.qvel[: model.nv] - data.qvel).max() <= 1e3 * SAME
    assert np.abs(data.qpos - model.qpos0).max() > 1e-3, "it has moved"


@pytest.mark.parametrize("name", LINKED)
def test_linked_bodies_move_more_nearly_as_they_should_than_in_mujoco_alone(name: str) -> None:
    text = f"<mujoco><worldbody>{FREE[name]}</worldbody></mujoco>"
    world, coarse, fine = world_of(text, ["pad"]), alone(text), alone(text)
    fine.opt.timestep = STEP_S / 64.0
    begun = 6.0 * np.random.default_rng(1).normal(size=fine.nv)
    ends, steps = [], round(0.5 / STEP_S)
    for model, count in ((coarse, steps), (fine, 64 * steps)):
        data = mujoco.MjData(model)
        data.qvel[:] = begun
        for _ in range(count):
            mujoco.mj_step(model, data)
        ends.append(data.qpos.copy())
    world.data.qvel[: fine.nv] = begun
    world._refresh()
    for _ in range(steps // SUBSTEPS):
        world.step(np.zeros((1, 3)))
    error, of_mujoco = (np.abs(end - ends[1]).max() for end in (world.data.qpos[: fine.nq], ends[0]))
    assert error < 0.9 * of_mujoco
    assert of_mujoco < 0.2
