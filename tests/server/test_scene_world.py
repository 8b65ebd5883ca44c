"""Rigid bodies behind wave ports: answers put back into their equations, energy never created, the same bits every time."""

import subprocess
import sys
from itertools import pairwise
from math import inf, sqrt
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.server.worlds.energy_limiter import START_J
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_springs import springs_j
from cogrip.server.worlds.world import WorldError

from tests.extent import every, long
from tests.server.scene_worlds import (
    NOTHING,
    SCENES,
    SHIPPED,
    SLIDES,
    WORST_J,
    B,
    Person,
    T,
    adversary,
    course,
    hold,
    port_j,
    world_of,
    world_of_settings,
)

EMPTY = "<mujoco/>"
KAPPA, BETA, D = 4e5, 1300.0, 0.1
MOST_WINDOW_J = 1e-5  # that bodies and contact springs may gain above what came in, from any frame to any later one
DEFAULT_CONTACT = (
    """<mujoco>
  <option integrator="Euler" cone="pyramidal" impratio="1"/>
  <worldbody>
    <geom type="box" size=".02 .1 .1" pos=".08 0 0" margin=".001" solimp=".95 .99 .001 .5 2" solref=".02 1"/>
    <body name="ball" pos="0 0 0" gravcomp="1">"""
    + SLIDES
    + """
      <geom size=".01" mass=".05" margin=".001" solimp=".95 .99 .001 .5 2" solref=".02 1"/>
    </body>
  </worldbody>
</mujoco>"""
)


# The port ------------------------------------------------------------------------------------------------------------


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 4, 16]), st.floats(1.0, 60.0))
def test_a_free_tool_loses_what_its_equation_says(seed: int, substeps: int, b: float) -> None:
    """W - dE = b h sum (q_k - w)^2 + m/2 sum (q_k - q_k-1)^2, frame by frame; the second sum is Euler's own."""
    world = hold(world_of(EMPTY, ["ball"], substeps, b))
    random = np.random.default_rng(seed)
    h, m = T / substeps, 0.05
    for _ in range(50):
        u = random.uniform(-1.0, 1.0, (1, 3))
        q = [world.data.qvel.copy()]
        for _ in range(substeps):  # m (q+ - q) = h (sqrt(2b) u - b q+)
            q.append((m * q[-1] + h * sqrt(2 * b) * u[0]) / (m + h * b))
        before, energy = world.proxy(0), world.energy_j
        v = world.step(u)
        w = (world.proxy(0) - before) / T
        assert world.data.qvel == pytest.approx(q[-1], rel=1e-12, abs=1e-13)
        assert v[0] == pytest.approx(sqrt(2 * b) * w - u[0], rel=1e-12, abs=1e-13)
        assert world.force[0] == pytest.approx(sqrt(2 * b) * u[0] - b * w, rel=1e-12, abs=1e-13)
        assert world.energy_j == pytest.approx(0.5 * m * float((world.data.qvel**2).sum()), abs=1e-15)
        lost = b * h * sum(((each - w) ** 2).sum() for each in q[1:])
        lost += 0.5 * m * sum(((late - early) ** 2).sum() for early, late in pairwise(q))
        assert port_j(u, v) - (world.energy_j - energy) == pytest.approx(lost, abs=1e-14)
    assert world.balance_error_j <= 1e-14
    assert world.limiter.limited == 0


def test_contact_is_the_closed_form() -> None:
    """m (v+ - v)/h = sqrt(2b) u - b v+ - f,  f = max(0, D0 (v+ - v)/h + beta M v+ + kappa M (r + h v+)), r depth.

    M = m + h b, D0 = d/(1-d) M: implicit, and decided by the sign of f alone.
    """
    world = hold(world_of("wall", ["ball"]))
    h, m, x, v = T / 4, 0.05, 0.0, 0.0
    M = m + h * B
    D0 = D / (1 - D) * M
    surface = 0.06 - 0.01 + 0.03  # from the tool's start, 30 mm beside the middle
    touched = 0
    random = np.random.default_rng(1)
    for _ in range(600):
        u = float(random.uniform(-0.6, 1.0))
        for _ in range(4):
            free = (m * v + h * sqrt(2 * B) * u) / (m + h * B)
            A = D0 / h + BETA * M + KAPPA * M * h
            f = max(0.0, (A * free - D0 * v / h + KAPPA * M * (x - surface)) / (1.0 + A * h / (m + h * B)))
            v = free - h * f / (m + h * B)
            x += h * v
            touched += f > 0.0
        world.step(np.array([[u, 0.0, 0.0]]))
        assert world.proxy(0)[0] == pytest.approx(x, abs=1e-9)
        assert world.data.qvel[0] == pytest.approx(v, abs=1e-9)
        assert springs_j(world) == pytest.approx(0.5 * KAPPA * M * max(0.0, x - surface) ** 2, abs=1e-9)
    assert touched > 100


# Energy --------------------------------------------------------------------------------------------------------------


