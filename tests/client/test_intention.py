"""The intention of a hand: at rest it is where the hand would be without the force, for any stiffness that is told."""

import pytest

from cogrip.client.coupling.partner.intention import HAND_NPM, Intention

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
