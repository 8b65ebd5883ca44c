"""Shaking of a hand: what lasts above 12 Hz, and nothing of what a person or a contact does."""

from math import pi, sin, sqrt

import pytest

from cogrip.client.safety.shaking import SHAKE_HZ, Shaking

HZ = 1024


def shaken(force, seconds: float = 3.0, rate_hz: int = HZ, axes: int = 1) -> float:
    found = Shaking(axes, 1.0 / rate_hz)
    for tick in range(round(seconds * rate_hz)):
        found.enter((force(tick / rate_hz),) * axes)
    return found.shake_n


@pytest.mark.parametrize("rate_hz", [512, 1024, 4096])
@pytest.mark.parametrize(
    ("frequency_hz", "gain"), [(2.0, 0.0008), (6.0, 0.063), (SHAKE_HZ, 1 / sqrt(2.0)), (30.0, 0.99), (100.0, 1.0)]
)
def test_a_tone_counts_as_a_butterworth_filter_of_four_poles_lets_it_through(
    frequency_hz: float, gain: float, rate_hz: int
) -> None:
    found = shaken(lambda t: sqrt(2.0) * sin(2.0 * pi * frequency_hz * t), 6.0, rate_hz)
    assert found == pytest.approx(gain, rel=0.03, abs=4e-3)


def test_three_places_add_up() -> None:
    assert shaken(lambda t: sqrt(2.0) * sin(2.0 * pi * 60.0 * t), axes=3) == pytest.approx(sqrt(3.0), rel=0.01)


def test_a_contact_that_is_made_is_no_shaking() -> None:
    assert shaken(lambda t: 3.0 if t > 1.01 else 0.0) < 0.01
    assert shaken(lambda t: 3.0 if t % 1.0 < 0.3 else 0.0, 10.0) < 0.03, "nor taps, one a second"


def test_what_lasts_for_less_than_half_a_second_does_not_count_and_what_lasts_longer_does() -> None:
    for lasts_s, counts in ((0.3, False), (0.8, True)):
        found = shaken(lambda t, lasts_s=lasts_s: sin(2.0 * pi * 40.0 * t) if 1.0 <= t < 1.0 + lasts_s else 0.0)
        assert (found > 0.5) is counts


def test_a_force_that_stood_before_is_no_shaking_and_a_pause_begins_anew() -> None:
    found = Shaking(1, 1.0 / HZ)
    for _ in range(3):
        for _ in range(HZ // 4):
            found.enter((2.5,))
        found.pause()
    assert found.shake_n == 0.0
