"""The histogram against numpy's percentiles, within its stated bin error."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.machine.histogram import RELATIVE_ERROR, DurationHistogram

durations = st.one_of(
    st.integers(0, 40),
    st.integers(0, 10**6),
    st.integers(0, 10**12),
    st.integers(0, 60).map(lambda bits: 1 << bits),
    st.integers(1, 60).map(lambda bits: (1 << bits) - 1),
)


def filled(values: list[int]) -> DurationHistogram:
    histogram = DurationHistogram()
    for value in values:
        histogram.add(value)
    return histogram


@given(st.lists(durations, min_size=1, max_size=300), st.sampled_from([0, 1, 25, 50, 90, 99, 99.9, 100]))
def test_percentiles_are_numpys_and_maximum_and_mean_are_exact(values: list[int], q: float) -> None:
    histogram = filled(values)
    expected = int(np.percentile(np.array(values, dtype=np.int64), q, method="inverted_cdf"))
    assert abs(histogram.percentile(q) - expected) <= RELATIVE_ERROR * expected
    assert histogram.max_ns == max(values)
    assert histogram.percentile(100) == float(max(values))
    assert histogram.total_ns == sum(values)


@given(st.lists(durations, min_size=1), st.lists(durations))
def test_merged_is_filled_with_both(left: list[int], right: list[int]) -> None:
    merged = filled(left)
    merged.merge(filled(right))
    both = filled(left + right)
    assert merged.bins() == both.bins()
    assert (merged.count, merged.max_ns, merged.total_ns) == (both.count, both.max_ns, both.total_ns)


@given(st.lists(durations, min_size=1))
def test_bins_tile_the_values(values: list[int]) -> None:
    bins = filled(values).bins()
    assert sum(each.counted for each in bins) == len(values)
    assert all(one.high_ns <= other.low_ns for one, other in pairwise(bins))
    for each in bins:
        assert sum(each.low_ns <= value < each.high_ns for value in values) == each.counted
        assert each.high_ns - each.low_ns <= max(1, 2 * RELATIVE_ERROR * each.low_ns)


def test_empty_says_nan_not_zero_and_values_outside_the_range_are_kept_at_its_ends() -> None:
    histogram = DurationHistogram()
    assert all(math.isnan(value) for value in histogram.summary_us().values())
    for value in (-5, (1 << 63) - 1):
        histogram.add(value)
    assert (histogram.count, histogram.percentile(50), histogram.max_ns) == (2, 0, (1 << 62) - 1)
    histogram.clear()
    assert histogram.count == 0
    assert histogram.bins() == []


def test_summary_names_and_units() -> None:
    assert filled([2000] * 998 + [20_000, 30_000]).summary_us() == pytest.approx(
        {"p50": 2.0, "p99": 2.0, "p999": 20.0, "max": 30.0}, rel=RELATIVE_ERROR
    )


@pytest.mark.parametrize("q", [-0.1, 100.1, math.nan])
def test_a_percentile_outside_0_to_100_is_refused(q: float) -> None:
    with pytest.raises(ValueError, match="0 to 100"):
        DurationHistogram().percentile(q)
