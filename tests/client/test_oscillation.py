"""Detection of oscillation at the hand, from both sides of each bound."""

from collections.abc import Callable
from math import exp, pi, sin, sqrt

import pytest

from cogrip.client.safety.oscillation import (
    FAST_HZ,
    MOST_AT_LIMIT,
    REVERSALS,
    RING_KEPT,
    RINGS_DOWN,
    SWING_N,
    WINDOW_S,
    OscillationDetector,
)

RATE_HZ = 1024
T = 1.0 / RATE_HZ


def found(
    force: Callable[[float], float], local: Callable[[float], float] = lambda t: 0.0, seconds: float = 2.0, M: int = 1
) -> bool:
    detector = OscillationDetector(1, T, M)
    ticks = [k * T for k in range(round(seconds * RATE_HZ))]
    return any(detector.add([force(t)], False, [local(t)]) or detector.oscillates for t in ticks)


def sine(hz: float, newton: float, bias: float = 0.0) -> Callable[[float], float]:
    return lambda t: bias + newton * sin(2.0 * pi * hz * t)


@pytest.mark.parametrize("hz", [FAST_HZ * 1.1, 67.0, 150.0, 400.0])
def test_a_force_that_reverses_fast_is_found(hz: float) -> None:
    assert found(sine(hz, 0.55 * SWING_N))


@pytest.mark.parametrize(
    ("hz", "newton", "bias"),
    [
        (FAST_HZ * 0.9, 5.0, 0.0),  # a hand can
        (12.0, 8.0, 0.0),
        (67.0, 0.49 * SWING_N, 0.0),
        (128.0, 1.0, 3.0),  # steps of the object's state, felt as they are, keep their sign
    ],
)
def test_what_is_no_oscillation(hz: float, newton: float, bias: float) -> None:
    assert not found(sine(hz, newton, bias))


def test_the_local_force_counts_on_a_bias_too() -> None:
    """A hand that presses with 3 N and is shaken: the whole force keeps its sign."""
    assert found(sine(67.0, 1.0, 3.0), sine(67.0, 1.0))
    assert not found(sine(67.0, 1.0, 3.0), sine(67.0, 0.49 * SWING_N))


def ringing(hz: float, damping_ratio: float, newton: float = 6.0) -> Callable[[float], float]:
    """Return the force of a contact of this frequency and damping ratio that a hand pushes with `newton` at once."""
    decay, damped = 2.0 * pi * hz * damping_ratio, 2.0 * pi * hz * sqrt(1.0 - damping_ratio**2)
    return lambda t: newton * (1.0 - exp(-decay * t) * (sin(damped * t + 0.5 * pi)))


@pytest.mark.parametrize("hz", [21.0, 29.0, 60.0, 130.0])
@pytest.mark.parametrize("damping_ratio", [0.02, 0.05, 0.2, 0.5])
def test_a_ring_that_decays_is_none(hz: float, damping_ratio: float) -> None:
    """A hard wall rings when it is met; nothing makes energy, and what is damped less makes it ring the more."""
    assert exp(-2.0 * pi * damping_ratio) < RING_KEPT
    assert not found(lambda t: 3.0, ringing(hz, damping_ratio), M=8)


@pytest.mark.parametrize("hz", [21.0, 29.0, 60.0, 130.0])
@pytest.mark.parametrize("damping_ratio", [0.0, 0.002, -0.01, -0.05])
def test_one_that_stays_or_grows_is_found(hz: float, damping_ratio: float) -> None:
    assert found(lambda t: 3.0, ringing(hz, damping_ratio, 2.0), M=8)


