"""The shared object: answers put back into their equations (theory sections 3.3, 3.4, 3.7), and energy never created."""

from collections.abc import Callable
from copy import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cogrip.protocol.settings import SeatSettings, resolve, seat_settings
from cogrip.server.schemes import make_world
from cogrip.server.worlds.grip import RAMP_S, GripWorld
from cogrip.server.worlds.lagged import CoupledWorld, LaggedWorld, PaperWorld
from cogrip.server.worlds.push import PushWorld
from cogrip.server.worlds.small_room import SmallGripWorld
from cogrip.server.worlds.world import WORKSPACE_M, World

Array = NDArray[np.float64]
T = 1 / 128

seeds = st.integers(0, 2**32 - 1)
users = st.integers(1, 6)
axes = st.integers(1, 3)


def seats(count: int, thing: str = "cube", dimensions: int = 1, **coupling: object) -> list[SeatSettings]:
    people = [{"name": f"u{number}", "side": ("left", "right")[number % 2]} for number in range(count)]
    settings = resolve({"object": {"kind": thing, "axes": dimensions}, "coupling": coupling, "users": people})
    return [seat_settings(settings, number) for number in range(count)]


def spread(random: np.random.Generator, low: float, high: float, shape: tuple[int, ...]) -> Array:
    """Numbers of every magnitude between the bounds, now and then 0."""
    drawn: Array = 10.0 ** random.uniform(np.log10(low), np.log10(high), shape)
    return np.where(random.random(shape) < 0.1, 0.0, drawn)


def draw(world: World, random: np.random.Generator) -> None:
    """Parameters and state at random, everyone seated."""
    count = len(world.side)
    world.impedance = 10.0 ** random.uniform(-1, 3, (count, 1))
    world.wave_gain = np.sqrt(2.0 / world.impedance)
    world.stiffness = world.target_stiffness = spread(random, 1.0, 1e6, (count, 1))
    world.damping = world.target_damping = spread(random, 1e-2, 1e3, (count, 1))
    world.mass_kg = float(10.0 ** random.uniform(-3, 2))
    world.object_damping = float(spread(random, 1e-2, 1e2, (1,))[0])
    world.position = random.uniform(-0.1, 0.1, world.axes)
    world.velocity = random.uniform(-1.0, 1.0, world.axes)
    world.external_force = random.uniform(-5.0, 5.0, world.axes)
    world.side = random.choice([-1.0, 1.0], count)
    world.holding[:] = True


def grip(count: int, dimensions: int, seed: int) -> tuple[GripWorld, Array]:
    random = np.random.default_rng(seed)
    world = GripWorld(seats(count, dimensions=dimensions))
    draw(world, random)
    world.stretch = random.uniform(-0.02, 0.02, (count, dimensions))
    return world, random.uniform(-2.0, 2.0, (count, dimensions))


def push(count: int, dimensions: int, seed: int, kind: str = "faces") -> tuple[PushWorld, Array]:
    random = np.random.default_rng(seed)
    world = PushWorld(seats(count, kind, dimensions))
    draw(world, random)
    if kind == "wall":
        world.position, world.velocity = np.zeros(dimensions), np.zeros(dimensions)
    depth = random.uniform(-0.02, 0.02, count)
    world.hand = np.repeat(world.position[None, :], count, axis=0)
    world.hand[:, 0] += world.side * depth
    return world, random.uniform(-2.0, 2.0, (count, dimensions))


def stored(world: World) -> float:
    """Energy of springs and object [J]."""
    if isinstance(world, GripWorld):
        springs = world.stiffness * world.stretch**2
    else:
        assert isinstance(world, PushWorld)
        springs = world.stiffness[:, 0] * np.maximum(0.0, world.side * (world.hand[:, 0] - world.position[0])) ** 2
    return 0.5 * (float(springs.sum()) + world.mass_kg * float(world.velocity @ world.velocity))


def came_in(inputs: Array, answers: Array) -> float:
    """Energy out of the lines in one step [J]."""
    return 0.5 * T * float((inputs**2 - answers**2).sum())


