"""Worlds with tools: the identity of the port, also of poses, and the examples of docs/worlds.md against closed forms."""

from math import atan, cos, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.protocol.laws.rotations import between, exp, product
from cogrip.protocol.settings.object_kinds import PYTHON
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.worlds.registry import ALLOWED, world_class_of

from tests.server.broken_worlds import Springs, Tumbling, seats

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples" / "worlds"
FRAME_S = 1.0 / 128.0


@pytest.fixture(autouse=True)
def allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ALLOWED, str(EXAMPLES))


def example(file: str, name: str, users: int, **given: Any) -> Any:
    kind = f"{PYTHON}{EXAMPLES / file}:{name}"
    people = [{"name": f"user{number}"} for number in range(users)]
    settings = resolve({"object": {"kind": kind, **given}, "users": people})
    return world_class_of(kind).make([seat_settings(settings, number) for number in range(users)])


def hold(world: Any) -> Any:
    for user in range(len(world.holding)):
        world.join(user, np.full(world.axes, 0.01 * user))
    return world


@pytest.mark.parametrize(("kind", "axes", "least_j"), [(Springs, 2, 1e-14), (Tumbling, 6, 1e-12)])
def test_what_comes_in_at_a_port_is_the_work_of_force_and_damper(
    kind: type[Springs], axes: int, least_j: float
) -> None:
    """(u^2 - v^2) T/2 = (sqrt(2b) u - b w) w T at each tool and axis, and what friction does not take, B w^2 T, is stored.

    Of six axes torque and damper work on the rotation: b_r for b, and w the rotation vector from one orientation to the next.
    """
    world, random, unit = hold(kind(seats(3, axes))), np.random.default_rng(1), np.array([1.0] * 3 + [1e-3] * 3)[:axes]
    assert world.port_impedance[0] == pytest.approx(20.0 * unit)
    for frame in range(300):
        if frame == 100:
            world.set_impedance(1, 5.0)
            assert world.port_impedance[1] == pytest.approx(5.0 * unit)
        b, before, energy, work = world.port_impedance, world.tools, world.energy_j, world.port_work
        u = random.normal(size=(3, axes))
        v = world.step(u)
        w = (world.tools - before) / FRAME_S
        if axes == 6:
            turned = [between(exp(was[3:]), exp(now[3:])) for was, now in zip(before, world.tools, strict=True)]
            w[:, 3:] = np.array(turned) / FRAME_S
        port_j = 0.5 * FRAME_S * (u * u - v * v)
        assert port_j == pytest.approx(FRAME_S * (np.sqrt(2.0 * b) * u - b * w) * w, abs=least_j)
        assert world.force == pytest.approx(np.sqrt(2.0 * b) * u - b * w, abs=1e-12)
        assert world.port_work - work == pytest.approx(port_j.sum(axis=1), abs=1e-14)
        lost_j = FRAME_S * Tumbling.friction_nms * float((w[:, 3:] ** 2).sum())
        assert world.energy_j - energy == pytest.approx(port_j.sum() - lost_j, abs=least_j)


def test_a_hand_that_is_turned_as_it_takes_hold_stays_turned_against_the_tool() -> None:
    """Tool and proxy turn by the same rotation about the world's axes, and letting go and taking hold turns nothing."""
    world = Tumbling(seats(1, 6))
    world.place = np.array([[0.01, 0.0, 0.0, 0.4, -0.3, 1.0]])
    hand = np.array([0.0, 0.02, 0.0, -0.5, 0.9, 0.2])
    world.join(0, hand)
    assert world.proxy(0) == pytest.approx(hand, abs=1e-14)
    before, random = world.tools[0], np.random.default_rng(2)
    for _ in range(100):
        world.step(random.normal(size=(1, 6)))
    turn = between(exp(before[3:]), exp(world.tools[0][3:]))
    assert np.linalg.norm(turn) > 0.1
    after = world.proxy(0)
    assert after[:3] - hand[:3] == pytest.approx(world.tools[0][:3] - before[:3], abs=1e-14)
    assert between(product(exp(turn), exp(hand[3:])), exp(after[3:])) == pytest.approx([0.0] * 3, abs=1e-12)


