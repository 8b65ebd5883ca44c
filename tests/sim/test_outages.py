"""Tests of outages: both sides of each border, and equality of the cheap check with a check every time."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.sim.session.outages import NEVER_NS, Outages

S = 1_000_000_000

scripts = st.lists(st.tuples(st.floats(0, 50), st.floats(0.001, 10)), max_size=6)
periodic = st.sampled_from([(0.0, 0.0), (0.5, 3.0), (2.9, 3.0), (1e-9, 1.0)])


def test_the_first_periodic_outage_comes_after_one_period_and_lasts_its_length() -> None:
    outages = Outages(0.5, 3.0)
    for k in (1, 2, 1000):
        begin = 3 * k * S
        assert [outages.down_at(begin + each) for each in (-1, 0, S // 2 - 1, S // 2)] == [False, True, True, False]
    assert not any(outages.down_at(each) for each in (-S, 0, 1, S // 2))


def test_scripted_outages_join_where_they_touch_and_need_no_order() -> None:
    outages = Outages(script=[(2.0, 1.0), (1.0, 1.0), (1.5, 0.2)])
    assert [outages.down_at(each) for each in (S - 1, S, 2 * S - 1, 2 * S, 3 * S - 1, 3 * S)] == [
        False, True, True, True, True, False,
    ]  # fmt: skip
    assert outages.next_begin_ns(0) == S
    assert outages.next_begin_ns(S) == NEVER_NS, "they are one"


@given(periodic, scripts, st.integers(0, 70 * S))
def test_nothing_begins_before_the_next_begin(every: tuple[float, float], script: list, at_ns: int) -> None:
    outages = Outages(*every, script)
    begin_ns = outages.next_begin_ns(at_ns)
    assert begin_ns > at_ns
    if begin_ns == NEVER_NS:
        assert not every[0]
        assert not any(outages.down_at(each) for each in (200 * S, 201 * S))
        return
    assert outages.down_at(begin_ns)
    if not outages.down_at(at_ns):
        for part in range(1, 20):
            between_ns = at_ns + (begin_ns - at_ns) * part // 20
            assert between_ns == begin_ns or not outages.down_at(between_ns)


@pytest.mark.parametrize(
    ("arguments", "any_there"), [((), False), ((0.5, 3.0), True), ((0.0, 0.0, [(1.0, 2.0)]), True)]
)
def test_whether_there_are_any(arguments: tuple, any_there: bool) -> None:
    assert bool(Outages(*arguments)) is any_there


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0.5,), "outage_s = 0.5 must be above 0 and below outage_every_s = 0.0"),
        ((3.0, 3.0), "outage_s = 3.0 must be above 0 and below outage_every_s = 3.0"),
        ((0.0, 3.0), "outage_s = 0.0 must be above 0"),
        ((-1.0, 3.0), "outage_s = -1.0 is outside 0 to 1e[+]09"),
        ((0.5, math.inf), "outage_every_s = inf is outside 0 to 1e[+]09"),
        ((0.0, 0.0, [(1.0, 0.0)]), "0.0 s at 1.0 s: each must be longer than 0"),
        ((0.0, 0.0, [(-1.0, 1.0)]), "begin at 0 or later"),
        ((0.0, 0.0, [(math.nan, 1.0)]), "begin at 0 or later"),
        ((0.0, 0.0, [(1e300, 1.0)]), "both at most 1e[+]09 s"),
        ((0.0, 0.0, [(1.0, 1e300)]), "both at most 1e[+]09 s"),
    ],
)
def test_an_impossible_outage_is_refused(arguments: tuple, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Outages(*arguments)
