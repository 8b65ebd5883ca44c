"""Ports that turn: identity and energy of six axes, apparent inertia, felt stiffness, waves in the world's frame, limits."""

from math import cos, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_springs import springs_j
from cogrip.server.worlds.scenes.scene_text import SceneError

from tests.extent import every, long
from tests.server.scene_worlds import NOTHING, SLIDES, hold, port_j, world_of, world_of_settings

B_R = 0.02
FREE = '<body name="{}" pos="{} 0 0"><freejoint/><geom type="box" size=".02 .03 .01" mass=".1"/></body>'
PILE = NOTHING.format(FREE.format("tool", 0) + FREE.format("other", 0.05))


def poses(text: str, *orientations: str) -> SceneWorld:
    """Return the world of a body "tool", and of one seat more for each further orientation, at the body "other"."""
    return world_of(text, ("tool", "other")[: max(1, len(orientations))], axes=6, orientations=orientations)


@pytest.mark.parametrize("seed", every(10, range(20)))
def test_the_port_identity_holds_and_no_energy_is_made(seed: int) -> None:
    world, random = hold(poses(PILE)), np.random.default_rng(seed)
    start, given = world.energy_j, 0.0
    for frame in range(400):
        if frame % 40 == 0:
            goal = random.uniform(-0.3, 0.3, (1, 6)) * [0.3, 0.3, 0.3, 1.0, 1.0, 1.0]
        u = goal + random.normal(0.0, 0.05, goal.shape)
        given += port_j(u, world.step(u))
        assert world.energy_j - start <= given + 1e-9
    assert world.balance_error_j <= 1e-14
    assert world.limiter.limited == 0


def test_a_wave_that_turns_is_in_the_worlds_frame() -> None:
    """A tool that lies on its side is turned about the world's z axis by a wave along z, as one that stands."""
    turns = []
    for quaternion in ("1 0 0 0", ".70710678 .70710678 0 0", ".5 .5 .5 .5"):
        ball = f'<body name="tool" quat="{quaternion}"><freejoint/><geom size=".02" mass=".1"/></body>'
        world = hold(poses(NOTHING.format(ball)))
        before = Rotation.from_quat(world.data.body("tool").xquat, scalar_first=True)
        world.step(np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.05]]))
        assert world.force[0, 5] > 1e-3
        assert abs(world.force[0, 3:5]).max() < 1e-12
        for _ in range(30):
            world.step(np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.05]]))
        step = Rotation.from_quat(world.data.body("tool").xquat, scalar_first=True) * before.inv()
        turns.append(step.as_rotvec())
    assert turns[0][2] > 0.05
    assert np.allclose(turns, turns[0], atol=1e-9)


