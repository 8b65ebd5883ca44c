"""Spectra and correlation of the report's plots, against scipy's."""

import numpy as np
import pytest
from scipy import signal  # type: ignore[import-untyped]

from cogrip.sim.runs.plots.spectra import correlation_near, cross_densities


@pytest.mark.parametrize(("samples", "segment"), [(1000, 200), (1001, 201), (64, 16), (257, 257)])
def test_densities_and_coherence_are_scipys(samples: int, segment: int) -> None:
    values = np.random.default_rng(samples).normal(size=(3, samples)).cumsum(axis=1)
    frequency, densities = cross_densities(values, 128.0, segment)
    expected_hz, powers = signal.welch(values, 128.0, nperseg=segment)
    assert frequency == pytest.approx(expected_hz)
    for row in range(3):
        assert densities[row, row].real == pytest.approx(powers[row], rel=1e-9, abs=1e-18)
        assert densities[row, row].imag == pytest.approx(0.0, abs=1e-12 * powers[row].max())
    _, cross = signal.csd(values[0], values[2], 128.0, nperseg=segment)
    assert np.allclose(densities[0, 2], cross, rtol=1e-9, atol=1e-12 * abs(cross).max())


@pytest.mark.parametrize("reach", [1, 20, 299])
def test_correlation_at_lags_is_scipys(reach: int) -> None:
    first, second = np.random.default_rng(reach).normal(size=(2, 300))
    expected = signal.correlate(second, first, method="direct")[299 - reach : 300 + reach]
    assert correlation_near(first, second, reach) == pytest.approx(expected, abs=1e-9)
