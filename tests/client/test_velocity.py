"""The client's velocity estimator, its memory for each device, and the impedance that a device carries."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from math import inf, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.velocity import (
    LEAST_MEMORY,
    MEMORY,
    WANTED_NSPM,
    MotionObserver,
    impedance_bounds,
    lag_ticks,
    largest_impedance,
    memory_for,
    observer_for,
)
from cogrip.devices.device import Capability
from cogrip.devices.registry import make
from cogrip.devices.simulated.ideal import IdealPlant, IdealSettings

HZ = 1024
T_C = 1.0 / HZ
PHANTOM = make("sim:phantom").capability
MEMORIES = st.floats(0.0, 0.8)


def record(mass_kg: float, resolution_m: float, latency: int, damping_nspm: float = 1e6) -> Capability:
    numbers = {"apparent_mass_kg": mass_kg, "resolution_m": resolution_m, "damping_nspm": damping_nspm}
    return replace(PHANTOM, **numbers, latency_ticks=latency)  # type: ignore[arg-type]


def bare_arm(mass_kg: float) -> IdealPlant:
    """Return a bare device that was pushed once."""
    plant = IdealPlant(IdealSettings(mass_kg=mass_kg), 1)
    plant.open(HZ, 0.0, 0.0, (0.0,))
    plant.velocity_mps = [0.1]
    return plant


COUNTS_M = st.just(0.0) | st.floats(1e-7, 3e-4)
RECORDS = st.builds(record, st.floats(0.01, 1.0), COUNTS_M, st.integers(0, 3))


# The estimator -------------------------------------------------------------------------------------------------------


@given(MEMORIES, st.floats(-2.0, 2.0), st.lists(st.integers(1, 6), min_size=120, max_size=160))
def test_a_steady_speed_is_found_exactly_whatever_ticks_are_skipped(
    memory: float, speed_mps: float, gaps: list[int]
) -> None:
    estimator, velocity = MotionObserver(2, T_C, memory), [0.0, 0.0]
    for gap, tick in zip(gaps, accumulate(gaps), strict=True):
        velocity = estimator.update((speed_mps * tick * T_C, 0.1 - speed_mps * tick * T_C), gap)
    assert velocity == pytest.approx([speed_mps, -speed_mps], abs=1e-6)


@given(MEMORIES, st.lists(st.integers(-40, 40), min_size=1, max_size=60))
def test_the_estimate_stays_among_the_speeds_that_were_seen(memory: float, counts: list[int]) -> None:
    """The estimate is a mean of the steps so far, with weights (k + 1) memory^k (1 - memory)^2: never outside of them and 0."""
    estimator, place = MotionObserver(1, T_C, memory), 0.0
    estimator.update((place,))
    low = high = 0.0
    for count in counts:
        step = count * 3e-5
        place += step
        low, high = min(low, step * HZ), max(high, step * HZ)
        (velocity,) = estimator.update((place,))
        assert low - 1e-9 <= velocity <= high + 1e-9


@given(MEMORIES, st.floats(-0.2, 0.2), st.integers(1, 5))
def test_a_hand_at_rest_makes_no_noise_at_all(memory: float, place: float, gap: int) -> None:
    estimator = MotionObserver(1, T_C, memory)
    assert {estimator.update((place,), gap)[0] for _ in range(50)} == {0.0}


@given(MEMORIES)
def test_one_count_moves_the_estimate_by_what_the_noise_bound_says_and_is_a_count_in_all(memory: float) -> None:
    q, estimator = 3e-5, MotionObserver(1, T_C, memory)
    estimator.update((0.0,))
    first = estimator.update((q,))[0]
    assert first == pytest.approx((1.0 - memory) ** 2 * q / T_C, rel=1e-12)
    rest = sum(estimator.update((q,))[0] for _ in range(400))
    assert (first + rest) * T_C == pytest.approx(q, rel=1e-9)


def test_what_was_before_a_reset_does_not_count() -> None:
    estimator = MotionObserver(1, T_C)
    for tick in range(20):
        estimator.update((0.01 * tick,))
    estimator.reset()
    assert estimator.update((5.0,)) == [0.0]
    assert estimator.update((5.0,)) == [0.0]


# Its numbers ---------------------------------------------------------------------------------------------------------

COUNT_M = (
    0.055e-3  # one count of the encoder [m]: 9 mm/s of the estimate, 0.18 N at b = 20; the plain difference has 56 mm/s
)
ALPHA, BETA = 1.0 - 0.6**2, (1.0 - 0.6) ** 2


def test_noise_of_the_estimate_is_what_the_filter_promises() -> None:
    """var = 2 beta^2 / (alpha (4 - 2 alpha - beta)) of the noise's over T^2, for white noise of a count's width."""
    random, estimator = np.random.default_rng(1), MotionObserver(1, T_C)
    noise = random.uniform(-COUNT_M / 2, COUNT_M / 2, 200_000)
    found = np.array([estimator.update((value,))[0] for value in noise.tolist()])[1000:]
    expected = COUNT_M / sqrt(12) / T_C * sqrt(2 * BETA**2 / (ALPHA * (4 - 2 * ALPHA - BETA)))
    assert found.std() == pytest.approx(expected, rel=0.03)
    assert expected == pytest.approx(2.9e-3, rel=0.01), "2.9 mm/s: 0.06 N at b = 20"


def test_an_accelerating_hand_is_followed_three_and_a_half_ticks_late() -> None:
    """Lag = (alpha / beta - 1/2) T_c = 3.4 ms."""
    estimator, velocity = MotionObserver(1, T_C), 0.0
    for tick in range(500):
        (velocity,) = estimator.update((0.5 * 3.0 * (tick * T_C) ** 2,))
    lag_s = 499 * T_C - velocity / 3.0
    assert lag_s == pytest.approx(3.5 * T_C, rel=1e-6)


@pytest.mark.parametrize(
    ("memory", "mass_kg", "holds"), [(0.6, 0.020, False), (0.6, 0.022, True), (0.8, 0.043, False), (0.8, 0.048, True)]
)
def test_a_damper_that_lags_too_much_shakes_the_arm(memory: float, mass_kg: float, holds: bool) -> None:
    """F = b y_est on a bare arm, b = 20: it holds from 20.8 g with memory 0.6, from 44.5 g with 0.8."""
    plant, estimator = bare_arm(mass_kg), MotionObserver(1, T_C, memory)
    for _ in range(4096):
        (speed,) = estimator.update(plant.position_m)
        plant.step((0.0,), (20.0 * speed,))
    assert (abs(plant.velocity_mps[0]) < 1e-6) is holds
    assert holds or abs(plant.velocity_mps[0]) > 1.0


# How late a damper may be --------------------------------------------------------------------------------------------


def bare_limit(memory: float, latency: int) -> float:
    """b T / m of a bare device on its damper, in closed form (module docstring)."""
    if latency == 0:
        return 2.0 * (1.0 - memory**2) / (1.0 + memory**2)
    s, p = 1.0 - memory, 1.0 + memory - memory**2
    return 2.0 * (sqrt(p**2 + s**3 * (1.0 + memory)) - p) / s**2


def speeds(share: float, memory: float, latency: int) -> Sequence[float]:
    """A bare device of 0.1 kg, pushed once, on the damper b = share m / T of its estimate from old samples."""
    plant, estimator = bare_arm(0.1), MotionObserver(1, T_C, memory)
    places, found = [0.0] * (latency + 1), []
    for _ in range(6000):
        places = [*places[1:], plant.position_m[0]]
        (speed,) = estimator.update((places[0],))
        plant.step((0.0,), (share * 0.1 / T_C * speed,))
        found.append(abs(plant.velocity_mps[0]))
    return found


@pytest.mark.parametrize("latency", [0, 1])
@pytest.mark.parametrize("memory", [0.0, 0.3, 0.48, 0.6, 0.8])
def test_the_closed_form_of_a_bare_device_from_both_sides(memory: float, latency: int) -> None:
    limit = bare_limit(memory, latency)
    calm, unstable = speeds(0.99 * limit, memory, latency), speeds(1.01 * limit, memory, latency)
    assert max(calm[-500:]) < 0.5 * max(calm[2000:2500])
    assert max(unstable[-500:]) > 2.0 * max(unstable[2000:2500])


@given(MEMORIES, st.integers(0, 1))
def test_the_lag_bound_is_well_inside_of_what_a_bare_device_holds(memory: float, latency: int) -> None:
    lag = latency + (1.0 + memory) / (1.0 - memory)
    assert 1.0 / lag <= 0.66 * bare_limit(memory, latency)


# Memory and impedance of a device ------------------------------------------------------------------------------------


@given(RECORDS)
def test_the_memory_is_the_largest_of_those_allowed_that_carries_what_is_wanted(found: Capability) -> None:
    def carries(memory: float) -> bool:
        late = found.latency_ticks + (1.0 + memory) / (1.0 - memory)
        return found.apparent_mass_kg / (late * T_C) >= WANTED_NSPM * (1.0 - 1e-9)

    memory = memory_for(found, T_C)
    assert LEAST_MEMORY <= memory <= MEMORY
    assert carries(memory) or memory == LEAST_MEMORY
    assert memory == MEMORY or not carries(memory + 1e-6)


@pytest.mark.parametrize(
    ("mass_kg", "resolution_m", "latency", "memory", "largest", "bound"),
    [
        (0.1, 3e-5, 0, 0.6, 25.6, "lag"),  # a session's own simulated device
        (0.075, 3e-5, 0, 0.587, 20.0, "lag"),
        (0.075, 2.82e-5, 1, 0.5, 19.2, "lag"),  # the vintage Phantom
        (0.09, 3e-5, 1, 0.566, 20.0, "lag"),
        (0.045, 5.5e-5, 1, 0.5, 11.52, "lag"),  # a Touch
        (0.2, 6.4e-5, 1, 0.6, 16.69, "noise"),  # heavy and coarse
        (0.3, 0.0, 0, 0.6, 76.8, "lag"),  # nothing to make a noise
    ],
)
def test_memory_and_largest_impedance_of_some_devices(
    mass_kg: float, resolution_m: float, latency: int, memory: float, largest: float, bound: str
) -> None:
    found = record(mass_kg, resolution_m, latency)
    assert memory_for(found, T_C) == pytest.approx(memory, abs=6e-4)
    answer = largest_impedance(found, T_C)
    assert answer.impedance_nspm == pytest.approx(largest, rel=1e-3)
    assert answer.bound == bound
    assert answer.lag_ticks == lag_ticks(found, T_C)


def test_the_records_own_bound_can_bind() -> None:
    bound = replace(largest_impedance(record(0.1, 3e-5, 0), T_C), impedance_nspm=8.0, bound="record")
    assert largest_impedance(record(0.1, 3e-5, 0, damping_nspm=8.0), T_C) == bound


@given(RECORDS, st.floats(1.01, 3.0))
def test_an_older_sample_a_lighter_arm_a_coarser_count_never_carries_more(found: Capability, more: float) -> None:
    best = largest_impedance(found, T_C).impedance_nspm
    for worse in (
        replace(found, latency_ticks=found.latency_ticks + 1),
        replace(found, apparent_mass_kg=found.apparent_mass_kg / more),
        replace(found, resolution_m=more * found.resolution_m),
    ):
        assert largest_impedance(worse, T_C).impedance_nspm <= best * (1.0 + 1e-9)


def test_a_device_that_gives_velocity_needs_no_estimator_and_is_bound_as_theory_has_it() -> None:
    ideal = make("sim:ideal").capability
    assert observer_for(ideal, T_C, (1.0,)) is None
    assert impedance_bounds(ideal, T_C) == {"lag": pytest.approx(102.4), "noise": inf, "record": 51.2}
    assert impedance_bounds(replace(ideal, latency_ticks=1), T_C)["lag"] == pytest.approx(51.2)


# Faster loops --------------------------------------------------------------------------------------------------------


@given(RECORDS, st.floats(1.0, 8.0))
def test_a_faster_loop_takes_nothing_from_what_a_device_carries(found: Capability, times: float) -> None:
    """One count is no louder than at 1024 Hz, and the damper no later, however many samples there are."""
    slow, fast = impedance_bounds(found, T_C), impedance_bounds(found, T_C / times)
    for name, bound in slow.items():
        assert fast[name] >= bound * (1.0 - 1e-9), name


def test_the_memory_of_a_faster_loop() -> None:
    heavy = record(1.0, 3e-5, 0)
    assert memory_for(heavy, T_C) == memory_for(heavy, 2.0 * T_C) == MEMORY
    assert memory_for(heavy, T_C / 4) == pytest.approx(0.8, abs=1e-12)
    jumps = [(1.0 - memory_for(heavy, T_C / times)) ** 2 * times for times in (1, 2, 4, 8)]
    assert jumps == pytest.approx([0.16] * 4, rel=1e-12)


@pytest.mark.parametrize("axes", [1, 3, 6])
@pytest.mark.parametrize("more", [-1, 1, 200])
def test_a_place_of_other_axes_is_refused(axes: int, more: int) -> None:
    """A recording may hold one: of these numbers there is room for six."""
    for _ in range(20):
        estimator = MotionObserver(axes, 1e-3)
        with pytest.raises(ValueError, match=rf"a position of {axes + more} axes, and there are {axes}"):
            estimator.update((0.5,) * (axes + more))
        assert estimator.update((0.5,) * axes) == [0.0] * axes
