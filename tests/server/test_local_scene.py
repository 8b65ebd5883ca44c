"""Tools that lines hold only where something moves: no work when clear, no energy from a change, nothing passed through."""

from math import inf

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

from cogrip.server.worlds.scenes.clearance import NEAR_M
from cogrip.server.worlds.scenes.local_scene import CLOSE_M, OUT_M, RELEASE_S, LocalSceneWorld
from cogrip.server.worlds.world import WorldError

from tests.extent import long
from tests.server.local_worlds import course, holds_no_more, join_all, local_world, report, wander
from tests.server.scene_worlds import SHIPPED, Array, T, port_j

PADS = "", ""
SLIDES = "".join(f"<joint type='slide' axis='{axis}'/>" for axis in ("1 0 0", "0 1 0", "0 0 1"))
GATE = f"""<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.2"/>
  <body name="gate" pos=".1 0 0"><joint name="swing" type="hinge" axis="0 0 1"/>
    <geom type="box" size=".002 .1 .1" mass=".5"/></body>
  <body name="ball" pos="0 0 0">{SLIDES}<geom size=".01" mass=".05"/></body>
</worldbody></mujoco>"""
"""A thin gate that swings, 100 mm before a heavy ball."""


def ball_at(world: LocalSceneWorld, place: Array, frames: int = 1) -> Array:
    """Step with the first hand's proxy at a place; return the tool's."""
    for _ in range(frames):
        world.set_reported_positions(0, tuple(place), tuple(place))
        world.step(np.zeros((len(world.holding), 3)))
    return world.proxy(0)


def depth_m(world: LocalSceneWorld, user: int) -> float:
    """Return how deep the tool's balls are in what moves, by MuJoCo's own distance of every pair that can touch."""
    geometry, model, scene = world.geometry[user], world.scene.model, world.scene
    assert geometry.touches is not None
    seats = {tool.body: seat for seat, tool in enumerate(scene.tools)}
    roots = model.body_rootid[model.geom_bodyid]
    there = [root not in seats or world.holding[seats[root]] for root in roots]
    return max(
        (-mujoco.mj_geomDistance(model, world.data, ball, other, 0.1, None)
         for row, ball in enumerate(geometry.balls) for column, other in enumerate(geometry.obstacles)
         if geometry.touches[row, column] and there[other]),
        default=-inf,
    )  # fmt: skip


# Clear -------------------------------------------------------------------------------------------------------------------


@pytest.fixture
def world() -> LocalSceneWorld:
    """The gate and the ball, which a hand has taken."""
    return join_all(local_world(GATE, ["ball"]))


@pytest.mark.sample(1)
@pytest.mark.parametrize("scene", SHIPPED)
def test_a_clear_tool_is_where_its_proxy_is_and_nothing_feels_it(scene: str) -> None:
    """The course of all bodies is bit for bit that of a scene that nobody holds."""
    world, alone = join_all(local_world(scene)), local_world(scene)
    random = np.random.default_rng(1)
    goals = world.offset[:, :3] + np.array([[-0.2, 0.0, 0.2], [0.2, 0.0, 0.2]])
    report(world, goals)
    for _ in range(20):
        world.step(np.zeros((2, 3)))
        alone.step(np.zeros((2, 3)))
    for _ in range(200):
        goals = goals + random.uniform(-0.01, 0.01, (2, 3))
        report(world, goals)
        back = world.step(random.normal(0.0, 1.0, (2, 3)))
        alone.step(np.zeros((2, 3)))
        assert world.kinematic.all()
        assert not back.any()
        assert np.array([world.proxy(user) for user in (0, 1)]) == pytest.approx(goals, abs=1e-15)
        assert world.engaged_at(0) == ()
        assert np.abs(world.force).max() <= 1e-12
    tools = np.isin(np.arange(world.data.qpos.size), world._places)
    assert np.array_equal(world.data.qpos[~tools], alone.data.qpos[~tools])
    assert world.limiter.level_j == pytest.approx(alone.limiter.level_j, abs=1e-15)
    assert not world.port_work.any()


def test_a_far_proxy_is_reached_in_steps(world: LocalSceneWorld) -> None:
    places = [ball_at(world, np.array([-0.4, 0.0, 0.0]))[0] for _ in range(20)]
    steps = -np.diff([0.0, *places])
    assert steps.max() == pytest.approx(4.0 * T)
    assert places[-1] == -0.4


# Engaged -----------------------------------------------------------------------------------------------------------------


