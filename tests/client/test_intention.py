"""The intention of a hand: at rest it is where the hand would be without the force, for any stiffness that is told."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.coupling.partner.intention import HAND_NPM, RATE_S, Intention

TICK_S = 1.0 / 1024.0


def test_at_rest_it_is_the_place_and_the_force_over_the_stiffness() -> None:
    own = Intention(2, TICK_S, 0.1)
    own.begin((0.0, 0.0))
    for _ in range(1024):
        own.update((0.01, -0.02), (0.0, 0.0), (3.0, -1.5))
    assert own.place_m == pytest.approx([0.01 + 3.0 / HAND_NPM, -0.02 - 1.5 / HAND_NPM], abs=1e-9)
    assert own.rate_mps == pytest.approx([0.0, 0.0], abs=1e-6)


def test_it_moves_as_the_hand_does() -> None:
    own = Intention(1, TICK_S, 0.1)
    own.begin((0.0,))
    for tick in range(1024):
        own.update((0.1 * tick * TICK_S,), (0.1,), (0.0,))
    assert own.rate_mps[0] == pytest.approx(0.1, rel=1e-3)


def rates(own: Intention, places: list[float], stiffness_npm: float) -> list[float]:
    """Return what is told of a hand that a spring holds, whose place comes in steps."""
    own.begin((0.0,))
    told = []
    for place in places:
        own.update((place,), (0.0,), (stiffness_npm * place,))
        told.append(own.rate_mps[0])
    return told


@pytest.mark.parametrize("spring_npm", [0.0, 1000.0, 5000.0])
def test_nothing_is_told_of_a_rate_that_one_step_of_the_encoder_explains(spring_npm: float) -> None:
    step_m = 3e-5
    course = [0.0] * 10 + [step_m] * 40 + [0.0] * 400
    assert any(rates(Intention(1, TICK_S, 0.1), course, spring_npm))
    assert not any(rates(Intention(1, TICK_S, 0.1, step_m, spring_npm), course, spring_npm))


@given(st.floats(0.0, 1e-4), st.floats(0.0, 5000.0), st.floats(-1.0, 1.0))
def test_what_is_told_is_nearer_to_0_by_no_more_than_what_a_step_explains(
    step_m: float, spring_npm: float, speed_mps: float
) -> None:
    course = [speed_mps * tick * TICK_S for tick in range(300)]
    exact = rates(Intention(1, TICK_S, 0.1), course, 0.0)[-1]
    told = rates(Intention(1, TICK_S, 0.1, step_m, spring_npm), course, 0.0)[-1]
    assert exact * told >= 0.0
    assert 0.0 <= abs(exact) - abs(told) <= step_m * (1.0 + spring_npm / HAND_NPM) / RATE_S + 1e-12