def most_above_input_j(world: SceneWorld, seed: int, frames: int) -> tuple[float, float]:
    """Return the most by which the world's energy exceeded all input, and by which a window's gain exceeded its input.

    In a window what springs hold counts as well: they give it back.
    """
    start, came = world.energy_j, 0.0
    push, v = adversary(world, seed), np.zeros((len(world.holding), world.axes))
    above, least, window = -inf, springs_j(world), -inf
    for _ in range(frames):
        u = push(v)
        v = world.step(u)
        came += port_j(u, v)
        excess = world.energy_j - start - came
        above = max(above, excess)
        held = excess + springs_j(world)
        window = max(window, held - least)
        least = min(least, held)
        assert world.limiter.level_j >= 0.0 or not v.any()
    return above, window


@pytest.mark.parametrize(
    ("name", "seeds", "frames"),
    [
        *every(2, [(name, range(1), 300) for name in WORST_J]),
        *(long(name, range(part, 100, 5), 1000) for name in WORST_J for part in range(5)),
    ],
)
def test_world_holds_no_more_than_came_in(name: str, seeds: range, frames: int) -> None:
    """Neither in all nor in any window of a session of random hands; every frame balances, and the limiter is blind."""
    for seed in seeds:
        world = hold(world_of_settings(name))
        above, window = most_above_input_j(world, seed, frames)
        assert above <= 1e-9, seed
        assert window <= WORST_J[name], seed
        assert world.balance_error_j <= 1e-14, seed
        assert world.limiter.limited == 0, seed


def attack(world: SceneWorld, frames: int) -> float:
    """Press a ball into the wall and let go, over and over; return what was taken."""
    taken = 0.0
    for frame in range(frames):
        u = np.array([[0.9 if frame % 32 < 12 else -0.35, 0.0, 0.0]])
        taken -= port_j(u, world.step(u))
    return taken


def with_eulers_steps() -> SceneWorld:
    """Return a world as it would be if scenes could choose the integrator."""
    world = hold(world_of(DEFAULT_CONTACT, ["ball"], 1))
    world.scene.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return world


def test_contact_that_creates_energy_is_bounded_by_the_limiter() -> None:
    assert attack(hold(world_of(DEFAULT_CONTACT, ["ball"], 1)), 40 * 32) < 0.0, "whatever contact the scene sets"
    free = with_eulers_steps()
    free.limiter.level_j = free.limiter.most_j = 1e9
    assert attack(free, 40 * 32) > 0.05
    world = with_eulers_steps()
    assert attack(world, 40 * 32) <= START_J + 1e-12
    assert world.limiter.limited > 0
    assert world.limiter.paid_j > 0.0


@pytest.mark.long
def test_boxes_that_touch_by_their_faces_create_energy_and_by_balls_in_their_corners_none() -> None:
    """Where two boxes meet, points of contact come and go, each with a spring that is pressed already."""
    text = (SCENES / "pile.xml").read_text().replace("0 -.01 .14", "0 .005 .14")  # the topmost box about to fall
    text = text.replace(
        "<default>", '<option jacobian="dense"/><default>', 1
    )  # on whose course the number of points changes
    faces = text.replace('contype="0" conaffinity="3"', "").replace('contype="2"', 'contype="0"')
    assert faces != text
    worst_j = [most_above_input_j(hold(world_of(each)), 25, 260)[1] for each in (faces, text)]
    assert worst_j[0] > 10.0 * MOST_WINDOW_J
    assert worst_j[1] <= 1e-9


