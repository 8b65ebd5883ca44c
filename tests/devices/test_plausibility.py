"""Samples and reports that no held device gives are named, and hands are left alone. 1024 a second; both sides of bounds."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import cos, exp, inf, nan, pi, sin
from random import Random

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cogrip.devices import plausibility
from cogrip.devices.device import Sample
from cogrip.devices.forcedimension.models import RECORDS
from cogrip.devices.plausibility import AGE, DRIFT, HAND_MPS, HAND_MPS2, JUMP, OLD, REPORT, ForceReports, Plausibility
from cogrip.devices.registry import make

from tests.devices.held_device import RATE_HZ, hold, opened
from tests.devices.test_encoder_watch import GAP_TICKS as GAP
from tests.devices.test_encoder_watch import HANDS, recorded
from tests.extent import every

TICK_S = 1.0 / RATE_HZ
OMEGA, DELTA = RECORDS["omega3"], RECORDS["delta3"]
TOUCH = make("openhaptics:Default Device?model=touch", axes=3).capability
PHANTOM = make("sim:phantom", axes=3).capability
IDEAL = make("sim:ideal", axes=1).capability
STILL = (0.0, 0.0, 0.0)
every_record = pytest.mark.parametrize("record", [OMEGA, DELTA, TOUCH, PHANTOM], ids=lambda record: record.model)


def judged(judge: Plausibility, positions: Iterable[Sequence[float]], first: int = 0) -> list[str]:
    """Return what is said of these positions, one a tick."""
    return [judge.judge(first + tick, Sample(tuple(place), None)) for tick, place in enumerate(positions)]


def reported(
    positions: Iterable[float], velocities: Iterable[float], count_m: float = 0.0
) -> tuple[Plausibility, list[str]]:
    """The same of a device of one axis that gives velocity."""
    judge = Plausibility(replace(IDEAL, resolution_m=count_m), TICK_S)
    samples = [Sample((x,), (v,)) for x, v in zip(positions, velocities, strict=True)]
    return judge, [judge.judge(tick, sample) for tick, sample in enumerate(samples)]


@pytest.mark.parametrize("rate_hz", [128, 1024, 8192])
@pytest.mark.parametrize("time_s", [0.0001, 0.001, 0.005, 0.03])
def test_the_bound_is_the_integral_of_the_speed_gained(rate_hz: int, time_s: float) -> None:
    """dr/dt = min(a (t + l), most)."""
    tick_s, steps = 1.0 / rate_hz, 20_000
    grid = (np.arange(steps) + 0.5) * time_s / steps
    gained = np.minimum(HAND_MPS2 * (grid + 1.5 * tick_s), HAND_MPS)
    off_m = plausibility.off_course_m(time_s, 1.5 * tick_s, HAND_MPS2)
    assert off_m == pytest.approx(gained.mean() * time_s, rel=1e-6)


@pytest.mark.sample(4)
@every_record
@pytest.mark.parametrize("hand", every(3, HANDS))
def test_recorded_hands_are_believed(record, hand: str) -> None:
    count = record.resolution_m
    positions = np.round(recorded(hand) / count) * count
    assert set(judged(Plausibility(record, TICK_S), positions.tolist())) == {""}


@every_record
@given(gaps=st.lists(st.integers(1, 3 * GAP), min_size=5, max_size=60), seed=st.integers(0, 99))
@example(gaps=[1, 1, 1, 1, 1], seed=52)  # of the only step whose speed was known, uneven ticks had left nearly nothing
@example(gaps=[1, 1, 51, 60, 1, 1], seed=24)
def test_a_hand_whose_samples_are_missing_or_uneven_is_believed(record, gaps: list[int], seed: int) -> None:
    """Each sample is taken up to a tick late."""
    judge, random, tick = Plausibility(record, TICK_S), Random(seed), 0
    for gap in gaps:
        tick += gap
        phase = 2.0 * pi * 3.0 * (tick + random.random()) * TICK_S
        assert judge.judge(tick, Sample((0.05 * sin(phase), 0.02 * cos(phase), 0.0), None)) == ""


@pytest.mark.parametrize("speed_mps", [0.05, 0.3, 1.4])
@pytest.mark.parametrize("rebound", [0.0, 0.15, 0.5])
def test_a_hand_that_flies_into_an_end_stop_has_not_jumped(speed_mps: float, rebound: float) -> None:
    positions, x, v = [], -0.04, speed_mps
    for _ in range(300):
        x += v * TICK_S
        if x > 0.03:
            x, v = 0.03 - rebound * (x - 0.03), -rebound * abs(v)
        positions.append((x, 0.0, 0.0))
    assert set(judged(Plausibility(OMEGA, TICK_S), positions)) == {""}


@pytest.mark.parametrize("acceleration_mps2", [20.0, 100.0, 200.0])
@pytest.mark.parametrize("amplitude_m", [0.0005, 0.002, 0.01])
def test_motions_of_a_hand_are_believed(acceleration_mps2: float, amplitude_m: float) -> None:
    omega = (acceleration_mps2 / amplitude_m) ** 0.5
    positions = [(amplitude_m * min(1.0, tick / 400) * sin(omega * tick * TICK_S), 0.0, 0.0) for tick in range(800)]
    assert set(judged(Plausibility(OMEGA, TICK_S), positions)) == {""}


@every_record
@pytest.mark.parametrize("speed_mps", [0.0, 0.3])
def test_both_sides_of_a_jump(record, speed_mps: float) -> None:
    """Across the motion, where it may not be early or late."""
    motors = record.peak_force_n / record.apparent_mass_kg
    slack_m = plausibility.SLACK_COUNTS * record.resolution_m + 1e-6
    most = plausibility.off_course_m(TICK_S, 1.5 * TICK_S, HAND_MPS2) + motors * TICK_S * 2.0 * TICK_S + slack_m
    assert most < 0.0015
    for size, said in ((0.999 * most, ""), (1.001 * most, JUMP)):
        judge = Plausibility(record, TICK_S)
        run = [(speed_mps * TICK_S * tick, 0.0, 0.0) for tick in range(51)]
        assert judged(judge, [*run[:-1], (run[-1][0], size, 0.0)])[-1] == said


@every_record
@pytest.mark.parametrize("jump_m", [0.002, 0.03, -0.03])
def test_a_jump_that_stays_is_a_fault_within_three_samples(record, jump_m: float) -> None:
    """And time makes it no more plausible."""
    judge = Plausibility(record, TICK_S)
    judged(judge, [STILL] * 50)
    faults = []
    for tick in range(50, 60):
        assert judge.judge(tick, Sample((jump_m, 0.0, 0.0), None)) == JUMP
        faults.append(judge.fault)
    assert [bool(fault) for fault in faults[: int(plausibility.JUMPS)]] == [False, False, True]
    assert faults[2].startswith(f"the position jumped: {abs(jump_m) * 1e3:.1f} mm in 2.9 ms")
    assert faults[2].endswith("then re-arm")


def test_one_odd_sample_is_left_out_and_forgiven() -> None:
    judge = Plausibility(OMEGA, TICK_S)
    for tick in range(500):
        odd = tick % 10 == 9
        assert judge.judge(tick, Sample((0.03 if odd else 0.0, 0.0, 0.0), None)) == (JUMP if odd else "")
        assert judge.fault == ""


def test_after_a_restart_any_place_is_the_reference() -> None:
    judge = Plausibility(OMEGA, TICK_S)
    judged(judge, [STILL] * 50)
    judge.restart()
    assert judged(judge, [(0.03, 0.0, 0.0)] * 50, 50) == [""] * 50


def test_after_a_gap_the_speed_is_not_known() -> None:
    for ticks, jump_m, said in ((6, 0.008, JUMP), (2 * GAP, 0.05, ""), (2 * GAP, 0.2, JUMP)):
        judge = Plausibility(OMEGA, TICK_S)
        judged(judge, [STILL] * 50)
        assert judge.judge(49 + ticks, Sample((jump_m, 0.0, 0.0), None)) == said


def test_a_number_that_is_not_finite_is_somebody_elses() -> None:
    judge = Plausibility(OMEGA, TICK_S)
    for wrong in (nan, inf, -inf):
        assert judged(judge, [*[STILL] * 5, (wrong, 0.0, 0.0), STILL]) == [""] * 7
        judge.restart()


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_both_sides_of_an_age(latency: int) -> None:
    most = latency + GAP + 1
    for age, said in ((-1000, AGE), (-1, AGE), (0, ""), (most, ""), (most + 1, AGE), (10**9, AGE)):
        judge = Plausibility(replace(OMEGA, latency_ticks=latency), TICK_S)
        judge.judge(100, Sample(STILL, None))
        judge.restart()
        assert judge.judge(101, Sample(STILL, None, age)) == said


def test_an_age_that_grows_is_no_new_sample() -> None:
    """A growing age is found even while it is small."""
    judge = Plausibility(OMEGA, TICK_S)
    said = [judge.judge(tick, Sample(STILL, None, tick)) for tick in range(100)]
    assert said == ["", *[OLD] * (GAP + 1), *[AGE] * (98 - GAP)]


def test_a_request_made_before_skipped_ticks_is_as_old_as_they_are_and_a_reading_again_says_nothing() -> None:
    judge = Plausibility(TOUCH, TICK_S)
    asked = ((10, 1), (90, 79), (91, 0), (91, 0))
    assert [judge.judge(tick, Sample(STILL, None, age)) for tick, age in asked] == [""] * 4


def test_exact_velocities_are_believed() -> None:
    for hand in ("reach&amplitude_m=0.1&stroke_s=0.2", "tremor&tremor_m=0.002", "sine&amplitude_m=0.02&frequency_hz=8"):
        device = opened(f"sim:ideal?hand={hand}")
        judge = Plausibility(device.capability, TICK_S)
        samples = hold(device, 2000, lambda tick: (20.0,) if tick % 256 < 128 else (-20.0,))
        assert {judge.judge(tick, sample) for tick, sample in enumerate(samples)} == {""}


@pytest.mark.parametrize("lag_s", [0.001, 0.005, 0.02])
@pytest.mark.parametrize("count_m", [0.0, 1e-5, 1e-4])
def test_velocities_that_lag_are_believed(lag_s: float, count_m: float) -> None:
    """A filter's lag, strokes, a blow against a stop, counts; at rest the velocity shakes by what a count makes of it."""
    x, v, given, positions, velocities = 0.0, 0.0, 0.0, [], []
    for tick in range(3000):
        t = tick * TICK_S
        v = 0.6 * sin(2.0 * pi * 1.5 * t) if t < 1.5 else 1.0 if 1.6 < t < 1.7 else 0.0
        x += v * TICK_S
        given += (1.0 - exp(-TICK_S / lag_s)) * (v - given)
        positions.append(round(x / count_m) * count_m if count_m else x)
        velocities.append(given + (0.5 * count_m / TICK_S * (-1) ** tick))
    assert set(reported(positions, velocities, count_m)[1]) == {""}