def test_it_is_engaged_before_it_touches_at_rest_and_no_jump_takes_it_through(world: LocalSceneWorld) -> None:
    surface = 0.1 - 0.002 - 0.01
    out = surface - NEAR_M - 2.5 * CLOSE_M
    assert ball_at(world, np.array([out, 0.0, 0.0]), 30)[0] == pytest.approx(out), "it follows out of the margin"
    assert world.engaged_at(0) == ()
    for goal in (surface - NEAR_M, 0.09, 0.11, 0.3):
        world = join_all(local_world(GATE, ["ball"]))
        place = ball_at(world, np.array([goal, 0.0, 0.0]), 30)
        assert 0.4 * CLOSE_M < surface - place[0] - NEAR_M < CLOSE_M
        assert world.engaged_at(0) == pytest.approx(place)
        assert world.solid[0]
        assert not world.data.qvel.any()


def test_it_is_engaged_earlier_where_a_body_comes_fast(world: LocalSceneWorld) -> None:
    place = np.array([0.07, 0.0, 0.0])  # 18 mm before it
    ball_at(world, place, 10)
    assert world.kinematic[0]
    world.data.joint("swing").qvel[:] = 20.0  # the gate's end goes at 2 m/s: 16 mm a frame
    world._refresh()
    ball_at(world, place)
    assert not world.kinematic[0]


def test_a_wave_drives_an_engaged_tool_as_it_does_without_local_models(world: LocalSceneWorld) -> None:
    ball_at(world, np.array([0.2, 0.0, 0.0]), 30)
    u = np.array([[0.3, 0.0, 0.0]])
    before, energy = world.proxy(0), world.energy_j
    v = world.step(u)
    w = (world.proxy(0) - before) / T
    assert v[0] == pytest.approx(np.sqrt(40.0) * w - u[0], abs=1e-12)
    assert port_j(u, v) >= world.energy_j - energy
    assert world.balance_error_j <= 1e-14
    for _ in range(100):
        world.step(u)
    swing = world.data.joint("swing")
    assert swing.qpos[0] or swing.qvel[0] or world.force[0, 0] > 1.0


def test_it_is_clear_again_a_while_after_the_last_body_was_near() -> None:
    """However hard its line presses it onto the floor: it need not wait for that, as the line ends without a reflection."""
    for push in (0.0, -1.0):
        world = join_all(local_world(GATE, ["ball"]))
        ball_at(world, np.array([0.2, 0.0, 0.0]), 30)
        began = world.engaged_at(0)
        for _ in range(10):
            world.step(np.array([[-1.0, 0.0, 0.0]]))  # away from the gate, with 6.3 N
        world.step(np.zeros((1, 3)))
        if push:
            world.data.qpos[world._places[0]] = [-1.0, 0.0, -0.19]  # pressed against the floor all the time
            world._refresh()
        u = np.array([[0.0, 0.0, push]])
        frames = 0
        while not world.kinematic[0] and frames < 1000:
            frames += 1
            world.set_reported_positions(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            world.step(u)
        assert frames == pytest.approx(RELEASE_S / T, abs=12)
        assert not world.data.qvel[world._dofs].any()
        ball_at(world, np.array([0.2, 0.0, 0.0]), 60)
        assert world.engaged_at(0) not in ((), began)


def test_a_second_engagement_at_the_same_place_is_told_as_another(world: LocalSceneWorld) -> None:
    ball_at(world, np.array([0.2, 0.0, 0.0]), 30)
    first = world.engaged_at(0)
    world._let_go(0)
    ball_at(world, np.array([0.2, 0.0, 0.0]))
    assert world.engaged_at(0) != first
    assert world.engaged_at(0) == pytest.approx(first, abs=1e-15)


@pytest.mark.parametrize("deep_m", [-1e-9, 0.0, 1e-16, 1e-9, 1e-4])
def test_a_proxy_on_a_surface_is_engaged_just_outside_of_it(deep_m: float) -> None:
    """It touches at once, so that it cannot sink into the floor."""
    world = join_all(local_world("lift"))
    floor = -0.03 + 0.012 + 0.008  # of the pad's origin, in the object's frame: 12 mm above a ball of 8 mm
    for way in (0.09, 0.07, 0.038):  # from the box's middle: first down, then along the floor to the box
        place = np.array([-way, 0.0, floor - deep_m]) + world.offset[0, :3]
        for _ in range(20):
            world.set_reported_positions(0, tuple(place), tuple(place))
            world.step(np.zeros((2, 3)))
    assert world.engaged_at(0)
    assert world.solid[0]
    lowest = world.data.geom_xpos[list(world.geometry[0].balls), 2].min() - 0.008
    assert 0.0 <= lowest <= 2.0 * OUT_M
    assert world.proxy(0)[1:] == pytest.approx(place[1:], abs=abs(deep_m) + 2.0 * OUT_M)
    start = world.energy_j
    came = 0.0
    for _ in range(50):
        u = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.0]])
        came += port_j(u, world.step(u))
    assert world.energy_j - start <= came + 1e-12
    assert world.data.geom_xpos[list(world.geometry[0].balls), 2].min() - 0.008 > -1e-3


