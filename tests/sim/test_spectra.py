"""Our spectra and correlations are those of scipy.signal."""

import numpy as np
import pytest
from scipy import signal

from cogrip.sim.runs.plots.spectra import coherence_of, correlations, frequencies, power_density

RATE_HZ = 1024.0


def two_signals(size: int) -> tuple[np.ndarray, np.ndarray]:
    """That share something, each with a mean of its own."""
    random = np.random.default_rng(size)
    shared = random.normal(size=size)
    return 0.3 + shared + random.normal(size=size), np.roll(shared, 7) + 0.5 * random.normal(size=size) - 1.0


@pytest.mark.parametrize(
    ("size", "segment"), [(1024, 256), (1024, 255), (1025, 256), (4003, 1000), (13, 3), (300, 300)]
)
def test_power_and_coherence_are_those_of_scipy(size: int, segment: int) -> None:
    one, other = two_signals(size)
    frequency, density = signal.welch(one, RATE_HZ, nperseg=segment)
    np.testing.assert_allclose(frequencies(RATE_HZ, segment), frequency, rtol=1e-15)
    np.testing.assert_allclose(power_density(one, RATE_HZ, segment), density, rtol=1e-9, atol=1e-15)
    _, level = signal.coherence(one, other, RATE_HZ, nperseg=segment)
    inner = slice(1, None)  # at 0 Hz both are noise: the mean was taken off
    np.testing.assert_allclose(coherence_of(one, other, segment)[inner], level[inner], rtol=1e-9)


def test_a_signal_that_rests_has_no_power_and_no_coherence() -> None:
    still, moving = np.zeros(400), two_signals(400)[0]
    assert not power_density(still, RATE_HZ, 100).any()
    assert not coherence_of(still, moving, 100).any()


@pytest.mark.parametrize(("size", "reach"), [(1000, 300), (1000, 999), (64, 63), (5, 0), (2000, 1023)])
def test_correlations_are_those_of_scipy(size: int, reach: int) -> None:
    one, other = two_signals(size)
    every = signal.correlate(other, one)
    wanted = every[size - 1 - reach : size + reach]
    np.testing.assert_allclose(correlations(one, other, reach), wanted, atol=1e-9 * np.abs(every).max())
