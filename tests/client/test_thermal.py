"""Motors that warm give less: the defining equations of the I^2 t limit, from both sides of each bound."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.safety.limiter import DERATED_S, FAULT_OUT_S, RAMP_OUT_S, Safety
from cogrip.client.safety.thermal import CALM_SHARE, FADE_S, TIME_CONSTANT_S, WARN_SHARE, ThermalLimit
from cogrip.devices.device import MOST_SLOPE_NPS
from cogrip.devices.registry import make

from tests.client.live_safety import full, give

RECORD = make("sim:phantom").capability


PHANTOM = (8.5, 1.4)  # peak and continuous force [N]
T_C = 1.0 / 1024.0
DECAY = math.exp(-T_C / TIME_CONSTANT_S)


def live(tick_s: float = T_C) -> Safety:
    """A Phantom's, the ramp behind it."""
    return full(RECORD, tick_s)


@given(st.lists(st.floats(0.0, 20.0), min_size=1, max_size=60), st.integers(1, 2000))
def test_the_rise_is_the_weighted_mean_square_of_the_past(forces: list[float], ticks: int) -> None:
    """h_n = sum over ticks k of (1 - d) d^(n-k) (F_k / F_c)^2, d = exp(-T / tau)."""
    thermal = ThermalLimit(T_C, 20.0, 1.4)
    squares = np.repeat(np.square(forces), -(-ticks // len(forces)))
    for square in squares:
        thermal.enter(float(square))
    weights = (1.0 - DECAY) * DECAY ** np.arange(len(squares) - 1, -1, -1)
    assert thermal.rise == pytest.approx(float(weights @ squares) / 1.4**2, rel=1e-9, abs=1e-15)


@given(
    st.sampled_from([250, 1024, 8192]),
    st.floats(1.0, 60.0),
    st.lists(st.tuples(st.floats(0.0, 200.0), st.integers(1, 4000)), min_size=1, max_size=6),
)
def test_no_wish_warms_a_winding_beyond_its_continuous_force(
    rate_hz: int, peak_n: float, wishes: list[tuple[float, int]]
) -> None:
    """h <= 1 for ever, so over any time W the mean of F^2 is at most F_c^2 (1 + tau / W)."""
    thermal, spent, ticks = ThermalLimit(1.0 / rate_hz, peak_n, 1.0), 0.0, 0
    for wish, held in wishes:
        for _ in range(held):
            force = min(wish, thermal.limit_n)
            assert 1.0 - 1e-12 <= thermal.limit_n <= peak_n
            thermal.enter(force * force)
            spent += force * force
            ticks += 1
            assert thermal.rise <= 1.0 + 1e-12
    assert spent / ticks <= 1.0 + TIME_CONSTANT_S * rate_hz / ticks * (1.0 + 1e-3)


def test_the_law_keeps_its_margin_and_no_more() -> None:
    """1 - h shrinks with the time constant FADE_S where the limit acts on a force."""
    thermal = ThermalLimit(T_C, *PHANTOM)
    while thermal.limit_n == 8.5:
        thermal.enter(8.5**2)
    for _ in range(2000):
        margin = 1.0 - thermal.rise
        thermal.enter(thermal.limit_n**2)
        assert (1.0 - thermal.rise) / margin == pytest.approx(math.exp(-T_C / FADE_S), abs=1e-5)


@pytest.mark.parametrize(("share", "limited"), [(1.01, True), (0.999, False)])
def test_just_above_the_continuous_force_is_limited_and_just_below_is_not(share: float, limited: bool) -> None:
    thermal = ThermalLimit(1.0 / 250.0, *PHANTOM)
    for _ in range(250 * 600):
        thermal.enter(min(share * 1.4, thermal.limit_n) ** 2)
    assert (thermal.limit_n < share * 1.4) is limited


def test_a_cold_motor_gives_its_peak_for_a_second_and_a_bit_and_that_is_said_before() -> None:
    """h = r_p (1 - exp(-t / tau)) reaches 1 - (r_p - 1) / g at t = 1.15 s, r_p = (8.5 / 1.4)^2, g = tau / FADE_S - 1."""
    heating, slope = (8.5 / 1.4) ** 2, TIME_CONSTANT_S / FADE_S - 1.0
    seconds = -TIME_CONSTANT_S * math.log(1.0 - (1.0 - (heating - 1.0) / slope) / heating)
    assert seconds == pytest.approx(1.15, abs=0.01)
    safety, ticks, warned = live(), 0, 0
    while not safety.derated:
        safety.limit((8.5,))
        ticks += 1
        warned += bool(safety.warning)
    assert ticks * T_C == pytest.approx(seconds, abs=0.03), "less what the slope took at first"
    assert warned > 0.5 * 1024, "time enough to release it"
    assert "1.4 N" in safety.warning
    give(safety, (0.0,), 80 * 1024)
    assert safety.warning == ""
    assert safety.counts["near thermal limit"] == 1


def test_six_seconds_at_the_peak_end_at_the_continuous_force_without_a_step() -> None:
    """The measured case: 8.5 N held for 6 s on a record of 1.4 N."""
    safety = live()
    forces = np.array(give(safety, (8.5,), 6 * 1024))[:, 0]
    assert forces.max() == 8.5
    assert forces[-1] == pytest.approx(1.4, rel=0.01)
    falls = -np.diff(forces[20:])
    assert falls.max() <= 8.5 / (2.0 * FADE_S) * T_C * 1.01, "F_p / (2 FADE_S) at most"
    assert np.all(falls >= 0.0)
    assert safety.state == "live"


def test_the_warning_has_two_bounds() -> None:
    """Above WARN_SHARE of where the limit acts it begins, below CALM_SHARE of that it ends."""
    thermal = ThermalLimit(T_C, *PHANTOM)
    begins = WARN_SHARE * (1.0 - ((8.5 / 1.4) ** 2 - 1.0) / (TIME_CONSTANT_S / FADE_S - 1.0))
    for share, warm in ((0.999, False), (1.001, True), (0.91, True), (0.89, False)):
        thermal.rise = share * begins
        thermal.enter(thermal.rise * 1.4**2)
        assert thermal.warm is warm
    assert CALM_SHARE == 0.9


def test_ten_seconds_of_warm_motors_are_a_fault_and_pauses_count_against_them() -> None:
    safety = live()
    while not safety.derated:
        safety.limit((8.5,))
    give(safety, (8.5,), round(DERATED_S / T_C) - 1)
    assert safety.state == "live"
    give(safety, (1.0,), 1024)
    give(safety, (8.5,), 1024)
    assert safety.state == "live", "a second of less has made room for another one"
    give(safety, (8.5,), 2)
    assert safety.state == "fault"
    assert "1.4 N for 10 s" in safety.reason
    assert "re-arm" in safety.reason
    rise = safety.thermal.rise
    safety.event("rearm")
    safety.event("go")
    assert safety.thermal.rise == rise, "re-arming cools nothing"


def test_a_person_who_pulls_now_and_then_goes_on_without_a_fault() -> None:
    """A third of the time above what the motors bear: they get less, and stay."""
    safety = live(1.0 / 250.0)
    for _ in range(100):
        give(safety, (4.0,), 250)
        give(safety, (0.5,), 500)
    assert safety.state == "live"
    assert safety.counts["thermally limited"] > 1000


def test_ticks_that_were_skipped_warm_the_motors_too() -> None:
    rises = []
    for step in (1, 4):
        safety = live()
        for _ in range(0, 1024, step):
            safety.check(step, (0.0,), (0.0,))
            safety.limit((8.0,))
        rises.append(safety.thermal.rise)
    assert rises[1] == pytest.approx(rises[0], rel=0.05)


def test_another_record_changes_the_limits_and_not_the_warmth() -> None:
    safety = live()
    give(safety, (8.5,), 2048)
    rise = safety.thermal.rise
    safety.set_record(replace(RECORD, continuous_force_n=0.7))
    assert safety.thermal.rise == rise
    assert safety.thermal.limit_n < 8.5


def test_each_tick_says_whether_a_limit_held_its_force() -> None:
    safety = full()
    for wish_n, ticks, limited in (
        (0.5, 1, False),
        (2.0, 1, True),
        (1.5, 1, False),
        (8.0, 20, False),
        (8.001, 1, True),
    ):
        give(safety, (wish_n, 0.0, 0.0), ticks)
        assert safety.limited is limited, f"{wish_n} N: the peak itself is no limit, a step too far is"
    assert not safety.derated


def test_the_force_that_acted_counts_for_heat_and_slope() -> None:
    """A device that gives less than it was told: the next step starts from there, and only that warms the motors."""
    told, other = live(), live()
    given = told.limit((0.9,))
    other.limit((0.9,))
    told.applied((0.25,))
    assert given == (0.9,)
    assert told.counts["force limited by the device"] == 1
    assert 0.0 < told.thermal.rise < other.thermal.rise
    assert told.thermal.rise == pytest.approx((1.0 - DECAY) * 0.25**2 / PHANTOM[1] ** 2)
    slope_n = 1000.0 * T_C
    assert told.limit((3.0,))[0] == pytest.approx(0.25 + slope_n)
    assert other.limit((3.0,))[0] == pytest.approx(0.9 + slope_n)


@pytest.mark.parametrize("transition", ["fail", "stale", "stop"])
@pytest.mark.parametrize("acting_n", [0.9, 0.3, -0.9, 5.0])
def test_zero_is_asked_of_a_device_that_says_for_ever_that_an_old_force_acts(transition, acting_n) -> None:
    """Its wire is lost, or its reply is: nothing that it says may keep the force, or the end of the session, waiting."""
    safety = live()
    safety.limit((0.9,))
    safety.event(transition, "the test says so")
    ramp_s = FAULT_OUT_S if transition == "fail" else RAMP_OUT_S
    for _ in range(math.ceil(ramp_s / T_C) + math.ceil(abs(acting_n) / (MOST_SLOPE_NPS * T_C)) + 2):
        asked = safety.limit(None)
        safety.applied((acting_n,))
    assert asked == (0.0,)
    assert safety.quiet
