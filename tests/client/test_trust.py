"""Trust in a partner's model: the factor on its force that would have left the least error, from 0 to 1."""

from math import inf, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.coupling.partner.trust import KEPT_S, LEAST, MEAN_S, ROUGH_M, Trust

FRAME_S = 1.0 / 128.0
LOOP = 26  # frames


def trusted(own: list[float], taken: list[float], true: list[float], age_s: float | None = None) -> Trust:
    """Return the trust of a hand that learns what its partner intended a loop later."""
    trust = Trust(FRAME_S)
    for frame, (e, there) in enumerate(zip(own, taken, strict=True)):
        trust.enter((e,), (there,))
        if frame >= LOOP:
            trust.learn((true[frame - LOOP],), LOOP * FRAME_S if age_s is None else age_s)
    return trust


WAVE = [0.02 * sin(0.05 * frame) for frame in range(1500)]
STILL = [0.0] * 1500


def test_a_partner_who_was_foretold_is_trusted() -> None:
    assert trusted(WAVE, STILL, STILL).share == pytest.approx(1.0)


def test_a_partner_who_is_where_this_hand_is_and_was_taken_to_be_elsewhere_is_not() -> None:
    """d is what was felt, y = 0 what should have been: the rough part alone is left."""
    trust = Trust(FRAME_S)
    for _ in range(round(20.0 * MEAN_S / FRAME_S)):
        trust.enter((0.0,), (0.03,))
        trust.learn((0.0,), 0.0)
    assert trust.share == pytest.approx(ROUGH_M**2 / (ROUGH_M**2 + 0.03**2), rel=1e-3)


def test_half_of_a_force_that_should_be_felt_is_half_of_trust() -> None:
    assert trusted(WAVE, STILL, [0.5 * each for each in WAVE]).share == pytest.approx(0.5, abs=0.01)


@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=1, max_size=200), st.floats(0.0, 3.0))
def test_trust_is_a_part_whatever_is_told(rows: list[tuple[float, float, float]], age_s: float) -> None:
    trust = Trust(FRAME_S)
    for own, taken, told in rows:
        trust.enter((own,), (taken,))
        trust.learn((told,), age_s)
        assert 0.0 <= trust.share <= 1.0


def test_what_is_older_than_all_that_is_kept_teaches_nothing() -> None:
    assert trusted(WAVE, WAVE[::-1], STILL, KEPT_S + 0.1).share == 1.0
    assert trusted(WAVE, WAVE[::-1], STILL).share < 0.5


@given(st.floats(LEAST, 1.0), st.floats(10.0, 1000.0), st.floats(10.0, 1000.0), st.floats(100.0, 5000.0))
def test_hands_and_springs_in_series_give_that_part_of_their_force(
    share: float, told: float, own: float, spring: float
) -> None:
    trust = Trust(FRAME_S)
    trust.share = share
    softer = trust.stiffness_npm(told, own, spring)

    def series(stiffness: float) -> float:
        return 1.0 / (1.0 / own + 2.0 / spring + 1.0 / stiffness)

    assert series(softer) == pytest.approx(share * series(told))


@pytest.mark.parametrize(("share", "told", "softer"), [
    (1.0, 150.0, 150.0), (0.99 * LEAST, 150.0, 0.0), (0.5, 0.0, 0.0), (0.0, 150.0, 0.0),
])  # fmt: skip
def test_full_trust_changes_nothing_and_hardly_any_leaves_nothing(share: float, told: float, softer: float) -> None:
    trust = Trust(FRAME_S)
    trust.share = share
    assert trust.stiffness_npm(told, 300.0, 1000.0) == softer < inf
