"""Rows of welds and connections at mid-step, against finite differences of what they hold together."""

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

from cogrip.server.worlds.scenes.equality_rows import EqualityRows
from cogrip.server.worlds.scenes.scene_springs import springs_j

from tests.server.scene_worlds import WORST_J, adversary, hold, port_j, world_of_settings

STEP_S = 1 / 512
BODIES = """<mujoco><option gravity="0 0 0" timestep="{step}" jacobian="{jacobian}"/><worldbody>
  <body name="a" pos="0 0 .1"><freejoint/><geom size=".03" mass=".1"/><site name="s" pos=".05 .01 .02"/></body>
  <body name="b" pos=".1 0 .1"><{joint} axis="0 1 0"/><geom size=".02" mass=".1" pos=".01 0 0"/>
    <site name="t" pos="-.04 .02 .01"/>
    <body name="c" pos="0 0 .1"><joint axis="1 0 0"/><geom size=".02" mass=".1" pos="0 .03 0"/></body></body>
  <body name="d" pos="0 .1 .1"><joint type="slide" axis="1 0 0"/><geom size=".02" mass=".1"/></body>
</worldbody><equality>{equality}</equality></mujoco>"""
EQUALITIES = {
    "weld": '<weld body1="a" body2="b"/>',
    "weld elsewhere": '<weld body1="b" body2="a" anchor=".03 .02 .01"/>',
    "connect": '<connect body1="a" body2="b" anchor=".05 .02 .01"/>',
    "sites": '<weld site1="s" site2="t"/>',
    "chain": '<connect body1="c" body2="a" anchor=".01 .02 .03"/>',
    "world": '<weld body1="a" anchor=".02 0 0"/>',
    "slide": '<weld body1="d" body2="a" anchor="0 .03 0"/>',
    "straight": '<weld body1="d" body2="a"/>',
    "several": '<joint joint1="hinge" polycoef="0 1"/><weld body1="a" body2="b" active="false"/>'
    '<weld body1="d" body2="b"/><connect body1="c" body2="a" anchor="0 .02 .03"/>',
}


def way_error_m(model: mujoco.MjModel, data: mujoco.MjData, at: np.ndarray) -> float:
    """Return by how much the way of the rows in a step differs from h J v."""
    jacobian = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        layout = data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
        mujoco.mju_sparse2dense(jacobian, data.efc_J, *layout)
    else:
        jacobian[:] = data.efc_J.reshape(jacobian.shape)
    after = mujoco.MjData(model)
    after.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, after.qpos, data.qvel, STEP_S)
    mujoco.mj_step1(model, after)
    return float(np.abs((after.efc_pos - data.efc_pos - STEP_S * jacobian @ data.qvel)[at]).max())


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("kind", EQUALITIES)
def test_rows_of_places_go_the_way_of_the_step(kind: str, jacobian: str) -> None:
    """An error of the third order in the step is left of h^2/2 J' v."""
    joint = 'joint name="hinge"'
    text = BODIES.format(step=STEP_S, jacobian=jacobian, joint=joint, equality=EQUALITIES[kind])
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(2).normal(0.0, 10.0, model.nv)
    mujoco.mj_integratePos(model, data.qpos, data.qvel, 0.02)
    mujoco.mj_step1(model, data)
    held = {number for number in range(model.neq) if model.eq_type[number] != mujoco.mjtEq.mjEQ_JOINT}
    numbers = data.efc_id[: data.ne].tolist()
    at = np.array([numbers.index(number) + axis for number in sorted(held & set(numbers)) for axis in range(3)])
    rows = EqualityRows(model)
    rows.arrange(data)
    before = way_error_m(model, data, at)
    rows.correct(data)
    assert (before > 1e-5) == (kind != "straight")
    assert way_error_m(model, data, at) <= max(0.05 * before, 1e-15)


@pytest.mark.long
def test_a_peg_that_spins_in_two_hands_gains_nothing_from_its_welds() -> None:
    """At 25 rad/s the handles leave their circles by 0.08 mm a step; against that the welds once did no work: 17.6 mJ."""
    world = hold(world_of_settings("peg"))
    push, v, came, start = adversary(world, 47), np.zeros((2, 6)), 0.0, world.energy_j
    least, window, spin = 0.0, 0.0, 0.0
    for frame in range(560):
        u = push(v)
        v = world.step(u)
        came += port_j(u, v)
        if frame > 500:
            held = world.energy_j - start - came + springs_j(world)
            least = min(least, held) if frame > 501 else held
            window = max(window, held - least)
            spin = max(spin, float(np.linalg.norm(world.data.qvel[3:6])))
    assert spin > 20.0
    assert window <= 0.001 * WORST_J["peg"]
