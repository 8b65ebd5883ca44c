"""Coriolis and gyroscopic forces of linked bodies: they do no work over a step, and are those of the bodies that need it."""

import mujoco
import numpy as np
import pytest

from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.velocity_forces import linked_dofs

from tests.server.scene_worlds import NOTHING, hold, world_of

LINK = '<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/>'
TOP = f'<body><joint type="ball"/>{LINK}</body>'
CHAIN = f'<body><joint axis="0 1 0"/>{LINK}<body pos=".1 0 0"><joint axis="0 1 0"/>{LINK}</body></body>'
RAGDOLL = f'<body><freejoint/>{LINK}<body pos=".1 0 0"><joint type="ball"/>{LINK}</body></body>'
SPINS = {
    "top": (TOP, (100.0, 5.0, 3.0)),
    "chain": (CHAIN, (20.0, -30.0)),
    "ragdoll": (RAGDOLL, (0, 0, 0, 5, 1, 2, 100, 5, 5)),
}


def spun(text: str, rates: tuple[float, ...]) -> SceneWorld:
    world = world_of(NOTHING.format(text), ["pad"])
    world.data.qvel[: len(rates)] = rates
    world._refresh()
    return world


@pytest.mark.parametrize("name", SPINS)
def test_what_spins_freely_keeps_its_energy_where_in_mujoco_alone_it_grows(name: str) -> None:
    text, rates = SPINS[name]
    world = spun(text, rates)
    begun_j, energies = world.energy_j, []
    model = mujoco.MjModel.from_xml_string(NOTHING.format(text))
    model.opt.timestep, model.opt.integrator = 1 / 512, mujoco.mjtIntegrator.mjINT_DISCRETE
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qvel[:] = rates
    alone_j = 0.0
    for _ in range(512):
        world.step(np.zeros((1, 3)))
        energies.append(world.energy_j)
        for _ in range(4 if alone_j < 100.0 * begun_j else 0):
            mujoco.mj_step(model, data)
        alone_j = max(alone_j, float(data.energy.sum()))
    most = 0.2 if name == "ragdoll" else 0.05  # a free body's own turning drifts in MuJoCo
    assert np.abs(np.array(energies) - begun_j).max() < most * begun_j
    assert alone_j > 1.1 * begun_j


def test_a_state_is_saved_with_what_the_forces_remember() -> None:
    world = spun(*SPINS["chain"])
    for _ in range(20):
        world.step(np.zeros((1, 3)))
    saved = world.save()
    ends = []
    for each in (world, spun(*SPINS["chain"])):
        each.restore(saved)
        for _ in range(20):
            each.step(np.zeros((1, 3)))
        ends.append(each.save())
    assert ends[0] == ends[1]


SLIDES = '<body><joint type="slide"/><geom size=".01"/><body><joint type="slide" axis="0 1 0"/><geom size=".01"/></body></body>'
HINGE, FREE = f"<body><joint/>{LINK}</body>", f"<body><freejoint/>{LINK}</body>"


@pytest.mark.parametrize(
    ("text", "dofs"),
    [
        (SLIDES, []),
        (HINGE, []),
        (FREE, []),
        (TOP, [0, 1, 2]),
        (CHAIN, [0, 1]),
        (RAGDOLL, [*range(9)]),
        (HINGE + TOP, [1, 2, 3]),
    ],
)
def test_bodies_alone_are_left_to_mujoco(text: str, dofs: list[int]) -> None:
    assert linked_dofs(mujoco.MjModel.from_xml_string(NOTHING.format(text))).tolist() == dofs
    world = hold(world_of(NOTHING.format(text), ["pad"]))
    assert world._forces.numbers == (world.scene.model.nv + 1 if dofs else 0)