# A free object held from all sides -----------------------------------------------------------------------------------


@given(users, axes, seeds)
def test_grip_solves_its_equations(count: int, dimensions: int, seed: int) -> None:
    world, u = grip(count, dimensions, seed)
    e, x, v = world.stretch.copy(), world.position.copy(), world.velocity.copy()
    answers = world.step(u)
    c, b, K, B = world.wave_gain, world.impedance, world.stiffness, world.damping
    mid = (world.position - x) / T
    relative = (world.stretch - e) / T
    w = mid + relative
    F = world.force
    scale = 1.0 + np.abs(K * e) + np.abs((K * T / 2 + B) * c * u)
    assert np.all(np.abs(F - K * (e + world.stretch) / 2 - B * relative) <= 1e-9 * (scale + np.abs(K * 0.1) / T))
    assert w == pytest.approx(c * u - F / b, rel=1e-9, abs=1e-9)
    assert answers == pytest.approx(u - c * F, rel=1e-12, abs=1e-12)
    assert mid == pytest.approx((world.velocity + v) / 2, rel=1e-9, abs=1e-10)
    total = F.sum(axis=0) + world.external_force
    inertia = world.mass_kg * (world.velocity - v) / T
    tolerance = 1e-9 * (np.abs(scale).sum() + world.mass_kg / T)
    assert np.all(np.abs(inertia + world.object_damping * mid - total) <= tolerance)


@given(users, axes, seeds, st.integers(1, 30))
def test_grip_balances_exactly_at_every_step(count: int, dimensions: int, seed: int, steps: int) -> None:
    world, _ = grip(count, dimensions, seed)
    random = np.random.default_rng(seed + 1)
    for _ in range(steps):
        u = random.uniform(-2.0, 2.0, (count, dimensions))
        before, e, x = stored(world), world.stretch, world.position
        answers = world.step(u)
        mid, relative = (world.position - x) / T, (world.stretch - e) / T
        lost = T * (float((world.damping * relative**2).sum()) + world.object_damping * float(mid @ mid))
        supplied = came_in(u, answers) + T * float(world.external_force @ mid)
        size = before + stored(world) + lost + 0.5 * T * float((u**2 + answers**2).sum())
        assert supplied == pytest.approx(stored(world) - before + lost, abs=1e-8 * size)
        assert world.balance_error_j <= 1e-11 * size + 1e-9


@given(users, axes, seeds)
def test_a_heavy_object_is_a_fixed_one(count: int, dimensions: int, seed: int) -> None:
    """vbar = 0 in theory 3.3: every user for themselves, F_i = alpha_i."""
    world, u = grip(count, dimensions, seed)
    world.mass_kg, world.velocity = 1e15, np.zeros(dimensions)
    G = world.stiffness * T / 2 + world.damping
    alpha = (world.stiffness * world.stretch + G * world.wave_gain * u) / (1.0 + G / world.impedance)
    before = world.position.copy()
    world.step(u)
    assert world.force == pytest.approx(alpha, rel=1e-9, abs=1e-9)
    assert world.position == pytest.approx(before, abs=1e-12)


def test_a_hand_at_a_fixed_object_meets_its_stiffness_at_rest() -> None:
    """Steady u: w = 0, so F = b c u = K e."""
    world = GripWorld(seats(1))
    world.stiffness, world.damping, world.mass_kg = world.target_stiffness, world.target_damping, 1e15
    for _ in range(2000):
        world.step(np.array([[0.3]]))
    assert world.force[0, 0] == pytest.approx(np.sqrt(2 * 20.0) * 0.3, rel=1e-9)
    assert world.stretch[0, 0] == pytest.approx(world.force[0, 0] / 1000.0, rel=1e-9)


