"""Nothing the law says reaches a hand unlimited: the states, the limits, the ramps, the faults."""

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.safety.limiter import (
    AT_LIMIT_S,
    FAULT_OUT_S,
    IGNORED,
    RAMP_IN_S,
    RAMP_OUT_S,
    STALL_DECAY,
    STALL_S,
    STATES,
    TRANSITIONS,
    WATCHDOG_S,
    Safety,
)
from cogrip.devices.device import MOST_SLOPE_NPS

from tests.client.live_safety import PEAK_N, RECORD, TICK_S, full, give, live

EVENTS = sorted({event for _, event in TRANSITIONS})
STILL = (0.0, 0.0, 0.0)
X = (1.0, 0.0, 0.0)
TWO_N = (2.0, 0.0, 0.0)
BEYOND = (20.0, 0.0, 0.0)


def sizes(forces: list[tuple[float, ...]]) -> list[float]:
    return [math.hypot(*force) for force in forces]


@pytest.fixture
def safety() -> Safety:
    return full()


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("event", EVENTS)
def test_only_the_table_changes_the_state(state: str, event: str) -> None:
    safety = Safety(RECORD, TICK_S)
    safety.state = state
    expected = TRANSITIONS.get((state, event))
    if expected is None and (state, event) not in IGNORED:
        with pytest.raises(ValueError, match=f"^'{event}' has no transition from '{state}'$"):
            safety.event(event)
    else:
        assert safety.event(event) is (expected is not None)
    assert safety.state == (expected or state)


def test_what_is_ignored_has_no_transition_and_lets_no_force_through() -> None:
    assert not IGNORED & set(TRANSITIONS)
    assert {event for state, event in IGNORED if state == "live"} == {"engage", "rearm"}
    assert not {event for _, event in IGNORED} & {"open", "calibrated", "go", "fresh"}


def test_the_table_says_what_the_prose_says() -> None:
    assert set(TRANSITIONS.values()) == set(STATES)
    assert [key for key, after in TRANSITIONS.items() if key[0] == "fault"] == [("fault", "rearm"), ("fault", "stop")]
    assert TRANSITIONS["fault", "rearm"] == "armed", "re-arming alone moves nobody"
    assert {state for (state, _), after in TRANSITIONS.items() if after == "live"} == {"armed", "clutched", "degraded"}
    for state in ("calibrating", "armed", "live", "clutched", "degraded"):
        assert TRANSITIONS[state, "fail"] == "fault"
        assert TRANSITIONS[state, "stop"] == "idle"


def test_force_flows_in_live_alone() -> None:
    for state in STATES:
        safety = Safety(RECORD, TICK_S)
        safety.state = state
        assert any(give(safety, X, 10)[-1]) is (state == "live")


def test_the_clamp_keeps_the_direction(safety: Safety) -> None:
    out = give(safety, (30.0, -40.0, 120.0), round(PEAK_N / (MOST_SLOPE_NPS * TICK_S)) + 1)[-1]
    assert math.hypot(*out) == pytest.approx(PEAK_N, rel=1e-12)
    assert out == pytest.approx((30.0 * PEAK_N / 130.0, -40.0 * PEAK_N / 130.0, 120.0 * PEAK_N / 130.0))
    clipped = safety.counts["force clipped"]
    inside = (1.8, -2.4, 7.2)
    assert safety.limit(inside) == inside, "what is within bounds passes untouched"
    assert safety.counts["force clipped"] == clipped


def test_the_force_changes_no_faster_than_the_device_allows() -> None:
    safety = full(slew_nps=1000.0)
    out = give(safety, (3.0, 4.0, 0.0), 6)
    assert sizes(out) == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 5.0])
    assert out[1] == pytest.approx((1.2, 1.6, 0.0))
    assert safety.limit((-3.0, -4.0, 0.0)) == pytest.approx((2.4, 3.2, 0.0))
    assert safety.counts["slew limited"] == 5


def test_ramp_in_over_three_tenths_of_a_second() -> None:
    assert RAMP_IN_S == 0.3
    safety = live()
    out = [force[0] for force in give(safety, TWO_N, 310)]
    assert out[:300] == pytest.approx([2.0 * (tick + 1) / 300 for tick in range(300)])
    assert out[300:] == [2.0] * 10
    assert not safety.quiet


def test_ramp_out_when_the_link_goes_stale_and_in_again_when_it_is_fresh(safety: Safety) -> None:
    safety.limit(TWO_N)
    assert safety.event("stale", "no datagram from the server")
    out = give(safety, TWO_N, round(RAMP_OUT_S / TICK_S) + 2)
    assert (out[49][0], out[-1][0]) == (pytest.approx(1.0), 0.0)
    assert safety.quiet
    assert safety.reason == "no datagram from the server"
    assert safety.event("fresh")
    assert safety.reason == ""
    out = give(safety, TWO_N, 300)
    assert (out[149][0], out[299][0]) == (pytest.approx(1.0), pytest.approx(2.0))


