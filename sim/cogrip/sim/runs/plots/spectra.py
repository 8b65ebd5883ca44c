"""Spectra and correlation of evenly sampled signals: Welch's method (1967), with half-overlapping Hann windows.

As `scipy.signal` has them, whose import alone takes longer than all the plots of a run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]


def frequencies(rate_hz: float, segment: int) -> Array:
    """Those of a spectrum of `segment` samples [Hz], from 0 to half the rate."""
    found: Array = np.arange(segment // 2 + 1, dtype=np.float64) * (rate_hz / segment)
    return found


def power_density(values: Array, rate_hz: float, segment: int) -> Array:
    """One-sided, of `values` (n,), in their unit squared per hertz, at `frequencies`."""
    pieces, window = _pieces(values, segment)
    density: Array = (np.abs(pieces) ** 2).mean(axis=0) / (rate_hz * (window**2).sum())
    density[1 : None if segment % 2 else -1] *= 2.0  # what lies at the negative ones
    return density


def coherence_of(first: Array, second: Array, segment: int) -> Array:
    """Magnitude squared, 0 to 1, of two signals (n,), at `frequencies`; 0 where one of them has nothing."""
    one, other = _pieces(first, segment)[0], _pieces(second, segment)[0]
    powers = (np.abs(one) ** 2).mean(axis=0) * (np.abs(other) ** 2).mean(axis=0)
    shared = np.abs((np.conj(one) * other).mean(axis=0)) ** 2
    level: Array = np.divide(shared, powers, out=np.zeros_like(powers), where=powers > 0.0)
    return level


def correlations(first: Array, second: Array, reach: int) -> Array:
    """sum_t first[t] second[t + lag] for every lag from -reach to reach samples, shape (2 reach + 1,)."""
    size = 1 << int(len(first) + reach).bit_length()  # of zeroes between the ends of a circle
    circle: Array = np.fft.irfft(np.fft.rfft(second, size) * np.conj(np.fft.rfft(first, size)), size)
    return np.concatenate((circle[size - reach :], circle[: reach + 1]))


def _pieces(values: Array, segment: int) -> tuple[Waves, Array]:
    """Spectra of the half-overlapping pieces, each without its mean, (pieces, frequencies); and the window (segment,)."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    pieces = np.lib.stride_tricks.sliding_window_view(values, segment)[:: segment - segment // 2]
    return np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window), window