@pytest.mark.parametrize(("stiffness", "damping", "expected"), [(0.0, 0.0, 1.0), (1e12, 0.0, -1.0), (0.0, 20.0, 0.0)])
def test_grip_ends_of_the_line(stiffness: float, damping: float, expected: float) -> None:
    """An open end reflects the wave, a rigid one inverts it, B = b absorbs it."""
    world = GripWorld(seats(1))
    world.mass_kg = 1e15
    world.stiffness[:], world.damping[:] = stiffness, damping
    assert world.step(np.array([[0.7]]))[0, 0] == pytest.approx(expected * 0.7, abs=1e-7)


# Faces and walls -----------------------------------------------------------------------------------------------------


def push_residual(world: PushWorld, u: Array, v: float) -> tuple[float, float]:
    """Left less right side of theory 3.4 for the object's velocity v, before the step; and the size of its terms."""
    c, b = world.wave_gain[:, 0], world.impedance[:, 0]
    K, s = world.stiffness[:, 0], world.side
    G = world.damping[:, 0] + K * T
    d, g = s * (world.hand[:, 0] - world.position[0]), c * u[:, 0]
    F = np.maximum(0.0, K * d + G * s * (g - v)) / (1.0 + G / b)
    left = world.mass_kg * (v - world.velocity[0]) / T + world.object_damping * v
    size = np.abs(K * d).sum() + (G * (np.abs(g) + abs(v))).sum() + world.mass_kg / T * (abs(v) + 1.0) + 10.0
    return left - float((s * F).sum()) - float(world.external_force[0]), float(size)


@given(users, axes, seeds)
def test_push_solves_its_equation(count: int, dimensions: int, seed: int) -> None:
    world, u = push(count, dimensions, seed)
    before, hand, v = copy(world), world.hand.copy(), world.velocity.copy()
    answers = world.step(u)
    residual, size = push_residual(before, u, float(world.velocity[0]))
    assert abs(residual) <= 1e-11 * size
    assert answers == pytest.approx(u - world.wave_gain * world.force, rel=1e-12, abs=1e-12)
    w = world.wave_gain * u - world.force / world.impedance
    assert world.hand == pytest.approx(hand + T * w, abs=1e-12)
    assert np.all(world.force[:, 1:] == 0.0), "no friction along the face"
    free = (world.mass_kg / T * v + world.external_force) / (world.mass_kg / T + world.object_damping)
    assert world.velocity[1:] == pytest.approx(free[1:], rel=1e-12)


@given(users, seeds, st.integers(0, 5), st.sampled_from([-1e-6, 0.0, 1e-6]))
def test_push_at_a_break_point(count: int, seed: int, which: int, aside: float) -> None:
    """Force the object to a velocity just below, at and just above one user's break point: that user lets go there."""
    world, u = push(count, 1, seed)
    world.stiffness, world.damping = np.maximum(world.stiffness, 1.0), np.maximum(world.damping, 1e-2)
    user = which % count
    K, s, c = world.stiffness[:, 0], world.side, world.wave_gain[:, 0]
    G = world.damping[:, 0] + K * T
    d = s * (world.hand[:, 0] - world.position[0])
    wanted = float((c * u[:, 0] + s * K * d / G)[user]) + aside
    residual, size = push_residual(world, u, wanted)
    world.external_force[0] += residual  # now `wanted` is the solution
    world.step(u)
    assert world.velocity[0] == pytest.approx(wanted, abs=1e-11 * size * T / world.mass_kg + 1e-12)
    share = G[user] / (1.0 + G[user] / world.impedance[user, 0])
    noise = abs(world.velocity[0] - wanted) + 1e-13 * (abs(wanted) + abs(c[user] * u[user, 0]) + K[user] / G[user])
    push_n = world.force[user, 0] * s[user]
    assert abs(push_n - share * max(0.0, -aside * s[user])) <= share * noise


@pytest.mark.parametrize(("aside", "touches"), [(-1e-9, True), (1e-9, False)])
def test_a_face_lets_go_exactly_at_its_break_point(aside: float, touches: bool) -> None:
    """The face runs away from the hand at c u + K d / G: the velocity at which the force is 0."""
    world = PushWorld(seats(1, "faces"))
    world.join(0, np.zeros(1))
    world.hand[0, 0] = 1e-3
    G = 10.0 + 1000.0 * T
    edge = np.sqrt(2 / 20.0) * 0.5 + 1000.0 * 1e-3 / G
    world.velocity[0] = edge + aside
    world.step(np.array([[0.5]]))
    assert bool(world.force[0, 0] > 0.0) is touches
    assert world.force[0, 0] <= G * 1e-9


