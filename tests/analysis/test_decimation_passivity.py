"""Tests of S(w) against theory 3.2, against runs of the decimators, and of its worst input."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.analysis.linear.decimation_passivity import (
    Filter,
    aliased_gain,
    filter_of,
    largest_gain,
    run_energy,
    swept_sine,
    worst_input,
)
from cogrip.protocol.laws.decimation import KINDS, make_decimator
from cogrip.protocol.settings.rates import Rates

RATES = Rates(1024, 128)


def decimator(kind, rates=RATES, cutoff=50.0):
    return make_decimator(kind, 1, rates.ticks_per_frame, rates.tick_s, cutoff)


def test_a_boxcar_has_gain_one_at_every_frequency():
    gains = aliased_gain(filter_of("boxcar", RATES, 1.0), 8, np.linspace(-np.pi, np.pi, 999))
    np.testing.assert_allclose(gains, 1.0, atol=1e-13)


@given(st.sampled_from(KINDS), st.sampled_from((1, 2, 4, 8, 16)), st.floats(1.0, 2000.0), st.integers(0, 2**32 - 1))
def test_no_signal_gains_more_than_the_largest_gain(kind, ticks, cutoff, seed):
    rates = Rates(128 * ticks, 128)
    most, _ = largest_gain(filter_of(kind, rates, cutoff), ticks)
    signal = np.random.default_rng(seed).normal(size=ticks * 40)
    run = run_energy(decimator(kind, rates, cutoff), signal, rates)
    assert run.gain <= most * (1.0 + 1e-12)


@pytest.mark.parametrize(("kind", "cutoff"), [("boxcar", 50.0), ("none", 50.0), ("lowpass", 50.0), ("lowpass", 250.0)])
def test_the_worst_input_comes_within_one_percent_and_only_the_boxcar_keeps_every_margin(kind, cutoff):
    """P's own filter creates energy for its worst input, though its cut-off is far below pi / M."""
    which = filter_of(kind, RATES, cutoff)
    most, _ = largest_gain(which, 8)
    run = run_energy(decimator(kind, RATES, cutoff), worst_input(which, 8, 600), RATES)
    assert 0.99 * most <= run.gain <= most * (1.0 + 1e-12)
    assert run.margin_j.min() >= -1e-15 if kind == "boxcar" else run.margin_j[-1] < 0.0


def test_a_swept_sine_shows_aliasing_without_a_filter():
    signal = swept_sine(RATES, 4.0)
    assert np.abs(signal).max() <= 1.0
    assert run_energy(decimator("boxcar"), signal, RATES).margin_j.min() >= 0.0
    assert run_energy(decimator("lowpass"), signal, RATES).margin_j[-1] > 0.0
    assert run_energy(decimator("none"), signal, RATES).margin_j.min() < 0.0


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=24), st.sampled_from((1, 2, 5, 8)))
def test_mean_of_the_gain_is_m_times_the_sum_of_squared_taps(taps, ticks):
    """Parseval: the mean of S over w is M sum h^2, for taps of any length."""
    angles = np.linspace(-np.pi, np.pi, 256, endpoint=False)
    mean = aliased_gain(Filter(tuple(taps)), ticks, angles).mean()
    assert mean == pytest.approx(ticks * sum(tap * tap for tap in taps), rel=1e-9, abs=1e-12)


def test_a_recursive_filter_is_its_own_impulse_response():
    short = filter_of("lowpass", RATES, 300.0)
    pole = -short.poles[1]
    taps = Filter(tuple((1.0 - pole) * pole**k for k in range(300)))
    angles = np.linspace(0.0, np.pi, 50)
    np.testing.assert_allclose(aliased_gain(short, 8, angles), aliased_gain(taps, 8, angles), rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Filter(()), "at least one tap"),
        (lambda: Filter((1.0,), (1.0, -1.0)), "below 1"),
        (lambda: Filter((float("nan"),)), "finite"),
        (lambda: aliased_gain(Filter((1.0,)), 0, np.array(0.0)), "at least 1"),
        (lambda: run_energy(decimator("none"), np.zeros(9), RATES), "whole number of frames"),
    ],
)
def test_what_is_no_filter_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_a_pole_just_inside_is_allowed():
    assert Filter((1.0,), (1.0, -0.999)).response(np.array(0.0)).real == pytest.approx(1000.0)
