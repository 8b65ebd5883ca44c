"""Rooms of few people in plain floats: the same answers and the same energy as with arrays."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from cogrip.server.schemes import make_world
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.small_grip import MOST, SmallGripWorld

from tests.server.object_worlds import FOLLOWING, drawn_seats, seats


@pytest.mark.parametrize("follow", [False, True])
@given(st.integers(1, 6), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_few_people_are_stepped_as_many_are(follow: bool, count: int, axes: int, seed: int) -> None:
    """They come, hold, and go at random moments, while their stiffness grows, as well as after, and where it follows."""
    random = np.random.default_rng(seed)
    people = drawn_seats(random, count, axes, **(FOLLOWING if follow else {}))
    many, few = GripWorld(people), SmallGripWorld(people)

    def alike(one: ArrayLike, other: ArrayLike, least: float) -> None:
        """numpy's own assertion costs ten times more."""
        loose = 100.0 if follow else 1.0  # a spring that is paid for from a ledger keeps fewer digits
        assert (np.abs(np.subtract(one, other)) <= loose * (least + 1e-9 * np.abs(other))).all()

    def both(what: str, *given: object) -> None:
        for world in (many, few):
            getattr(world, what)(*given)

    for step in range(150):
        user = int(random.integers(count))
        if step % 25 == 0:
            both("join", user, random.uniform(-0.1, 0.1, axes))
        elif step % 40 == 39:
            both("leave", user)
        if step % 7 == 3:  # a person's client chooses another impedance
            both("set_impedance", user, 1.0 + step)
        if follow and step % 4 == 0:
            both("set_target_stiffness", user, people[user].rendered_npm * 10.0 ** random.uniform(-1.0, 1.0))
        many.external_force = few.external_force = random.uniform(-1.0, 1.0, axes)
        waves = random.uniform(-0.5, 0.5, (count, axes))
        rows = few.advance([tuple(row) for row in waves.tolist()])
        alike(rows, many.step(waves), 1e-11)
        for name in ("position", "velocity", "stretch", "damping", "port_work"):
            alike(getattr(few, name), getattr(many, name), 1e-10)
        alike(few.stiffness, many.stiffness, 0.0)
        alike(few.force, many.force, 1e-8)
        for number in range(count):
            alike(few.proxy(number), many.proxy(number), 1e-11)
            assert few.accounts.stiffness(number) == few.stiffness[number, 0]
    scale = 1.0 + float(np.abs(many.port_work).max())
    assert few.balance_error_j <= 1e-12 * scale + 10.0 * many.balance_error_j


def test_rooms_of_few_and_of_many() -> None:
    random = np.random.default_rng(1)
    assert isinstance(make_world(drawn_seats(random, MOST // 3, 3)), SmallGripWorld)
    assert isinstance(make_world(drawn_seats(random, MOST // 3 + 1, 3)), GripWorld)


def test_the_arrays_of_few_people_are_not_to_be_written_to() -> None:
    world = SmallGripWorld(seats(2, axes=3))
    for name in ("position", "velocity", "stretch", "stiffness", "damping", "force", "port_work"):
        assert not getattr(world, name).flags.writeable, name
    world.position = np.array([0.1, 0.2, 0.3])
    assert world.motion() == (0.1, 0.2, 0.3, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("kind", [GripWorld, SmallGripWorld])
def test_the_work_of_hours_is_within_two_roundings_of_the_true_one(kind: type[GripWorld]) -> None:
    """Small steps beside a large sum: a plain one is out by up to half its last digit each time."""
    world, start = kind(seats(2)), 1e7 / 3.0
    for user in range(2):
        world.join(user, np.zeros(1))
    world.port_work = np.array([start, -start])
    true, plain = [Fraction(start), Fraction(-start)], [start, -start]
    rows = [(0.4,), (0.3,)]
    for _ in range(2000):
        answers = world.advance(rows)
        for user, ((u,), (v,)) in enumerate(zip(rows, answers, strict=True)):
            work = (0.5 * world.frame_s) * (u * u - v * v)
            true[user] += Fraction(work)
            plain[user] += work
    for user, work in enumerate(world.port_work_j()):
        assert abs(Fraction(work) - true[user]) <= Fraction(2.0**-52) * Fraction(start) * 2
    out = max(abs(Fraction(sum_) - work) for sum_, work in zip(plain, true, strict=True))
    assert out > Fraction(2.0**-52) * Fraction(start) * 4, "else nothing is shown"
    world.start_ledger(1)
    assert list(world.port_work_j()) == [world.port_work[0], 0.0]