@given(users, axes, seeds, st.integers(1, 40), st.sampled_from(["faces", "wall"]))
def test_push_never_creates_energy(count: int, dimensions: int, seed: int, steps: int, kind: str) -> None:
    """Stored energy never exceeds what was there and what came in, at every step."""
    world, _ = push(count, dimensions, seed, kind)
    random = np.random.default_rng(seed + 1)
    budget = stored(world)
    for _ in range(steps):
        u = random.uniform(-2.0, 2.0, (count, dimensions))
        before, x = stored(world), world.position
        answers = world.step(u)
        moved = world.position - x
        supplied = came_in(u, answers) + float(world.external_force @ moved)
        lost = world.object_damping * float(moved @ moved) / T
        size = before + stored(world) + 0.5 * T * float((u**2 + answers**2).sum()) + abs(supplied) + lost
        assert stored(world) - before + lost <= supplied + 1e-11 * size
        budget += supplied
        assert stored(world) <= budget + 1e-9 * (size + abs(budget))


@given(users, axes, seeds)
def test_a_wall_pushes_and_never_pulls(count: int, dimensions: int, seed: int) -> None:
    world, _ = push(count, dimensions, seed, "wall")
    random = np.random.default_rng(seed + 1)
    for _ in range(20):
        world.step(random.uniform(-2.0, 2.0, (count, dimensions)))
        assert np.all(world.side * world.force[:, 0] >= 0.0)
        assert np.all(world.force[:, 1:] == 0.0)
        assert not world.position.any()
        assert not world.velocity.any()


def test_the_usual_depth_test_would_create_energy() -> None:
    """The step in which a hand crosses the surface: neither a depth test nor the midpoint force pays for the spring."""
    b, K, d, u = 20.0, 1000.0, -0.5e-3, 1.0
    c = np.sqrt(2 / b)

    def gained(force: float) -> float:
        w, wave = c * u - force / b, u - c * force
        return float(0.5 * K * max(0.0, d + T * w) ** 2 - 0.5 * T * (u * u - wave * wave))

    midpoint = (K * d + K * T / 2 * c * u) / (1.0 + K * T / 2 / b)
    assert midpoint > 0.0
    assert gained(0.0) > 1e-3, "depth <= 0 at the start, so no force"
    assert gained(midpoint) > 1e-4
    world = PushWorld(seats(1, "wall", damping_nspm=0.0))
    world.join(0, np.array([d]))
    world.step(np.array([[u]]))
    assert gained(float(world.force[0, 0])) < 0.0


# Joining and leaving -------------------------------------------------------------------------------------------------


@given(st.integers(2, 5), axes, seeds)
def test_people_come_and_go_and_bring_no_energy(count: int, dimensions: int, seed: int) -> None:
    """Object and springs never hold more than what came in through the lines, stiffness ramps included."""
    world = GripWorld(seats(count, dimensions=dimensions, stiffness_npm=5e4, damping_nspm=2.0))
    random = np.random.default_rng(seed)
    budget = 0.0
    for _ in range(200):
        user = int(random.integers(count))
        if random.random() < 0.1:
            if world.holding[user]:
                world.leave(user)
            else:
                world.join(user, random.uniform(-0.3, 0.3, dimensions))
        u = np.where(world.holding[:, None], random.uniform(-1.0, 1.0, (count, dimensions)), 0.0)
        budget += came_in(u, world.step(u))
        assert stored(world) <= budget + 1e-12 * (1.0 + abs(budget))
        assert np.all(world.stiffness <= world.target_stiffness * (1.0 + 1e-12))
        assert np.all(world.stiffness >= 0.0)
        assert np.all(world._ledger >= -1e-15)