@pytest.mark.parametrize(
    ("joints", "orientation", "words"),
    [
        ("<freejoint/>", "fixed", 'has a free joint, so its orientation cannot be "fixed"; set "free"'),
        (SLIDES, "driven", 'has no free joint, so its orientation cannot be "driven"; set "fixed"'),
    ],
)
def test_an_orientation_that_a_body_cannot_have_is_refused(joints: str, orientation: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        poses(NOTHING.format(FREE.format("tool", 0).replace("<freejoint/>", joints)), orientation)


@pytest.mark.parametrize("orientation", ["free", "damped"])
def test_a_tool_whose_orientation_is_not_driven_turns_by_itself(orientation: str) -> None:
    """Pressed off its middle it turns; b_r slows it where it is damped."""
    world = poses(PILE, orientation, "")
    assert world.axes == 6
    world.join(0, np.zeros(6))
    world.data.qvel[world.scene.tools[0].dof + 3] = 5.0
    for _ in range(32):
        v = world.step(np.array([[0.0, 0.0, 0.0, 9.0, 9.0, 9.0], [0.0] * 6]))
    assert np.all(v[0, 3:] == 0.0), "its line carries no turning"
    left = world.data.qvel[world.scene.tools[0].dof + 3]
    assert (left == pytest.approx(5.0, rel=1e-3)) == (orientation == "free")
    assert (left < 0.1) == (orientation == "damped")


@pytest.mark.parametrize("turn", [(0.3, -0.4, 1.0), (0.0, 0.0, 3.0)])
def test_a_tool_keeps_its_turn_when_it_is_taken(turn: tuple[float, float, float]) -> None:
    """The proxy begins as the hand is turned, the tool stays as it was, and both then turn by the same rotations."""
    world = hold(poses(PILE))
    for _ in range(40):
        world.step(np.array([[0.0, 0.0, 0.0, 0.1, 0.05, 0.0]]))
    world.leave(0)
    before = world.data.body("tool").xquat.copy()
    assert 2.0 * np.arccos(before[0]) > 0.3
    world.join(0, np.array([0.01, 0.0, 0.02, *turn]))
    assert np.array_equal(world.data.body("tool").xquat, before)
    assert world.proxy(0) == pytest.approx([0.01, 0.0, 0.02, *turn], abs=1e-12)
    for _ in range(60):
        world.step(np.array([[0.0, 0.0, 0.0, 0.02, 0.0, 0.1]]))
    after = Rotation.from_quat(world.data.body("tool").xquat, scalar_first=True)
    tool = after * Rotation.from_quat(before, scalar_first=True).inv()
    hand = Rotation.from_rotvec(world.proxy(0)[3:]) * Rotation.from_rotvec(turn).inv()
    assert tool.magnitude() > 0.3
    assert (tool * hand.inv()).magnitude() < 1e-9


@pytest.mark.parametrize("name", ["pile", "wheel", long("peg"), long("valve"), long("table")])
def test_people_join_with_any_pose_and_come_back_without_energy(name: str) -> None:
    """Tools that welds hold stay where they are and go on as they do: no change of hands brings energy."""
    for seed in range(2):
        world, random = world_of_settings(name), np.random.default_rng(seed)
        seats, axes = len(world.holding), world.axes
        start, given, v = world.energy_j, 0.0, np.zeros((seats, axes))
        for frame in range(240):
            if frame % 20 == 0:
                user = int(random.integers(seats))
                before, places = world.energy_j, world.data.qpos.copy()
                if world.holding[user]:
                    world.leave(user)
                else:
                    pose = np.concatenate((random.uniform(-0.1, 0.1, 3), random.uniform(-1.8, 1.8, axes - 3)))
                    world.join(user, pose)
                    assert world.proxy(user) == pytest.approx(pose, abs=1e-9)
                assert world.energy_j - before <= 1e-9
                assert axes == 3 or np.array_equal(world.data.qpos, places)
                v[user] = 0.0
            u = np.where(world.holding[:, None], random.normal(0.0, 0.2, v.shape) - 0.5 * v, 0.0)
            v = world.step(u)
            given += port_j(u, v)
            assert world.energy_j - start <= given + 1e-9
        assert world.limiter.limited == 0


def test_a_room_whose_object_is_put_back_has_its_handles_at_it() -> None:
    world = world_of_settings("peg")
    world.join(0, np.array([0.0, 0.0, 0.05, 1.0, 0.0, 0.0]))
    for _ in range(60):
        world.step(np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0] * 6]))
    assert abs(world.position[2]) > 0.02
    world.leave(0)
    world.position = np.zeros(6)
    assert springs_j(world) == pytest.approx(springs_j(world_of_settings("peg")), abs=1e-9)


def test_the_object_of_a_room_of_poses_has_a_rotation_vector() -> None:
    world = poses(PILE)
    world.position = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.5])
    assert world.position == pytest.approx([0.1, 0.0, 0.0, 0.0, 0.0, 0.5])
    world.data.qvel[world.object._dof + 3] = 2.0
    assert world.velocity[3:] == pytest.approx([2.0 * cos(0.5), 2.0 * sin(0.5), 0.0]), "about its own x axis"
