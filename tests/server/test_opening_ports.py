"""Tools that are grippers: the opening is a port of its own impedance; energy, taking hold, saved states, scenes without."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_text import SceneError

from tests.server.scene_worlds import NOTHING, SLIDES, B, T, hold, port_j, world_of

GRIP_NSPM = 8.0
BLOCK = '<body name="block" pos="0 0 0"><freejoint/><geom type="box" size=".006 .006 .015" mass=".05"/></body>'
FINGER = '<body name="finger">{}<geom size=".005" mass=".02"/></body>'
HAND = f'<body name="hand">{SLIDES}<geom size=".005" mass=".03" pos="0 -.02 0"/>{{}}</body>'


def grippers(bodies: str, *tools: str, grip_nspm: float = GRIP_NSPM, substeps: int = 4) -> SceneWorld:
    return world_of(NOTHING.format(bodies), tools, substeps, grip_impedance_nspm=grip_nspm)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 4, 16]), st.floats(1.0, 60.0))
def test_a_free_finger_is_a_mass_at_its_own_impedance(seed: int, substeps: int, b: float) -> None:
    """m (q+ - q) = h (sqrt(2 b_g) u - b_g q+), v = sqrt(2 b_g) w - u, theory 8.1; the hand is as heavy as a rock."""
    body = HAND.format(FINGER.format('<joint type="slide" axis="0 1 0"/>')).replace('mass=".03"', 'mass="1e6"')
    world = hold(grippers(body, "pinch:hand", grip_nspm=b, substeps=substeps), 0.02)
    random, h, m, q = np.random.default_rng(seed), T / substeps, 0.02, 0.0
    for _ in range(30):
        u = np.array([[0.0, 0.0, 0.0, random.uniform(-1.0, 1.0)]])
        before = world.proxy(0)[3]
        for _ in range(substeps):
            q = (m * q + h * sqrt(2.0 * b) * u[0, 3]) / (m + h * b)
        v = world.step(u)
        w = (world.proxy(0)[3] - before) / T
        assert v[0, 3] == pytest.approx(sqrt(2.0 * b) * w - u[0, 3], rel=1e-6, abs=1e-9)
        assert world.force[0, 3] == pytest.approx(sqrt(2.0 * b) * u[0, 3] - b * w, rel=1e-6, abs=1e-9)
        assert world.data.qvel[world.openings.dofs[0]] == pytest.approx(q, rel=1e-4, abs=1e-7)
    assert world.balance_error_j <= 1e-14


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(2.0, 40.0))
def test_whatever_hands_do_no_gripper_gives_more_than_came_in(seed: int, b: float) -> None:
    """Two grippers and a hand without one squeeze, tear and throw a block."""
    world = hold(grippers(BLOCK, "pinch", "pinch", "ball", grip_nspm=b), 0.02)
    random = np.random.default_rng(seed)
    came, begun = 0.0, world.energy_j
    v = np.zeros((3, 4))
    for number in range(150):
        if number % 5 == 0:
            push = random.uniform(-3.0, 3.0, (3, 4)) * random.integers(0, 2, (3, 4))
        u = push + random.choice([-0.9, 0.0, 0.9]) * v
        u[2, 3] = 0.0
        v = world.step(u)
        came += port_j(u, v)
        assert v[2, 3] == 0.0, "a hand without a gripper has no axis there"
        assert world.energy_j - begun <= came + 1e-3
    assert world.balance_error_j <= 1e-13
    assert world.limiter.limited == 0


def test_fingers_hold_a_block_that_they_squeeze() -> None:
    """Theory 8.1 at rest: w = 0, F = sqrt(2 b_g) u, v = -u; the thumb takes what the finger presses; the hand feels none."""
    world = grippers(BLOCK, "pinch")
    world.join(0, np.array([*(world.offset[0, :3] - (0.0, 0.007, 0.0)), 0.02]))
    u = np.array([[0.0, 0.0, 0.0, -0.5]])
    for _ in range(300):
        v = world.step(u)
    assert world.force[0] == pytest.approx([0.0, 0.0, 0.0, -0.5 * sqrt(2.0 * GRIP_NSPM)], abs=1e-3)
    assert v[0, 3] == pytest.approx(0.5, abs=1e-4)
    assert world.proxy(0)[3] == pytest.approx(0.012, abs=3e-4)
    assert world.solid[0]
    assert len(world.motion()) == 8
    assert world.motion()[3] == world.motion()[7] == 0.0


def test_one_that_is_parked_stays_open_as_it_was() -> None:
    world = hold(grippers(BLOCK, "pinch"), 0.015)
    world.step(np.array([[0.0, 0.0, 0.0, 1.0]]))
    world.leave(0)
    at = world.proxy(0)[3]
    damping = world.scene.model.dof_damping[world.openings.dofs[0]]
    for _ in range(20):
        world.step(np.array([[5.0, 5.0, 5.0, 5.0]]))
    assert world.proxy(0)[3] == at
    assert damping == 0.0
    world.join(0, np.array([0.0, 0.0, 0.0, 0.01]))
    assert world.scene.model.dof_damping[world.openings.dofs[0]] == GRIP_NSPM
    assert world.proxy(0)[3] == pytest.approx(0.01)


def test_a_saved_state_goes_on_bit_for_bit() -> None:
    world, other = (hold(grippers(BLOCK, "pinch", "ball"), 0.02) for _ in range(2))
    random = np.random.default_rng(1)
    pushes = [random.uniform(-1.0, 1.0, (2, 4)) for _ in range(40)]
    for u in pushes[:20]:
        world.step(u)
    other.restore(world.save())
    for u in pushes[20:]:
        assert world.step(u).tolist() == other.step(u).tolist()
    assert world.save() == other.save()


def test_an_impedance_that_changes_takes_that_of_the_gripper_along() -> None:
    world = hold(grippers(BLOCK, "pinch"), 0.02)
    world.set_impedance(0, 2.0 * B)
    assert world.further_impedance[0, 0] == pytest.approx(2.0 * GRIP_NSPM)
    assert world.scene.model.dof_damping[world.openings.dofs[0]] == pytest.approx(2.0 * GRIP_NSPM)
    v = world.step(np.array([[0.0, 0.0, 0.0, 1.0]]))
    assert world.balance_error_j <= 1e-15
    assert abs(v[0, 3]) <= 1.0


@pytest.mark.parametrize(
    ("finger", "count"),
    [
        ("", 0),
        (FINGER.format(""), 0),
        (FINGER.format('<joint type="hinge" axis="0 1 0"/>'), 0),
        (
            FINGER.format('<joint type="slide" axis="0 1 0"/>')
            + FINGER.replace("finger", "two").format('<joint type="slide"/>'),
            2,
        ),
    ],
)
def test_a_body_without_one_finger_is_no_gripper(finger: str, count: int) -> None:
    with pytest.raises(SceneError, match=f"'hand' cannot be a gripper: it needs one child .* and {count} have"):
        grippers(HAND.format(finger), "pinch:hand")


def test_the_digest_of_a_scene_tells_a_gripper_from_a_hand() -> None:
    body = HAND.format(FINGER.format('<joint type="slide" axis="0 1 0"/>'))
    digests = {grippers(body, tool).scene.digest for tool in ("hand", "pinch:hand")}
    assert len(digests) == 2


def test_a_seat_has_four_axes_and_an_impedance_of_its_gripper_or_neither() -> None:
    table = resolve(
        {"object": {"kind": "scene", "file": "x.xml", "axes": 3}, "users": [{"tool": "pinch"}, {"tool": "pad"}]}
    )
    grips, plain = (seat_settings(table, number) for number in range(2))
    assert (grips.object.axes, grips.coupling.further_impedance) == (4, 10.0)
    assert (plain.object.axes, plain.coupling.further_impedance) == (3, 0.02)
    for seat, coupling in ((grips, plain.coupling), (plain, grips.coupling)):
        with pytest.raises(ValueError, match="the impedance of its gripper, or of turning, alone"):
            replace(seat, coupling=coupling)