def test_the_tool_of_another_seat_moves_and_one_that_nobody_holds_is_not_there() -> None:
    world = local_world("wall", ["ball", "ball"])
    world.join(0, np.zeros(3))
    apart = 2.0 * 0.03  # of the two tools at their starts
    for _ in range(40):
        ball_at(world, np.array([apart, 0.0, 0.0]))
    assert world.kinematic[0]
    ball_at(world, np.zeros(3), 40)
    world.join(1, np.zeros(3))
    assert world.kinematic.all()
    for _ in range(40):
        ball_at(world, np.array([apart, 0.0, 0.0]))
    assert not world.kinematic.any()
    assert 0.4 * CLOSE_M < apart - 0.02 - NEAR_M - world.proxy(0)[0] < CLOSE_M


def test_a_tool_taken_inside_a_body_is_engaged_and_touches_nothing_until_it_has_left() -> None:
    world = local_world(GATE, ["ball"])
    world.join(0, np.array([0.1, 0.0, 0.0]))
    assert world.engaged_at(0) == pytest.approx((0.1, 0.0, 0.0))
    assert not world.solid[0]
    for _ in range(20):
        world.step(np.array([[-0.5, 0.0, 0.0]]))
    assert world.solid[0]
    assert not world.data.joint("swing").qvel.any()


def test_a_heavy_tool_weighs_nothing(world: LocalSceneWorld) -> None:
    """Lifted while clear and let down while engaged it would make energy."""
    for frame in range(100):
        ball_at(world, np.array([0.0, 0.0, 0.001 * frame]))
        assert world.energy_j == pytest.approx(0.0, abs=1e-15)
    ball_at(world, np.array([0.2, 0.0, 0.1]), 30)
    before = world.proxy(0)
    for _ in range(50):
        world.step(np.zeros((1, 3)))
    assert world.proxy(0) == pytest.approx(before, abs=1e-12)


# Energy ------------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("scene", SHIPPED)
def test_no_energy_comes_of_proxies_and_changes_in_a_hundred_sessions(scene: str) -> None:
    """2e-9 J in the pile, whose boxes and tools touch at many points."""
    seen = [holds_no_more(join_all(local_world(scene)), seed, 1000, 1e-8, 1e-9) for seed in range(100)]
    assert len(set().union(*seen)) == 4


@pytest.mark.parametrize("scene", ["lift", long("pile")])
def test_no_clear_tool_is_put_into_a_body(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before bodies move, but after tools have been put, no tool that was outside of all bodies is inside of one."""
    world = join_all(local_world(scene))
    integrate, before, deepest = world.integrate, [inf, inf], list[float]()

    def watch(force: Array) -> tuple[Array, Array]:
        deepest.extend(depth_m(world, user) for user in (0, 1) if before[user] <= 0.0)
        return integrate(force)

    monkeypatch.setattr(world, "integrate", watch)
    for _ in wander(world, 11, 1000):
        before = [depth_m(world, user) if world.kinematic[user] else inf for user in (0, 1)]
    assert len(deepest) > 30
    assert max(deepest) <= 0.0


# Saving ------------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "tools", "axes"), [("lift", PADS, 3), ("pile", PADS, 3), ("lift", ("ball", "ball"), 6)]
)
def test_it_goes_on_bit_for_bit_where_it_was_saved(scene: str, tools: tuple[str, ...], axes: int) -> None:
    states = set()
    for frames in (10, 130, 200, 500):
        world, again = [join_all(local_world(scene, tools, axes=axes)) for _ in range(2)]
        course(world, 3, frames)
        saved = world.save()
        states |= set(world.kinematic.tolist())
        expected = course(world, 4, 150)
        for each in (again, world):
            each.restore(saved)
            assert each.save() == saved
            assert course(each, 4, 150) == expected
    assert states == {False, True}


def test_a_state_that_is_none_changes_nothing() -> None:
    world = join_all(local_world("lift"))
    course(world, 1, 50)
    before = world.save()
    for state in (before[:-1], (np.nan, *before[1:])):
        with pytest.raises(WorldError):
            world.restore(state)
        assert world.save() == before