@pytest.mark.parametrize("kind", ["cube", "faces", "wall"])
def test_joining_makes_no_force_wherever_the_hand_is(kind: str) -> None:
    for place in (-0.2, 0.0, 0.2):
        world = make_world(seats(2, kind, 3))
        for user in range(2):
            position = np.array([place, 0.1, -0.1])
            world.join(user, position)
            assert world.proxy(user) == pytest.approx(position)
        assert not world.step(np.zeros((2, 3))).any()
        assert not world.force.any()
        assert not world.velocity.any()


def test_stiffness_grows_over_the_ramp_when_the_spring_is_slack() -> None:
    world = GripWorld(seats(1))
    world.join(0, np.zeros(1))
    frames = round(RAMP_S / T)
    grown = []
    for _ in range(frames + 2):
        world.step(np.zeros((1, 1)))
        grown.append(float(world.stiffness[0, 0]))
    assert grown[frames // 2 - 1] == pytest.approx(1000.0 * (frames // 2) * T / RAMP_S)
    assert grown[-1] == 1000.0
    assert max(np.diff(grown)) <= 1000.0 * T / RAMP_S + 1e-9


def test_a_stretched_spring_without_damper_cannot_grow() -> None:
    world = GripWorld(seats(1, damping_nspm=0.0))
    world.join(0, np.zeros(1))
    world.stretch[0, 0] = 0.01
    for _ in range(100):
        world.step(np.zeros((1, 1)))
    assert world.stiffness[0, 0] == 0.0


@given(seeds)
def test_the_damper_pays_for_a_spring_that_grows_under_tension(seed: int) -> None:
    world = GripWorld(seats(1, stiffness_npm=1e5, damping_nspm=5.0))
    world.join(0, np.zeros(1))
    random = np.random.default_rng(seed)
    world.stretch[0, 0] = 0.02
    paid = dissipated = 0.0
    for _ in range(300):
        u, e, K = random.uniform(-1.0, 1.0, (1, 1)), world.stretch.copy(), world.stiffness.copy()
        world.step(u)
        relative = (world.stretch - e) / T
        dissipated += T * float((world.damping * relative**2).sum())
        paid += 0.5 * float(((world.stiffness - K) * world.stretch**2).sum())
        assert paid <= dissipated * (1.0 + 1e-12)
    assert world.stiffness[0, 0] > 0.0


@pytest.mark.parametrize("kind", ["cube", "faces"])
def test_leaving_discards_the_spring_and_kicks_nobody(kind: str) -> None:
    """Two people squeeze; one leaves. The object's velocity does not jump and the energy only falls."""
    world = make_world(seats(2, kind))
    for user in range(2):
        world.join(user, np.zeros(1))
    squeeze = np.array([[0.4], [-0.4]])
    for _ in range(500):
        world.step(squeeze)
    held, force, velocity = stored(world), world.force[0, 0], world.velocity.copy()
    assert held > 1e-3
    assert force == pytest.approx(0.4 * np.sqrt(40.0), rel=1e-6)
    world.leave(1)
    assert np.array_equal(world.velocity, velocity)
    assert stored(world) == pytest.approx(held / 2, rel=1e-6), "their half of it is gone"
    budget, u = stored(world), np.array([[0.4], [0.0]])
    for _ in range(200):
        budget += came_in(u, world.step(u))
        assert stored(world) <= budget + 1e-12
        assert abs(world.force[0, 0]) <= abs(force) * (1.0 + 1e-9), "never more than was held before"
    assert world.force[1, 0] == 0.0


def test_who_comes_back_starts_anew() -> None:
    world = GripWorld(seats(1))
    world.join(0, np.zeros(1))
    for _ in range(100):
        world.step(np.array([[0.3]]))
    world.leave(0)
    assert not world.force.any()
    world.join(0, np.array([0.2]))
    assert world.proxy(0) == pytest.approx([0.2])
    assert world.stiffness[0, 0] == 0.0
    assert not world.stretch.any()


# The schemes to compare with -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_lagged_object_moves_as_a_free_mass_under_a_held_force(damping: float) -> None:
    settings = resolve({"object": {"mass_kg": 0.2, "damping_nspm": damping}, "coupling": {"server_step": "paper"}})
    world = PaperWorld([seat_settings(settings, 0)])
    world.velocity, world.external_force = np.array([0.3]), np.array([0.5])
    moved = world.move_object()
    fine, x, v = 200_000, 0.0, 0.3
    for _ in range(fine):  # midpoint rule, far finer than the frame
        middle = v + 0.5 * T / fine * (0.5 - damping * v) / 0.2
        x += T / fine * middle
        v += T / fine * (0.5 - damping * middle) / 0.2
    assert moved[0] == pytest.approx(x, rel=1e-9)
    assert world.velocity[0] == pytest.approx(v, rel=1e-9)


def test_paper_step_decodes_with_the_force_of_the_step_before() -> None:
    """P eq. 17 and 18 with theory section 1's factors."""
    world = PaperWorld(seats(2, server_step="paper"))
    for user in range(2):
        world.join(user, np.zeros(1))
    world.force, world.hand = np.array([[0.5], [-0.2]]), np.array([[0.01], [-0.02]])
    world.velocity = np.array([0.1])
    u = np.array([[0.3], [0.1]])
    v_s = np.sqrt(2 / 20.0) * u - world.force / 20.0
    hand = world.hand + T * v_s
    force = 1000.0 * hand + 10.0 * (v_s - 0.1)
    answers = world.step(u)
    assert world.hand == pytest.approx(hand, rel=1e-12)
    assert world.force == pytest.approx(force, rel=1e-12)
    assert answers == pytest.approx(u - np.sqrt(2 / 20.0) * force, rel=1e-12)


def test_virtual_coupling_sums_springs_and_answers_with_what_it_stepped_from() -> None:
    world = CoupledWorld(seats(2, kind="coupling"))
    world.join(0, np.array([0.1]))
    world.join(1, np.array([-0.1]))
    world.position, world.velocity = np.array([0.02]), np.array([0.3])
    answers = world.step(np.array([[0.13, 0.0], [-0.1, 0.2]]))
    assert world.force == pytest.approx(np.array([[1000 * 0.01 - 3.0], [1000 * -0.02 - 1.0]]))
    assert answers == pytest.approx(np.array([[0.12, 0.3], [-0.08, 0.3]])), "each in their own frame"


@pytest.mark.parametrize("step", ["passive", "paper"])
@pytest.mark.parametrize("kind", ["cube", "faces", "wall"])
def test_worlds_by_settings(kind: str, step: str) -> None:
    world = make_world(seats(1, kind, server_step=step))
    expected: type[World] = PaperWorld if step == "paper" else SmallGripWorld if kind == "cube" else PushWorld
    assert type(world) is expected
    assert type(make_world(seats(1, kind, kind="coupling"))) is CoupledWorld


@pytest.mark.parametrize("make", [GripWorld, PushWorld, PaperWorld, CoupledWorld])
def test_the_room_has_an_end(make: Callable[[list[SeatSettings]], World]) -> None:
    world = make(seats(1))
    for place, outside in ((WORKSPACE_M, False), (-WORKSPACE_M, False), (WORKSPACE_M * 1.001, True), (np.nan, True)):
        world.position = np.array([place])
        assert world.left_workspace is outside


def test_lagged_contact_has_the_usual_depth_test() -> None:
    world = PaperWorld(seats(1, "wall", server_step="paper"))
    assert isinstance(world, LaggedWorld)
    world.join(0, np.zeros(1))
    world.hand[0, 0] = -1e-3
    assert world.contact(np.array([[0.5]]))[0, 0] == 0.0
    world.hand[0, 0] = 1e-3
    assert world.contact(np.array([[0.0]]))[0, 0] == pytest.approx(1.0)
    assert world.contact(np.array([[-1.0]]))[0, 0] == 0.0, "and never pulls"