def test_a_steering_wheel_swings_as_the_midpoint_rule_has_it_and_holds_what_both_turn() -> None:
    """Free: phi = phi_0 cos(n theta), tan(theta / 2) = (T / 2) sqrt(K / I). Held: K phi = the sum of torques."""
    free = example("steering_wheel.py", "SteeringWheel", 2, mass_kg=0.1, axes=6)
    free.phi_rad = 0.3
    theta = 2.0 * atan(0.5 * FRAME_S * sqrt(0.1 / (0.1 * 0.06**2)))
    for frame in range(1, 500):
        free.step(np.zeros((2, 6)))
        assert free.phi_rad == pytest.approx(0.3 * cos(frame * theta), abs=1e-12)
    world = hold(example("steering_wheel.py", "SteeringWheel", 2, mass_kg=0.1, axes=6))
    torques_nm = np.array([[0.0] * 5 + [0.03], [0.0] * 5 + [-0.01]])
    for _ in range(1500):
        v = world.step(torques_nm / np.sqrt(2.0 * world.port_impedance))
    assert world.phi_rad == pytest.approx(0.02 / 0.1, rel=1e-9)
    assert world.force == pytest.approx(torques_nm, abs=1e-12)
    assert v == pytest.approx(-torques_nm / np.sqrt(2.0 * world.port_impedance), abs=1e-9), "as from a wall"


def test_a_tool_that_nobody_holds_is_driven_by_nothing() -> None:
    world = Springs(seats(2, 1))
    world.join(0, np.array([0.02]))
    v = world.step(np.array([[1.0], [1.0]]))
    assert v[1] == 0.0
    assert world.tools[1] == 0.0
    assert world.force[1] == 0.0
    assert world.proxy(0) == pytest.approx(world.tools[0] + 0.02)


def test_two_masses_swing_as_the_midpoint_rule_has_it_and_the_spring_holds_what_both_press() -> None:
    """Free of hands and friction: x = d cos(n theta), tan(theta / 2) = (T / 2) sqrt(2 K / m)."""
    free = example("two_masses.py", "TwoMasses", 2, mass_kg=0.3, axes=2)
    start = np.array([[0.01, 0.0], [-0.01, 0.0]])
    free.place, free.friction_nspm = start.copy(), 0.0
    theta = 2.0 * atan(0.5 * FRAME_S * sqrt(2.0 * 300.0 / 0.3))
    for frame in range(1, 500):
        free.step(np.zeros((2, 2)))
        assert free.tools == pytest.approx(start * cos(frame * theta), abs=1e-12)
    world = hold(example("two_masses.py", "TwoMasses", 2, damping_nspm=2.0))
    press_n = np.array([[3.0], [-3.0]])
    for _ in range(1500):
        world.step(press_n / np.sqrt(2.0 * world.impedance))
    assert world.tools[1] - world.tools[0] == pytest.approx(-3.0 / 300.0, rel=1e-9)
    assert world.force == pytest.approx(press_n, rel=1e-9)


@pytest.mark.parametrize(("direction", "field_nspm"), [(1.0, 15.0), (-1.0, 1.0)])
def test_a_steady_push_reaches_the_speed_that_the_field_allows(direction: float, field_nspm: float) -> None:
    """(b + B) w = sqrt(2b) u along the guide, and K x across it."""
    world = hold(example("viscous_field.py", "ViscousField", 1, axes=2, mass_kg=0.05))
    b = float(world.impedance[0, 0])
    for _ in range(400):
        world.step(np.array([[direction * 2.0, 1.0]]) / sqrt(2.0 * b))
    assert world.speed[0, 0] == pytest.approx(direction * 2.0 / (b + field_nspm), rel=1e-9)
    assert world.tools[0, 1] == pytest.approx(1.0 / 400.0, rel=1e-9)


def test_the_soft_line_is_as_soft_as_its_springs_in_a_row() -> None:
    world = hold(example("soft_line.py", "SoftLine", 2, axes=3, mass_kg=0.1))
    pull = 2.0 * np.array([[-1.0, 0.0, 0.5], [1.0, 0.0, -0.5]])
    for _ in range(3000):
        world.step(pull / np.sqrt(2.0 * world.impedance))
    assert world.tools[1] - world.tools[0] == pytest.approx(pull[1] * 8 / 2000.0, rel=1e-6, abs=1e-12)
    assert np.diff(world.place, axis=0) == pytest.approx(np.tile(pull[1] / 2000.0, (8, 1)), rel=1e-6, abs=1e-12)
    assert world.drawing.poses()[:, :3].mean(axis=0) == pytest.approx(world.place.mean(axis=0))
