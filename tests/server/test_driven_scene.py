"""Scenes under virtual coupling and time-domain passivity control: springs to the tools, and the power that may come out."""

import numpy as np
import pytest

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.worlds.scenes.driven_scene import CoupledScene, DrivenScene, PowerScene
from cogrip.server.worlds.scenes.scene_file import Held, make_scene
from cogrip.server.worlds.world import Array, WorldError

from tests.server.scene_worlds import T

EMPTY = (
    "<mujoco><option gravity='0 0 0'/><worldbody><geom type='plane' size='1 1 .1' pos='0 0 -1'/></worldbody></mujoco>"
)
K, B = 300.0, 5.0
MASS_KG = 0.05


def alone(world: type[DrivenScene], **coupling: object) -> DrivenScene:
    """Return a world with one tool, which a hand at (5, 0, 0) mm of its own frame has taken."""
    thing, springs = {"kind": "scene", "file": "x.xml", "axes": 3}, {"stiffness_npm": K, "damping_nspm": B, **coupling}
    settings = resolve({"object": thing, "coupling": springs, "users": [{"tool": "ball"}]})
    made = world([seat_settings(settings, 0)], make_scene(EMPTY, [Held("ball", "left", "")], T / 4), 4)
    made.join(0, np.array([0.005, 0.0, 0.0]))
    return made


def lead(world: DrivenScene, place: Array, pace: Array, energy_j: float, filled: float = 1.0) -> tuple[Array, Array]:
    """Step with a proxy led to a place; return force and velocity of it."""
    row = np.concatenate((place, pace, np.full(3, energy_j), np.full(3, filled)))
    answer = world.step(row[None])[0]
    return answer[:3], answer[3:]


def test_a_hand_that_rests_where_it_took_the_tool_feels_nothing() -> None:
    world = alone(CoupledScene)
    for _ in range(10):
        answer = world.step(np.array([[0.005, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0]
    assert answer == pytest.approx([0.005, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-15)
    assert world.force_of(0) == (0.0, 0.0, 0.0)


def test_the_force_is_spring_and_damper_held_over_the_frame() -> None:
    world = alone(CoupledScene)
    first = world.step(np.array([[0.007, 0.0, 0.0, 0.0, 0.1, 0.0]]))[0]
    force = np.array([K * 0.002, B * 0.1, 0.0])
    assert world.force_of(0) == pytest.approx(force)
    assert first[3:] == pytest.approx(force * T / MASS_KG), "F T = m v: nothing else acts on a free tool"
    moved = first[:3] - [0.005, 0.0, 0.0]
    assert moved == pytest.approx(force / MASS_KG * T * T * 10 / 16), "of four steps of h: h^2 (1 + 2 + 3 + 4)"
    assert world.port_work_j()[0] == pytest.approx(float(force @ moved))


@pytest.mark.parametrize("world", [CoupledScene, PowerScene])
def test_what_bodies_gain_is_the_work_of_the_force(world: type[DrivenScene]) -> None:
    made = alone(world)
    made.step(np.array([[0.02, 0.0, 0.01, 0.1, 0.0, 0.1, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0][: 3 * made.inputs_per_axis]]))
    speed = made.data.qvel[:3]
    assert made.gained_j == pytest.approx(0.5 * MASS_KG * float(speed @ speed)), "nothing else moves"
    before = made.gained_j
    made.leave(0)
    made.join(0, np.zeros(3))
    assert made.gained_j == before, "what hands take or leave is no step"


def test_it_comes_to_rest_at_the_hand_and_diverges_with_a_spring_too_stiff_for_the_frame() -> None:
    goal = np.array([[0.02, 0.0, 0.01, 0.0, 0.0, 0.0]])
    world = alone(CoupledScene)
    for _ in range(300):
        answer = world.step(goal)[0]
    assert answer == pytest.approx(goal[0], abs=1e-6)
    stiff = alone(CoupledScene, stiffness_npm=4000.0)
    with pytest.raises(WorldError, match="the scene left all bounds"):
        assert [stiff.step(goal) for _ in range(300)]


def test_a_proxy_goes_as_it_is_asked_while_there_is_energy_for_it_and_for_its_client() -> None:
    world, empty = alone(PowerScene), alone(PowerScene)
    pace = np.array([0.1, 0.0, 0.0])
    force, speed = lead(world, world.proxy(0) + T * pace, pace, energy_j=1.0)
    assert speed == pytest.approx(pace)
    assert force == pytest.approx(B * pace)
    assert world.port_work_j()[0] == pytest.approx(T * float(force @ speed))
    _, yielded = lead(empty, empty.proxy(0) + T * pace, pace, 1.0, filled=0.0)
    assert 0.0 < yielded[0] < speed[0], "with nothing to take it yields"


@pytest.mark.parametrize("energy_j", [0.0, 1e-5, 1e-4])
def test_no_more_comes_out_than_may(energy_j: float) -> None:
    world = alone(PowerScene)
    pace = np.array([0.2, -0.1, 0.0])
    place = world.proxy(0)
    before = 0.0
    for _ in range(30):
        place = place + T * pace
        force, speed = lead(world, place, pace, energy_j)
        assert np.all(T * force * speed <= energy_j * (1.0 + 1e-12))
        after = world.port_work_j()[0]
        assert after - before == pytest.approx(T * float(force @ speed), abs=1e-15)
        before = after
    if energy_j == 0.0:
        assert before <= 0.0


@pytest.mark.parametrize("world", [CoupledScene, PowerScene])
def test_a_tool_that_is_left_feels_no_force(world: type[DrivenScene]) -> None:
    made = alone(world)
    made.leave(0)
    made.step(np.full((1, 3 * made.inputs_per_axis), 0.3))
    assert made.force_of(0) == (0.0, 0.0, 0.0)
    assert not made.data.qvel.any()
