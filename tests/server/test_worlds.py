"""The shared object: answers put back into their equations (theory sections 3.3, 3.4, 3.7), and energy never created."""

from collections.abc import Callable
from copy import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, Kind
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.schemes import make_world
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.grip_step import RAMP_S
from cogrip.server.worlds.lagged import CoupledWorld, LaggedWorld, PaperWorld
from cogrip.server.worlds.local_faces import LocalFacesWorld
from cogrip.server.worlds.partners import PartnersWorld
from cogrip.server.worlds.power import PowerWorld
from cogrip.server.worlds.push import PushWorld
from cogrip.server.worlds.world import WORKSPACE_M, World

from tests.kinds import FREE_OBJECTS, OBJECTS, SCHEMES, objects_of
from tests.server.object_worlds import seats, stored_j
from tests.server.scene_worlds import Array, T, port_j

seeds = st.integers(0, 2**32 - 1)
users = st.integers(1, 6)
axes = st.integers(1, 3)


def spread(random: np.random.Generator, low: float, high: float, shape: tuple[int, ...]) -> Array:
    """Numbers of every magnitude between the bounds, now and then 0."""
    drawn: Array = 10.0 ** random.uniform(np.log10(low), np.log10(high), shape)
    return np.where(random.random(shape) < 0.1, 0.0, drawn)


def draw(world: World, random: np.random.Generator) -> None:
    """Parameters and state at random, everyone seated."""
    count = len(world.side)
    for user, impedance in enumerate(10.0 ** random.uniform(-1, 3, count)):
        world.set_impedance(user, float(impedance))
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
    world = GripWorld(seats(count, axes=dimensions))
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
        before, e, x = stored_j(world), world.stretch, world.position
        answers = world.step(u)
        mid, relative = (world.position - x) / T, (world.stretch - e) / T
        lost = T * (float((world.damping * relative**2).sum()) + world.object_damping * float(mid @ mid))
        supplied = port_j(u, answers) + T * float(world.external_force @ mid)
        size = before + stored_j(world) + lost + 0.5 * T * float((u**2 + answers**2).sum())
        assert supplied == pytest.approx(stored_j(world) - before + lost, abs=1e-8 * size)
        assert world.balance_error_j <= 1e-11 * size + 1e-9


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


@given(users, axes, seeds, st.integers(1, 40), st.sampled_from(["faces", "wall"]))
def test_push_never_creates_energy(count: int, dimensions: int, seed: int, steps: int, kind: str) -> None:
    """Stored energy never exceeds what was there and what came in, at every step."""
    world, _ = push(count, dimensions, seed, kind)
    random = np.random.default_rng(seed + 1)
    budget = stored_j(world)
    for _ in range(steps):
        u = random.uniform(-2.0, 2.0, (count, dimensions))
        before, x = stored_j(world), world.position
        answers = world.step(u)
        moved = world.position - x
        supplied = port_j(u, answers) + float(world.external_force @ moved)
        lost = world.object_damping * float(moved @ moved) / T
        size = before + stored_j(world) + 0.5 * T * float((u**2 + answers**2).sum()) + abs(supplied) + lost
        assert stored_j(world) - before + lost <= supplied + 1e-11 * size
        budget += supplied
        assert stored_j(world) <= budget + 1e-9 * (size + abs(budget))
        assert np.all(world.side * world.force[:, 0] >= 0.0), "it pushes and never pulls"
        assert kind != "wall" or not (world.position.any() or world.velocity.any())


# Joining and leaving -------------------------------------------------------------------------------------------------


@given(st.integers(2, 5), axes, seeds)
def test_people_come_and_go_and_bring_no_energy(count: int, dimensions: int, seed: int) -> None:
    """Object and springs never hold more than what came in through the lines, stiffness ramps included."""
    world = GripWorld(seats(count, axes=dimensions, stiffness_npm=5e4, damping_nspm=2.0))
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
        budget += port_j(u, world.step(u))
        assert stored_j(world) <= budget + 1e-12 * (1.0 + abs(budget))
        assert np.all(world.stiffness <= world.target_stiffness * (1.0 + 1e-12))
        assert np.all(world.stiffness >= 0.0)
        assert np.all(np.array(world._paid_j) >= -1e-15)


@pytest.mark.parametrize("kind", OBJECTS)
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