def test_a_bounce_that_comes_lower_each_time_is_none_and_one_that_does_not_is() -> None:
    """Contact of 15 ms, every 20 ms: each touch half as hard as the one before, or as hard."""

    def bounce(kept: float) -> Callable[[float], float]:
        return lambda t: 20.0 * kept ** (t // 0.02) * max(0.0, sin(pi * (t % 0.02) / 0.015))

    assert not found(lambda t: 1.0, bounce(0.5), M=8)
    assert found(lambda t: 1.0, bounce(1.0), M=8)


def test_a_tap_is_none() -> None:
    """Contact of 20 ms, four times a second: up and down, and a bounce."""
    assert not found(lambda t: 4.0 if t % 0.25 < 0.02 or 0.04 < t % 0.25 < 0.045 else 0.0, lambda t: 0.0)


@pytest.mark.parametrize("more", [0, 1])
def test_a_tenth_of_half_a_second_at_the_limit_in_all(more: int) -> None:
    """Scattered, whatever the sign."""
    detector = OscillationDetector(1, T)
    window = round(WINDOW_S * RATE_HZ)
    most = int(MOST_AT_LIMIT * window) + more
    for k in range(window):
        detector.add([0.0], k % 10 == 0 and k // 10 < most, [0.0])
    assert detector.at_limit == bool(more)
    for _ in range(window):
        detector.add([0.0], False, [0.0])
    assert not detector.at_limit


def test_axes_are_watched_each() -> None:
    detector = OscillationDetector(3, T)
    for k in range(RATE_HZ):
        detector.add([0.0, 0.0, sine(67.0, 1.0)(k * T)], False, [0.0] * 3)
    assert detector.oscillates
    detector.forget()
    assert not detector.oscillates


def held(hz: float, newton: float, M: int = 8) -> Callable[[float], float]:
    """Return a sine that is held over frames of M ticks."""
    return lambda t: sine(hz, newton)(round(t * RATE_HZ) // M * M * T + 0.5 * T)


def test_a_ramp_that_steps_back_at_each_frame_is_none() -> None:
    """Free motion of a hand that accelerates: the local force ramps, the wave steps (1 N a frame, around 0)."""
    assert not found(ramp(1.0), M=8)
    assert found(ramp(1.0)), "frames of a tick: 128 Hz"


def alternating(newton: float) -> Callable[[float], float]:
    """Return a force of another sign in each frame: 64 Hz."""
    return lambda t: newton * (-1.0) ** (round(t * RATE_HZ) // 8)


def ramp(newton: float) -> Callable[[float], float]:
    """Return a force that ramps by so much in each frame, and steps back, around 0."""
    return lambda t: newton * (round(t * RATE_HZ) % 8 / 8.0 - 0.4375)


@pytest.mark.parametrize(
    "loop", [held(FAST_HZ * 1.2, 0.7 * SWING_N), held(39.0, 0.7 * SWING_N), alternating(0.51 * SWING_N)]
)
def test_an_oscillation_of_the_loop_through_the_server_is_found_by_its_means(loop: Callable[[float], float]) -> None:
    assert found(loop, M=8)
    assert found(lambda t: loop(t) + ramp(0.6)(t), M=8), "whatever ramps within a frame"
    assert not found(lambda t: 0.7 * loop(t), M=8)


def test_the_device_end_is_watched_within_a_frame() -> None:
    """At 200 Hz the mean of a frame has next to nothing; the local force turns."""
    assert found(sine(200.0, 0.6), sine(200.0, 0.6), M=8)
    assert not found(sine(200.0, 0.6), M=8), "nothing else varies within a frame"


def test_a_train_of_reversals_is_told_with_the_fifth_in_a_row_and_each_third_after_it() -> None:
    detector = OscillationDetector(1, T, 8)
    told = []
    for frame in range(14):
        sign = -1.0 if frame % 2 else 1.0
        for tick in range(8):
            assert not detector.add([0.3 * sign], False, [0.0])
            assert not detector.reverses or tick == 7, "at the end of a frame, and in that tick alone"
        if detector.reverses:
            told.append(frame)
    # the reversal in frame 1 is not fast: there was none before it
    assert told == [1 + REVERSALS, 1 + REVERSALS + RINGS_DOWN, 1 + REVERSALS + 2 * RINGS_DOWN]
    for _ in range(100):
        detector.add([0.0], False, [0.0])
    assert not detector.reverses