def test_stop_lets_the_force_go_even_when_the_law_has_no_wish(safety: Safety) -> None:
    safety.limit(TWO_N)
    safety.event("stop")
    assert give(safety, None, round(RAMP_OUT_S / TICK_S) + 2)[49][0] == pytest.approx(1.0), "the last force fades"
    assert safety.quiet


def test_it_is_quiet_when_the_motors_are_and_not_before() -> None:
    """A device that may only slew slowly still pushes when the ramp is over."""
    safety = full(slew_nps=10.0)
    give(safety, TWO_N, 200)
    safety.event("stop")
    while not safety.quiet:
        assert any(safety.limit(None)) is not safety.quiet


def test_a_fault_takes_the_force_evenly_within_its_time(safety: Safety) -> None:
    safety.limit(TWO_N)
    safety.fail("test")
    ticks = round(FAULT_OUT_S / TICK_S)
    out = give(safety, None, ticks + 1)
    assert out[ticks // 3 - 1][0] == pytest.approx(2.0 * (1.0 - (ticks // 3) * TICK_S / FAULT_OUT_S))
    assert out[-1][0] == 0.0


def test_a_fault_is_latched_and_keeps_its_first_reason(safety: Safety) -> None:
    safety.fail("first")
    safety.fail("second")
    assert safety.reason == "first"
    assert safety.counts["fault"] == 1
    for _ in range(1000):
        assert safety.check(1, STILL, STILL), "good samples do not heal it"
        safety.limit(TWO_N)
    assert safety.state == "fault"
    assert safety.quiet
    assert safety.event("rearm")
    assert (safety.state, safety.reason) == ("armed", "")
    assert safety.limit(TWO_N)[0] == 0.0
    assert safety.event("go")
    out = give(safety, TWO_N, 300)
    assert (out[0][0], out[-1][0]) == (pytest.approx(2.0 / 300), pytest.approx(2.0)), "it ramps in like the first time"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_sample_that_is_not_finite_is_refused(bad: float, axis: int) -> None:
    spoiled = tuple(bad if at == axis else 0.01 for at in range(3))
    for position, velocity in ((spoiled, STILL), (STILL, spoiled), (spoiled, spoiled)):
        safety = full()
        assert not safety.check(1, position, velocity)
        assert safety.state == "fault"
        assert "not finite" in safety.reason
        assert safety.counts["non-finite sample"] == 1


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_force_that_is_not_finite_never_leaves(safety: Safety, bad: float, gap: bool) -> None:
    safety.limit(X)
    out = safety.limit((0.0, bad, 0.0), gap)
    assert out == X, "the last good one is held"
    assert safety.state == "fault"
    assert "force law" in safety.reason
    assert all(math.isfinite(value) for force in give(safety, (bad, bad, bad), 50, gap) for value in force)
    assert safety.quiet


def test_over_speed_on_both_sides_of_the_limit() -> None:
    safety = full(speed_mps=0.5)
    assert safety.check(1, STILL, (0.3, 0.4, 0.0))
    assert safety.state == "live"
    assert safety.check(1, STILL, (0.3, 0.4, 1e-6))
    assert safety.state == "fault"
    assert "0.50 m/s is above 0.5 m/s" in safety.reason


def test_a_device_that_gives_no_sample_has_stalled(safety: Safety) -> None:
    ticks = round(STALL_S / TICK_S)
    for good in (math.ceil(ticks / STALL_DECAY), 0):
        for _ in range(ticks - 1):
            safety.absent(1)
        for _ in range(good):
            safety.check(1, STILL, STILL)
        assert safety.state == "live", "enough samples in between are a new start"
    safety.absent(1)
    assert safety.state == "fault"
    assert "device stall" in safety.reason
    assert safety.counts["absent sample"] == 2 * ticks - 1


@pytest.mark.parametrize(("good", "state"), [(2, "live"), (1, "fault")])
def test_two_good_samples_for_each_that_is_absent_are_enough_for_ever(safety: Safety, good: int, state: str) -> None:
    for _ in range(200):
        for _ in range(good):
            safety.check(1, STILL, STILL)
        safety.absent(1)
    assert safety.state == state


def test_ticks_that_were_skipped_count_towards_a_stall(safety: Safety) -> None:
    safety.absent(round(STALL_S / TICK_S))
    assert safety.state == "fault"


def test_the_watchdog_on_both_sides(safety: Safety) -> None:
    ticks = round(WATCHDOG_S / TICK_S)
    assert safety.check(ticks - 1, STILL, STILL)
    assert safety.state == "live"
    assert safety.check(ticks, STILL, STILL)
    assert safety.state == "fault"
    assert f"away for {ticks} ticks" in safety.reason


def test_the_workspace_is_reported_and_is_no_fault(safety: Safety) -> None:
    safety.check(1, (0.1, -0.1, 0.1), STILL)
    assert safety.left == ""
    safety.check(1, (0.0, 0.1001, 0.0), STILL)
    assert "left the workspace" in safety.left
    assert (safety.unstable, safety.saturated) == ("", "")
    assert safety.state == "live"


def test_half_a_second_at_the_limit_is_saturation_and_a_fault(safety: Safety) -> None:
    """A force that is asked for beyond the peak is none that a person chose."""
    give(safety, BEYOND, round(AT_LIMIT_S / TICK_S))
    assert (safety.state, safety.saturated) == ("live", "")
    safety.limit(BEYOND)
    assert safety.state == "fault"
    assert "at its limit of 8 N for 0.5 s" in safety.saturated
    assert (safety.unstable, safety.left) == ("", "")
    assert "at its limit of 8 N for 0.5 s" in safety.reason


def test_a_force_that_comes_off_its_limit_is_not_saturated(safety: Safety) -> None:
    for _ in range(5):
        give(safety, BEYOND, round(AT_LIMIT_S / TICK_S))
        safety.limit((PEAK_N, 0.0, 0.0))
    assert safety.saturated == ""


def test_time_at_the_limit_does_not_count_while_the_force_is_ramped() -> None:
    safety = live()
    give(safety, BEYOND, round(RAMP_IN_S / TICK_S) - 1 + round(AT_LIMIT_S / TICK_S))
    assert safety.saturated == ""
    give(safety, BEYOND, 3)
    assert safety.saturated != ""


number = st.floats(allow_nan=True, allow_infinity=True)
vector = st.tuples(number, number, number)
wish = st.one_of(st.none(), vector, st.tuples(*[st.floats(-20.0, 20.0)] * 3))
act = st.one_of(
    st.tuples(st.just("event"), st.sampled_from(EVENTS)),
    st.tuples(st.just("check"), vector),
    st.tuples(st.just("absent"), st.integers(1, 30)),
    st.tuples(st.just("limit"), st.tuples(wish, st.just(1) | st.integers(1, 400))),
)


@given(st.lists(act, max_size=40), st.sampled_from([1e6, 500.0]))
def test_whatever_happens_the_force_is_finite_bounded_and_steady(acts: list[tuple[str, Any]], slew_nps: float) -> None:
    safety = live(slew_nps=slew_nps)
    last = STILL

    def limit(wish: Sequence[float] | None, ticks: int) -> None:
        nonlocal last
        for out in give(safety, wish, ticks):
            assert len(out) == 3
            assert all(map(math.isfinite, out))
            assert math.hypot(*out) <= PEAK_N * (1.0 + 1e-12)
            change = math.dist(out, last)
            assert change <= min(slew_nps, MOST_SLOPE_NPS) * TICK_S * (1.0 + 1e-9) + 1e-12
            last = out

    for kind, what in acts:
        before = safety.state
        match kind:
            case "event":
                if (before, what) in TRANSITIONS or (before, what) in IGNORED:
                    safety.event(what)
            case "check":
                safety.check(1, what, STILL)
            case "absent":
                safety.absent(what)
            case "limit":
                limit(*what)
        assert safety.state in STATES
        if before == "fault":
            assert safety.state == "fault" or (kind == "event" and what in {"rearm", "stop"})
    if safety.state != "live":
        limit((5.0, 5.0, 5.0), 200)
        assert last == STILL


@pytest.mark.parametrize(("ticks", "lets_go"), [(9, False), (10, True), (50, True)])
def test_a_device_that_applied_nothing_takes_its_force_back_by_the_ramp(ticks: int, lets_go: bool) -> None:
    """One that misses a tick now and then, or had no force to apply, has not let go."""
    safety = full(axes=3)
    give(safety, (3.0, 0.0, 0.0), 20)
    for _ in range(ticks):
        safety.limit((3.0, 0.0, 0.0))
        safety.applied((0.0, 0.0, 0.0))
    back = [force[0] for force in give(safety, (3.0, 0.0, 0.0), 400)]
    assert back[-1] == 3.0
    assert safety.counts["device let go"] == lets_go
    assert (back[20] < 0.3) == lets_go
    if lets_go:
        assert back[0] == pytest.approx(3.0 * TICK_S / RAMP_IN_S)


def test_a_force_that_is_told_late_every_other_tick_is_no_device_that_let_go() -> None:
    safety = full()
    for tick in range(200):
        safety.limit((3.0, 0.0, 0.0))
        if tick % 2:
            safety.applied((0.0, 0.0, 0.0))
    for _ in range(200):
        safety.limit((0.0, 0.0, 0.0))
        safety.applied((0.0, 0.0, 0.0))
    assert safety.gain == 1.0
