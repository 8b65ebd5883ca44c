"""The force does not jump where waves are missing: it follows its law with a bounded slope, and then is the law again."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.safety.force_limits import SOFT_S, SOFT_SLOPE_NPS
from cogrip.client.safety.limiter import FAULT_OUT_S, RAMP_OUT_S, Safety

from tests.client.live_safety import PEAK_N, TICK_S, full, give, live

SOFT_N = SOFT_SLOPE_NPS * TICK_S
STILL = (0.0, 0.0, 0.0)
Force = tuple[float, float, float]
FORCES = st.tuples(*[st.floats(-4.0, 4.0)] * 3)


def settled(force: Force) -> Safety:
    """Live, and giving this force."""
    safety = full()
    assert give(safety, force, 51)[-1] == force
    safety.counts.clear()
    return safety


def test_in_a_gap_the_force_goes_over_in_steps_along_the_straight_line() -> None:
    safety = settled((3.0, 4.0, 0.0))
    for tick, out in enumerate(give(safety, STILL, 39, gap=True), 1):
        share = max(0.0, 5.0 - tick * SOFT_N) / 5.0
        assert out == pytest.approx((3.0 * share, 4.0 * share, 0.0), abs=1e-12)
    assert safety.counts == {"gap softened": math.ceil(5.0 / SOFT_N) - 1}


def test_after_a_gap_it_is_soft_until_the_law_is_met_and_free_from_then_on() -> None:
    safety = settled((2.0, 0.0, 0.0))
    assert safety.limit(STILL, gap=True)[0] == pytest.approx(2.0 - SOFT_N)
    assert safety.limit((1.9, 0.0, 0.0))[0] == 1.9, "less than a step away, so it is met"
    assert safety.limit((1.0, 0.0, 0.0)) == (1.0, 0.0, 0.0), "a jump of the law itself"


@pytest.mark.parametrize(("ticks", "jumps"), [(round(SOFT_S / TICK_S), False), (round(SOFT_S / TICK_S) + 1, True)])
def test_for_fifty_milliseconds_at_most(ticks: int, jumps: bool) -> None:
    """A law that runs away from the force is not followed at a distance for ever."""
    safety, law = settled(STILL), 0.0
    safety.limit(STILL, gap=True)
    before = out = 0.0
    for tick in range(ticks):
        law = 0.45 if tick % 2 else -0.45  # 0.9 N apart: more than a soft step, less than the slope
        before, out = out, safety.limit((law, 0.0, 0.0))[0]
    assert (abs(out - before) > SOFT_N * (1.0 + 1e-9)) is jumps
    assert (out == law) is jumps


@given(st.lists(st.tuples(FORCES, st.booleans()), min_size=1, max_size=80))
def test_no_step_in_a_gap_is_larger_whatever_the_law_says(steps: list[tuple[Force, bool]]) -> None:
    last: tuple[float, ...] = (1.0, -1.0, 0.0)
    safety = settled((1.0, -1.0, 0.0))
    for law, gap in steps:
        out = safety.limit(law, gap)
        assert not gap or math.dist(last, out) <= SOFT_N * (1.0 + 1e-9)
        assert math.hypot(*out) <= PEAK_N * (1.0 + 1e-9)
        last = out


@given(st.lists(FORCES, min_size=1, max_size=60))
def test_a_clean_link_has_the_very_same_forces(laws: list[Force]) -> None:
    """Bit for bit, also with a device whose own slope is limited."""
    for slew_nps in (1e6, 200.0):
        safety, plain = live(slew_nps=slew_nps), live(slew_nps=slew_nps)
        assert [safety.limit(law, False) for law in laws] == [plain.limit(law) for law in laws]
        assert "gap softened" not in safety.counts


def test_a_silent_link_takes_the_force_to_zero_as_fast_as_ever() -> None:
    safety = settled((4.0, 0.0, 0.0))
    safety.limit(STILL, gap=True)
    safety.event("stale", "no datagram")
    assert give(safety, STILL, round(RAMP_OUT_S / TICK_S), gap=True)[-1] == STILL
    assert safety.quiet


@given(FORCES)
def test_a_fault_in_a_gap_lets_go_within_its_time(force: Force) -> None:
    safety = settled(force)
    safety.limit(STILL, gap=True)
    safety.fail("unplugged")
    assert give(safety, None, math.ceil(FAULT_OUT_S / TICK_S) + 1, gap=True)[-1] == STILL
    assert safety.quiet
