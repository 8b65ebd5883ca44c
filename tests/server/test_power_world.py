"""The world of time-domain passivity control: equations put back, its balance, and its law, whatever is asked for."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.server.worlds.power import DRIFT_MPS, DRIFT_SHARE, GIVE_SHARE, Led, PowerWorld

from tests.kinds import objects_of
from tests.server.object_worlds import seats

T = 1 / 128


def world_of(users: int = 2, thing: str = "cube", axes: int = 1, damping: float = 0.0, **coupling: Any) -> PowerWorld:
    world = PowerWorld(seats(users, thing, axes, {"damping_nspm": damping}, kind="tdpa", **coupling))
    for number in range(users):
        world.join(number, np.zeros(axes))
    return world


RICH = 1e9  # J: nothing is held back


@given(
    st.floats(-50.0, 50.0), st.just(0.0) | st.floats(1e-3, 1e5), st.floats(-5.0, 5.0), st.floats(0.0, 100.0),
    st.floats(0.0, 1.0), st.booleans(), st.floats(-5.0, 5.0),
)  # fmt: skip
@example(9.005098284061052e-159, 1.0, 1.0, 0.0, 0.0, False, 0.0)  # whose square has lost its digits
def test_a_proxy_solves_its_equations_and_takes_no_more_than_it_may(
    rest: float, gain: float, asked: float, power: float, give: float, one_sided: bool, velocity: float
) -> None:
    if gain == 0.0:
        rest = 0.0  # neither spring nor damper
    led = Led(rest, gain, asked, power, give, 1.0, one_sided)
    force, proxy, slope = led.answer(velocity)
    scale = 1.0 + abs(rest) + gain * (abs(asked) + abs(velocity))
    if not one_sided or force > 0.0:
        assert force == pytest.approx(rest + gain * (proxy - velocity), abs=1e-12 * scale)
    assert force * proxy <= power + 1e-12 * scale * (1.0 + abs(proxy))
    assert -gain <= slope <= 0.0
    free = (rest - gain * velocity + gain * asked) / (1.0 + gain * give)
    if free * asked <= power or (one_sided and free <= 0.0):  # what was asked for, less what it yields
        assert proxy == pytest.approx(asked - give * force if not one_sided or free > 0.0 else asked, abs=1e-12 * scale)
    else:  # the most that its energy lets through: w = g - (beta + c) F with beta >= 0
        assert force * (proxy + give * force) == pytest.approx(power, abs=1e-9 * scale * (1.0 + abs(proxy)))
        assert 0.0 <= force * math.copysign(1.0, free) <= abs(free) * (1.0 + 1e-12)


@given(
    st.floats(-50.0, 50.0), st.floats(1e-3, 1e5), st.floats(-5.0, 5.0), st.floats(0.0, 100.0), st.floats(0.0, 1.0),
    st.booleans(), st.floats(-5.0, 5.0), st.floats(0.0, 1.0),
)  # fmt: skip
def test_its_force_falls_as_the_object_gives_way(
    rest: float, gain: float, asked: float, power: float, give: float, one_sided: bool, velocity: float, more: float
) -> None:
    led = Led(rest, gain, asked, power, give, 1.0, one_sided)
    scale = 1.0 + abs(rest) + gain * (abs(asked) + abs(velocity) + more)
    assert led.answer(velocity + more)[0] <= led.answer(velocity)[0] + 1e-12 * scale


rows = st.tuples(
    st.floats(-0.1, 0.1),
    st.floats(-2.0, 2.0),
    st.floats(-1e-3, 0.05) | st.just(RICH) | st.just(0.0),
    st.floats(0.0, 1.0),
)


@st.composite
def steps(draw: st.DrawFn) -> tuple[PowerWorld, list[list[tuple[float, ...]]]]:
    thing, axes = draw(st.sampled_from(objects_of("tdpa"))), draw(st.integers(1, 3))
    users = 1 if kind_of(thing).fixed else draw(st.integers(1, 5))
    stiffness, damper = draw(st.floats(0.0, 1e6)), draw(st.floats(0.0, 100.0))
    world = world_of(
        users, thing, axes, draw(st.sampled_from([0.0, 3.0])), stiffness_npm=stiffness, damping_nspm=damper
    )
    world.external_force = np.array([draw(st.floats(-2.0, 2.0)) for _ in range(axes)])
    moves = []
    for _ in range(draw(st.integers(1, 12))):
        each = [[draw(rows) for _ in range(axes)] for _ in range(users)]
        moves.append([tuple(row[at] for at in range(4) for row in person) for person in each])
    return world, moves


@given(steps())
def test_what_comes_out_is_paid_for_and_every_step_keeps_its_balance(
    given_: tuple[PowerWorld, list[list[tuple[float, ...]]]],
) -> None:
    world, moves = given_
    axes, turned = world.axes, 1.0
    for move in moves:
        place, speed = world.position.copy(), world.velocity.copy()
        answers = world.advance(move)
        for row, answer in zip(move, answers, strict=True):
            for axis in range(axes):
                force, proxy = answer[axis], answer[axes + axis]
                paid = max(0.0, row[2 * axes + axis])
                turned += abs(force * proxy) * T + abs(force) * (abs(proxy) + abs(row[axes + axis])) * T
                assert force * proxy * T <= paid + 1e-13 * turned
        # momentum, with the velocity that the object moved by
        moved = (world.position - place) / T
        inertia = world.mass_kg / T * (1.0 if world.one_sided else 2.0)
        if not world.fixed:
            supplied = np.array(world.force).sum(axis=0) + world.external_force
            wanted = (inertia + world.object_damping) * moved - inertia * speed
            size = (
                np.abs(np.array(world.force)).sum()
                + inertia * (np.abs(moved) + np.abs(speed))
                + np.abs(place).max() / T
            )
            assert np.all(np.abs(wanted - supplied) <= 1e-8 * (1.0 + size))
        else:
            assert not world.position.any()
            assert not world.velocity.any()
        turned += world.mass_kg * float((world.velocity**2).sum()) + float((speed**2).sum())
        turned += float((world.stiffness * (np.abs(world.hand - world.position) + 1.0) ** 2).sum())
    assert world.balance_error_j <= 1e-9 * turned


def test_a_proxy_without_energy_stands_still_or_gives_way() -> None:
    """Also where the hand runs off: no force grows that was not paid for."""
    world = world_of(1, thing="wall", stiffness_npm=1000.0)
    answers = world.advance([(0.1, 1.0, 0.0, 1.0)])
    assert answers[0][0] * answers[0][1] == 0.0
    world.advance([(0.1, 1.0, 0.05, 1.0)])
    force, before = world.force[0, 0], world.hand[0, 0]
    assert force > 1.0
    world.advance([(0.1, 1.0, 0.0, 1.0)])
    assert world.hand[0, 0] == pytest.approx(before, abs=1e-12)
    world.advance([(0.1, 1.0, 0.0, 0.0)])  # and its client has nothing to take
    assert world.hand[0, 0] == pytest.approx(before - T * GIVE_SHARE / 20.0 * world.force[0, 0], abs=1e-9)


@pytest.mark.parametrize(("away_m", "most"), [(4e-3, DRIFT_SHARE * 4e-3), (0.05, DRIFT_MPS * T)])
def test_drift_is_made_good_at_its_pace_where_there_is_energy(away_m: float, most: float) -> None:
    world = world_of(1, thing="wall", stiffness_npm=100.0)
    world.advance([(-away_m, 0.0, RICH, 1.0)])  # away from the wall: nothing holds it
    assert world.hand[0, 0] == pytest.approx(-most, abs=1e-15)
    for _ in range(400):
        world.advance([(-away_m, 0.0, RICH, 1.0)])
    assert world.hand[0, 0] == pytest.approx(-away_m, abs=1e-9)


def test_a_person_who_is_not_there_moves_nothing() -> None:
    world = world_of(2)
    world.leave(1)
    world.advance([(0.01, 1.28, RICH, 1.0), (5.0, 5.0, RICH, 0.0)])
    assert world.force[1, 0] == 0.0
    assert world.hand[1, 0] == 0.0
    assert world.force[0, 0] != 0.0