@pytest.mark.parametrize("speed", [0.03, 0.4, -0.4])
def test_a_position_that_freezes_while_a_velocity_goes_on(speed: float) -> None:
    ticks = np.arange(1000)
    positions = np.minimum(ticks, 500) * speed * TICK_S
    judge, said = reported(positions, np.full(1000, speed))
    assert said[:501] == [""] * 501
    assert 0 < (said.index(DRIFT) - 500) * TICK_S <= 1.7 * plausibility.WINDOW_S
    assert "its positions deny each other by" in judge.fault


@pytest.mark.parametrize("speed", [0.1, 0.4])
def test_a_velocity_that_shakes_where_nothing_moves(speed: float) -> None:
    """+-8 N a tick on a damper of 20 N s/m."""
    said = reported([0.0] * 200, [speed * (-1) ** tick for tick in range(200)])[1]
    assert said.index(DRIFT) * TICK_S <= plausibility.WINDOW_S


@pytest.mark.parametrize("fraction", [0.0, -1.0, 3.0, 1000.0])
def test_a_velocity_of_another_size_or_sign(fraction: float) -> None:
    """None at all, the other way, millimetres a second: within a stroke."""
    phases = 2.0 * pi * np.arange(1000) * TICK_S
    said = reported(0.05 * np.sin(phases), fraction * 0.05 * 2.0 * pi * np.cos(phases))[1]
    assert DRIFT in said


