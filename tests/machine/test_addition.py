"""Sums from the first to the last: what Python 3.11's `sum` gave, on every Python."""

from functools import reduce
from math import copysign, inf, isnan
from operator import add

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.machine.addition import add_floats, add_integers


@given(st.lists(st.floats()))
def test_each_addition_is_rounded_once_and_from_the_first_to_the_last(values):
    total = add_floats(values)
    expected = reduce(add, values, 0.0)
    assert (isnan(total) and isnan(expected)) or (total, copysign(1.0, total)) == (expected, copysign(1.0, expected))
    assert isinstance(total, float)


def test_nothing_is_compensated():
    assert add_floats([0.1] * 10) == 0.9999999999999999  # 1.0 is the sum of Python 3.12 and later
    assert add_floats([1.0, 1e100, 1.0, -1e100]) == 0.0
    assert add_floats(each for each in (1e308, 1e308, -1e308)) == inf


def test_of_nothing():
    assert (add_floats([]), add_integers([])) == (0.0, 0)


def test_whole_numbers_and_flags_stay_exact():
    assert add_integers([2**53, 1]) == 2**53 + 1
    assert add_integers(each > 1 for each in (1, 2, 3)) == 2


@pytest.mark.parametrize("values", [[None], ["1"], 3.0])
def test_what_is_no_float_is_refused(values):
    with pytest.raises(TypeError):
        add_floats(values)
