"""When a position that stands still is an encoder that has stopped, and when it is a device that was silent."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.frozen_position import FROZEN_M, LAG_S, SLACK_COUNTS, FrozenPosition

RATE_HZ = 1000
COUNT_M = 1e-5
LEAST_M = FROZEN_M + SLACK_COUNTS * COUNT_M
LAG_TICKS = round(LAG_S * RATE_HZ)


def found_at(ticks: list[int], speed_mps: float) -> int | None:
    """Return the index of the first reading that is not believed, of readings at `ticks` that stand still."""
    frozen = FrozenPosition(COUNT_M, RATE_HZ)
    for index, tick in enumerate(ticks):
        if frozen.still((0.1, 0.0, 0.0), tick) and frozen.judge((speed_mps, 0.0, 0.0)):
            return index
    return None


@pytest.mark.parametrize("speed_mps", [0.1, 0.5, 2.0])
def test_it_is_found_once_the_velocity_has_gone_the_stated_way(speed_mps: float) -> None:
    index = found_at(list(range(1000)), speed_mps)
    assert index is not None
    way_m = LEAST_M + LAG_S * speed_mps
    assert way_m < index * speed_mps / RATE_HZ < 1.5 * way_m + speed_mps / RATE_HZ


def test_a_velocity_is_not_held_to_have_lasted_through_a_silence() -> None:
    """A service that hung for 0.2 s says first where the tip was: at 0.2 m/s that looks like a way of 40 mm."""
    before = list(range(20))
    after = list(range(220, 240))
    assert found_at(before + after, 0.2) is None
    assert found_at([*before, *after, *range(240, 400)], 0.2) is not None


@given(gaps=st.lists(st.integers(1, LAG_TICKS), min_size=500, max_size=500), speed_mps=st.floats(0.1, 2.0))
def test_it_is_found_whatever_is_lost_within_the_lag(gaps: list[int], speed_mps: float) -> None:
    ticks = [sum(gaps[:index]) for index in range(len(gaps))]
    assert found_at(ticks, speed_mps) is not None


@given(st.lists(st.integers(LAG_TICKS + 1, 10_000), min_size=2, max_size=50), st.floats(0.0, 50.0))
def test_readings_apart_by_more_than_the_lag_are_never_judged(gaps: list[int], speed_mps: float) -> None:
    ticks = [sum(gaps[:index]) for index in range(len(gaps))]
    assert found_at(ticks, speed_mps) is None