def reports(*asked: tuple[float, ...]) -> ForceReports:
    found = ForceReports(OMEGA, RATE_HZ)
    for force in asked:
        found.asked(force)
    return found


PEAK = OMEGA.peak_force_n


@pytest.mark.parametrize(
    ("acting", "said"),
    [
        ((1.0, -2.0, 0.0), ""),
        ((0.5, -1.0, 0.0), ""),
        ((0.0, 0.0, 0.0), ""),
        ((0.0, -2.0, 0.0), ""),  # an axis at its limit
        ((1.0 + 0.019 * PEAK, -2.0, 0.0), ""),
        ((1.0 + 0.021 * PEAK, -2.0, 0.0), REPORT),
        ((-0.021 * PEAK, -2.0, 0.0), REPORT),
        ((-50.0, 100.0, 0.0), REPORT),
        ((nan, -2.0, 0.0), REPORT),
        ((1.0, -inf, 0.0), REPORT),
        ((1.0,), REPORT),
        ((), REPORT),
    ],
)
def test_what_acts_is_a_part_of_what_was_asked(acting: tuple[float, ...], said: str) -> None:
    assert reports((1.0, -2.0, 0.0)).judge(acting) == said


def test_an_earlier_force_may_still_act_but_not_for_ever() -> None:
    most = round(plausibility.REPORT_S * RATE_HZ)
    for ticks, said in ((most - 1, ""), (most, REPORT)):
        assert reports((3.0, 0.0, 0.0), *[(-1.0, 0.0, 0.0)] * ticks).judge((3.0, 0.0, 0.0)) == said


def test_a_report_that_goes_on_is_a_fault() -> None:
    found = reports((1.0, 0.0, 0.0))
    for number in range(1, 10):
        assert found.judge((-50.0, 0.0, 0.0)) == REPORT
        assert bool(found.fault) == (number >= plausibility.REPORTS)
    assert found.fault.startswith("says that (-50.0, 0.0, 0.0) N acts where (1, 0, 0) N was asked")
