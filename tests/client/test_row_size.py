"""Sizes without a root say "below" only where `hypot` and `dist` say so, and nearly always where they do."""

from math import dist, hypot, inf, nan, nextafter

from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.rows.row_size import change_surely_below, surely_below

NUMBERS = st.floats(width=64)
ROWS = st.integers(1, 6).flatmap(lambda axes: st.tuples(*[st.tuples(*[NUMBERS] * axes)] * 2))


@given(ROWS, st.floats(0.0))
def test_what_is_surely_below_is_below(rows: tuple[tuple[float, ...], tuple[float, ...]], most: float) -> None:
    row, before = rows
    for bound in (most, hypot(*row), dist(row, before)):
        assert not surely_below(row, bound) or hypot(*row) < bound
        assert not change_surely_below(row, before, bound) or dist(row, before) < bound


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=6))
def test_it_is_sure_unless_it_is_close(row: list[float]) -> None:
    size = hypot(*row)
    assert surely_below(row, 1.001 * size + 1e-9)
    assert change_surely_below(row, [0.0] * len(row), 1.001 * size + 1e-9)
    assert not surely_below(row, nextafter(size, inf)), "a bit above is no answer of squares"


def test_nothing_that_is_not_finite_is_below() -> None:
    assert not any(surely_below((each, 0.0), inf) for each in (nan, inf, -inf))
    assert surely_below((0.0,), 1e-9)
    assert not surely_below((0.0,), 0.0)