@given(seeds, st.sampled_from([0.0, 5.0]))
def test_the_damper_pays_for_a_spring_that_grows_under_tension_and_without_one_none_grows(seed: int, B: float) -> None:
    world = GripWorld(seats(1, stiffness_npm=1e5, damping_nspm=B))
    world.join(0, np.zeros(1))
    random = np.random.default_rng(seed)
    world.stretch = np.full((1, 1), 0.02)
    paid = dissipated = 0.0
    for _ in range(300):
        u, e, K = random.uniform(-1.0, 1.0, (1, 1)), world.stretch.copy(), world.stiffness.copy()
        world.step(u)
        relative = (world.stretch - e) / T
        dissipated += T * float((world.damping * relative**2).sum())
        paid += 0.5 * float(((world.stiffness - K) * world.stretch**2).sum())
        assert paid <= dissipated * (1.0 + 1e-12)
    assert (world.stiffness[0, 0] > 0.0) == (B > 0.0)


@pytest.mark.parametrize("kind", FREE_OBJECTS)
def test_leaving_discards_the_spring_and_kicks_nobody_and_who_comes_back_starts_anew(kind: str) -> None:
    """Two people squeeze; one leaves. The object's velocity does not jump and the energy only falls."""
    world = make_world(seats(2, kind))
    for user in range(2):
        world.join(user, np.zeros(1))
    squeeze = np.array([[0.4], [-0.4]])
    for _ in range(500):
        world.step(squeeze)
    held, force, velocity = stored_j(world), world.force[0, 0], world.velocity.copy()
    assert held > 1e-3
    assert force == pytest.approx(0.4 * np.sqrt(40.0), rel=1e-6)
    world.leave(1)
    assert np.array_equal(world.velocity, velocity)
    assert stored_j(world) == pytest.approx(held / 2, rel=1e-6), "their half of it is gone"
    budget, u = stored_j(world), np.array([[0.4], [0.0]])
    for _ in range(200):
        budget += port_j(u, world.step(u))
        assert stored_j(world) <= budget + 1e-12
        assert abs(world.force[0, 0]) <= abs(force) * (1.0 + 1e-9), "never more than was held before"
    assert world.force[1, 0] == 0.0
    held = stored_j(world)
    world.join(1, np.array([0.2]))
    assert world.proxy(1) == pytest.approx([0.2])
    assert (stored_j(world), world.accounts.stiffness(1)) == (held, 0.0 if kind_of(kind).held else 1000.0)


# The schemes to compare with -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_lagged_object_moves_as_a_free_mass_under_a_held_force(damping: float) -> None:
    world = PaperWorld(seats(1, object_={"mass_kg": 0.2, "damping_nspm": damping}, server_step="paper"))
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


def test_virtual_coupling_sums_springs_and_answers_with_the_object_after_the_step() -> None:
    """F held over T moves a mass m at v by v T + F T^2/2m, and makes it v + F T/m."""
    world = CoupledWorld(seats(2, kind="coupling"))
    world.join(0, np.array([0.1]))
    world.join(1, np.array([-0.1]))
    world.position, world.velocity = np.array([0.02]), np.array([0.3])
    answers = world.step(np.array([[0.13, 0.0], [-0.1, 0.2]]))
    assert world.force == pytest.approx(np.array([[1000 * 0.01 - 3.0], [1000 * -0.02 - 1.0]]))
    gained = T / world.mass_kg * (1000 * 0.01 - 3.0 + 1000 * -0.02 - 1.0)
    place, speed = 0.02 + T * (0.3 + 0.5 * gained), 0.3 + gained
    assert world.motion() == pytest.approx((place, speed), rel=1e-12)
    assert answers == pytest.approx(np.array([[0.1 + place, speed], [-0.1 + place, speed]])), "each in their own frame"


@pytest.mark.parametrize(("scheme", "kind"), [(scheme, kind) for scheme in SCHEMES for kind in objects_of(scheme)])
def test_worlds_by_settings(scheme: Kind, kind: str) -> None:
    worlds: dict[Kind, type[World]] = {
        "wave": GripWorld if kind_of(kind).held else PushWorld, "local": LocalFacesWorld, "coupling": CoupledWorld,
        "tdpa": PowerWorld, "partner": PartnersWorld,
    }  # fmt: skip
    assert type(make_world(seats(1, kind, kind=scheme))) is worlds[scheme]
    if COUPLING_KINDS[scheme].paper_step:
        assert type(make_world(seats(1, kind, kind=scheme, server_step="paper"))) is PaperWorld


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
