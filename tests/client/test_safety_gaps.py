"""The force does not jump where waves are missing: it follows its law with a bounded slope, and then is the law again."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.force_limits import SOFT_S, SOFT_SLOPE_NPS
from cogrip.client.safety import FAULT_OUT_S, RAMP_OUT_S, Safety

from tests.client.test_safety import PEAK_N, TICK_S, capability, full, size

SOFT_N = SOFT_SLOPE_NPS * TICK_S
Force = tuple[float, float, float]
FORCES = st.tuples(*[st.floats(-4.0, 4.0)] * 3)


def settled(force: Force) -> Safety:
    """Live, and giving this force."""
    safety = full()
    for _ in range(50):
        safety.limit(force, gap=False)
    assert safety.limit(force) == force
    safety.counts.clear()
    return safety


def apart(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    return math.dist(one, other)


def test_without_a_gap_the_law_jumps_as_far_as_its_slope_lets_it() -> None:
    safety = settled((0.5, 0.0, 0.0))
    assert safety.limit((-0.4, 0.1, 0.0)) == (-0.4, 0.1, 0.0)
    assert safety.counts == {}


def test_in_a_gap_the_force_goes_over_in_steps_along_the_straight_line() -> None:
    safety = settled((3.0, 4.0, 0.0))
    out, before = (3.0, 4.0, 0.0), 5.0
    for tick in range(1, 40):
        last, out = out, safety.limit((0.0, 0.0, 0.0), gap=True)  # type: ignore[assignment]
        expected = max(0.0, before - tick * SOFT_N)
        assert size(out) == pytest.approx(expected, abs=1e-12)
        assert apart(last, out) <= SOFT_N * (1.0 + 1e-12)
        assert out[0] * 4.0 == pytest.approx(out[1] * 3.0, abs=1e-12), "its direction is kept"
    assert safety.counts == {"gap softened": math.ceil(5.0 / SOFT_N) - 1}


def test_after_a_gap_it_is_soft_until_the_law_is_met_and_free_from_then_on() -> None:
    safety = settled((2.0, 0.0, 0.0))
    assert safety.limit((0.0, 0.0, 0.0), gap=True)[0] == pytest.approx(2.0 - SOFT_N)
    assert safety.limit((1.9, 0.0, 0.0))[0] == 1.9, "less than a step away, so it is met"
    assert safety.limit((1.0, 0.0, 0.0)) == (1.0, 0.0, 0.0), "a jump of the law itself"


@pytest.mark.parametrize(("ticks", "jumps"), [(round(SOFT_S / TICK_S), False), (round(SOFT_S / TICK_S) + 1, True)])
def test_for_fifty_milliseconds_at_most(ticks: int, jumps: bool) -> None:
    """A law that runs away from the force is not followed at a distance for ever."""
    safety, law = settled((0.0, 0.0, 0.0)), 0.0
    safety.limit((0.0, 0.0, 0.0), gap=True)
    out: tuple[float, ...] = (0.0,)
    before: tuple[float, ...] = (0.0,)
    for tick in range(ticks):
        law = 0.45 if tick % 2 else -0.45  # 0.9 N apart: more than a soft step, less than the slope
        before, out = out, safety.limit((law, 0.0, 0.0))
    assert (abs(out[0] - before[0]) > SOFT_N * (1.0 + 1e-9)) is jumps
    assert (out[0] == law) is jumps


@given(st.lists(st.tuples(FORCES, st.booleans()), min_size=1, max_size=80))
def test_no_step_in_a_gap_is_larger_whatever_the_law_says(steps: list[tuple[Force, bool]]) -> None:
    safety = settled((1.0, -1.0, 0.0))
    last: tuple[float, ...] = (1.0, -1.0, 0.0)
    for law, gap in steps:
        out = safety.limit(law, gap)
        if gap:
            assert apart(last, out) <= SOFT_N * (1.0 + 1e-9)
        assert size(out) <= PEAK_N * (1.0 + 1e-9)
        last = out


@given(st.lists(FORCES, min_size=1, max_size=60))
def test_a_clean_link_has_the_very_same_forces(laws: list[Force]) -> None:
    """Bit for bit, also with a device whose own slope is limited."""
    for slew in (1e6, 200.0):
        safety, plain = (Safety(replace(capability(), slew_nps=slew), TICK_S) for _ in range(2))
        for each in (safety, plain):
            for event in ("open", "calibrated", "go"):
                each.event(event)
        assert [safety.limit(law, False) for law in laws] == [plain.limit(law) for law in laws]
        assert "gap softened" not in safety.counts


def test_a_silent_link_takes_the_force_to_zero_as_fast_as_ever() -> None:
    safety = settled((4.0, 0.0, 0.0))
    for _ in range(100):
        safety.limit((0.0, 0.0, 0.0), gap=True)
    safety.event("stale", "no datagram")
    for _ in range(round(RAMP_OUT_S / TICK_S)):
        out = safety.limit((0.0, 0.0, 0.0), gap=True)
    assert out == (0.0, 0.0, 0.0)
    assert safety.quiet


@given(FORCES)
def test_a_fault_in_a_gap_lets_go_within_its_time(force: Force) -> None:
    safety = settled(force)
    safety.limit((0.0, 0.0, 0.0), gap=True)
    safety.fail("unplugged")
    for _ in range(math.ceil(FAULT_OUT_S / TICK_S) + 1):
        out = safety.limit(None, gap=True)
    assert out == (0.0, 0.0, 0.0)
    assert safety.quiet


def test_what_is_not_finite_in_a_gap_is_a_fault() -> None:
    safety = settled((4.0, 0.0, 0.0))
    out = safety.limit((math.nan, 0.0, 0.0), gap=True)
    assert safety.state == "fault"
    assert all(map(math.isfinite, out))