# Feel ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, long(1), long(3)])
def test_stiffness_that_a_hand_feels_at_the_wall(delay: int) -> None:
    """The contact's and the line's in series: 4477, 1629 and 717 N/m."""
    world = hold(world_of("wall", ["ball"]))
    person, loads, place = Person(delay), [], 0.0
    for goal in (0.081, 0.0815):  # 1 and 1.5 mm beyond the surface
        for _ in range(1500):
            moved = max(-0.001, min(0.001, goal - place))
            place += moved
            person.exchange(moved, lambda u: float(world.step(np.array([[u, 0.0, 0.0]]))[0, 0]))
        loads.append(person.force_n)
    contact_npm = KAPPA * (0.05 + B * T / 4)
    line = (2 * delay + 1) * T / (2 * B)
    assert (loads[1] - loads[0]) / 0.0005 == pytest.approx(1.0 / (1.0 / contact_npm + line), rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("delay", [0, long(1), 3])
@pytest.mark.parametrize(("axis", "inertia", "b"), [(0, 0.05, B), (4, 4e-4, B / 1000.0)], ids=["moved", "turned"])
def test_a_free_tool_weighs_its_inertia_and_that_of_the_line(axis: int, inertia: float, b: float, delay: int) -> None:
    """A hand whose velocity grows steadily feels m + b (2 d + 1) T/2, or I with b_r for b (theory 8.4)."""
    ball = "<body name='tool'><freejoint/><inertial pos='0 0 0' mass='.05' diaginertia='4e-4 4e-4 4e-4'/></body>"
    world = hold(world_of(NOTHING.format(ball), ["tool"], axes=6))
    person, forces = Person(delay, b), []
    for frame in range(3000):
        person.exchange((frame + 1) * 0.5 * T * T, lambda u: float(world.step(u * np.eye(6)[[axis]])[0, axis]))
        forces.append(person.force_n)
    assert float(np.mean(forces[1500:])) / 0.5 == pytest.approx(inertia + b * (2 * delay + 1) * T / 2, rel=0.01)


# People come and go --------------------------------------------------------------------------------------------------


def test_a_tool_that_nobody_holds_touches_nothing_and_stays() -> None:
    world = world_of("lift")
    world.join(0, np.zeros(3))
    there = world.proxy(1)
    for _ in range(300):  # the box is pushed through where the other pad is
        world.step(np.array([[0.6, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    assert world.position[0] > 0.1
    assert world.position[2] == pytest.approx(0.0, abs=1e-3), "on the floor"
    assert world.proxy(1) == pytest.approx(there, abs=1e-15)
    assert world.port_work_j()[1] == 0.0
    assert not world.force[1].any()
    assert world.accounts.stiffness(1) is None, "no spring holds it"


def test_a_heavy_tool_of_the_scene_stays_while_nobody_holds_it() -> None:
    ball = f"<body name='ball'>{SLIDES}<geom size='.01' mass='.05'/></body>"
    world = world_of(f"<mujoco><worldbody>{ball}</worldbody></mujoco>", ["ball"])
    for _ in range(100):
        world.step(np.zeros((1, 3)))
    assert world.proxy(0) == pytest.approx(np.zeros(3), abs=1e-15)
    world.join(0, np.zeros(3))
    for _ in range(400):
        world.step(np.zeros((1, 3)))
    assert world.data.qvel[2] == pytest.approx(-0.05 * 9.81 / B, rel=1e-6), "held, it sinks against the port's damper"


def test_a_tool_that_is_taken_inside_a_body_touches_it_once_it_has_left() -> None:
    world = world_of("lift", ["ball"])
    world.join(0, np.array([0.082, 0.0, 0.0]))  # the middle of the box
    assert not world.solid[0]
    before = world.energy_j
    for _ in range(200):
        world.step(np.array([[-0.3, 0.0, 0.05]]))
    assert world.solid[0]
    assert world.energy_j - before <= world.port_work_j()[0] + 1e-9
    assert world.position == pytest.approx(np.zeros(3), abs=1e-4), "the box has not been thrown"
    for _ in range(300):
        world.step(np.array([[0.5, 0.0, -0.05]]))
    assert world.position[0] > 0.005, "now it is pushed"


def test_a_tool_inside_a_body_is_restored_as_it_was_whoever_else_holds_one() -> None:
    world, again = world_of("lift"), hold(world_of("lift"))
    world.join(0, np.array([0.082, 0.0, 0.0]))  # the middle of the box
    world.join(1, np.zeros(3))
    again.restore(world.save())
    assert world.solid.tolist() == again.solid.tolist() == [False, True]
    assert again.save() == world.save()


# The same bits -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", SHIPPED)
def test_a_saved_world_goes_on_bit_for_bit(scene: str) -> None:
    world = hold(world_of(scene))
    course(world, 1, 150)
    world.leave(1)
    saved = world.save()
    expected = course(world, 2, 100), world.save()
    again = hold(world_of(scene))
    course(again, 3, 70)
    again.restore(saved)
    assert again.save() == saved
    assert (course(again, 2, 100), again.save()) == expected
    with pytest.raises(WorldError, match="another world"):
        world_of(scene, ["ball", "ball", "ball"]).restore(saved)


@pytest.mark.long
def test_two_processes_give_the_same_bits() -> None:
    program = "from tests.server.scene_worlds import *; print(course(hold(world_of('pile')), 7, 150))"
    command, root = [sys.executable, "-c", program], Path(__file__).parents[2]
    other = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    assert other.stdout.strip() == course(hold(world_of("pile")), 7, 150)


# Failure -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wave", [np.nan, np.inf, 1e9])
def test_a_state_that_is_no_motion_is_named_and_a_reset_world_goes_on(wave: float, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    world = hold(world_of("lift"))
    with pytest.raises(WorldError, match=r"left all bounds at [0-9.]+ s"):
        world.step(np.full((2, 3), wave))
    world.reset()
    assert not world.holding.any()
    hold(world)
    assert np.isfinite(world.step(np.zeros((2, 3)))).all()
    assert world.data.qpos == pytest.approx(hold(world_of("lift")).data.qpos, abs=1e-4)
    assert list(tmp_path.iterdir()) == [], "MuJoCo writes no log"


def test_more_contacts_than_memory_are_named() -> None:
    text = "<mujoco><size memory='20K'/><worldbody><geom type='plane' size='1 1 1'/>" + "".join(
        f"<body pos='{0.05 * number} 0 .02'><freejoint/><geom type='box' size='.02 .02 .02' mass='.1'/></body>"
        for number in range(6)
    )
    world = hold(world_of(text + "</worldbody></mujoco>", ["ball"]))
    with pytest.raises(WorldError, match="more contacts than its memory"):
        world.step(np.zeros((1, 3)))
