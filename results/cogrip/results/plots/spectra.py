"""Spectra and correlation of real signals in numpy alone: to load scipy's takes longer than to draw the report's plots.

Welch's method with a Hann window w, segments of n samples that overlap by half, each less its mean:

    P_xy(f) = 2 / (R sum w^2) mean over segments of conj(X) Y        coherence = |P_xy|^2 / (P_xx P_yy)

R the rate; the factor 2, of both signs of f, is 1 at f = 0 and, of even n, at R/2.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cogrip.results.plots.style import Array


def cross_densities(values: Array, rate_hz: float, segment: int) -> tuple[Array, NDArray[np.complex128]]:
    """Return frequencies [Hz] and densities P of each pair of rows [unit^2/Hz], shape (rows, rows, frequencies), complex."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    pieces = sliding_window_view(values, segment, axis=1)[:, :: segment - segment // 2]
    lines = np.fft.rfft((pieces - pieces.mean(axis=2, keepdims=True)) * window)
    sided = np.full(lines.shape[2], 2.0)
    sided[0] = 1.0
    if segment % 2 == 0:
        sided[-1] = 1.0
    scale = sided / (rate_hz * (window * window).sum() * pieces.shape[1])
    densities: NDArray[np.complex128] = scale * np.einsum("xsf,ysf->xyf", lines.conj(), lines)
    frequency_hz = np.asarray(np.arange(len(sided)) * (rate_hz / segment), dtype=np.float64)
    return frequency_hz, densities


def correlation_near(first: Array, second: Array, reach: int) -> Array:
    """Return the sums of first[k] second[k + lag] for lags from -reach to reach, at least 1 and less than their length."""
    size = 1 << (2 * len(first) - 1).bit_length()  # no lag meets another one
    sums = np.fft.irfft(np.fft.rfft(first, size).conj() * np.fft.rfft(second, size), size)
    return np.concatenate((sums[-reach:], sums[: reach + 1]))
