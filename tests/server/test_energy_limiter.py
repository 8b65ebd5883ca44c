"""The energy limiter: no wave leaves in debt, no inputs take more than the reserve, a passive world is left alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.server.worlds.energy_limiter import MOST_J, START_J, EnergyLimiter

T = 1 / 128
squares = st.floats(0.0, 1e3)
frames = st.lists(st.tuples(squares, squares, st.floats(-5.0, 5.0)), min_size=1, max_size=60)


@given(frames)
def test_a_wave_leaves_only_without_debt_and_no_more_comes_out_than_was_held(course) -> None:
    limiter = EnergyLimiter(T)
    came_j = stored_j = lost_j = 0.0
    limited = 0
    size = START_J
    for squares_in, squares_back, change_j in course:
        factor = limiter.limit(squares_in, squares_back, change_j)
        assert 0.0 <= factor <= 1.0
        left = squares_back * factor * factor
        lost_j += 0.5 * T * (squares_back - left)
        limited += factor < 1.0
        came_j += 0.5 * T * (squares_in - left)
        stored_j += change_j
        size += 0.5 * T * (squares_in + squares_back) + abs(change_j)
        assert limiter.level_j <= MOST_J
        assert limiter.level_j <= START_J + came_j - stored_j + 1e-14 * size
        assert limiter.limited == limited
        assert limiter.paid_j == pytest.approx(lost_j, rel=1e-9, abs=1e-14 * size)
        if left:
            assert limiter.level_j >= 0.0
            assert came_j >= stored_j - START_J - 1e-14 * size


def test_debt_that_waves_cannot_pay_silences_them_until_it_is_paid() -> None:
    limiter = EnergyLimiter(T)
    assert limiter.limit(0.0, 1.0, 1.0) == 0.0  # the world has gained 1 J from nowhere
    assert limiter.level_j < -0.9
    assert limiter.limit(100.0, 50.0, 0.0) == 0.0
    for _ in range(10):
        limiter.limit(100.0, 0.0, 0.0)
    assert limiter.level_j == MOST_J
    assert limiter.limit(1.0, 1.0, 0.0) == 1.0


def test_a_passive_frame_is_left_alone() -> None:
    limiter = EnergyLimiter(T)
    for _ in range(100):
        assert limiter.limit(1.0, 0.5, 0.25 * T) == 1.0
    assert (limiter.level_j, limiter.paid_j, limiter.limited) == (pytest.approx(START_J), 0.0, 0)
