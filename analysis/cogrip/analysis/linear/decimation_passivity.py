"""The exact condition for a filter and a downsampler to be passive: max S <= 1 (theory section 3.2; P section II asks less).

With H_k the filter's response and U_k the input's spectrum at the alias (w + 2 pi k) / M, k = 0 ... M - 1, the kept samples
have the sum of H_k U_k at the angle w. So S(w), the sum of |H_k|^2,
bounds their energy by Cauchy-Schwarz, with equality for U_k in proportion to conj(H_k): the worst input.

symbols: M device ticks in a frame, w angle per frame [rad], H at the device rate, S [1]; waves in sqrt(W), energies in J.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi

import numpy as np

from cogrip.analysis.linear.state_space import Array, Complex
from cogrip.protocol.laws.decimation import Decimator
from cogrip.protocol.settings.rates import Rates

_SCAN = 1025
_ZOOMS = 3


@dataclass(frozen=True, slots=True)
class Filter:
    """A filter H = sum b_i z^-i / sum a_i z^-i at the device rate; taps alone are a finite impulse response.

    Raises ValueError for no taps, numbers that are not finite, or a pole on or outside the unit circle.
    """

    taps: tuple[float, ...]
    poles: tuple[float, ...] = (1.0,)  # a

    def __post_init__(self) -> None:
        if not self.taps or not self.poles or self.poles[0] == 0.0:
            raise ValueError(
                f"filter with taps {self.taps} over {self.poles}: give at least one tap, and a_0 that is not 0"
            )
        if not np.isfinite((*self.taps, *self.poles)).all():
            raise ValueError(f"filter with taps {self.taps} over {self.poles}: every number must be finite")
        outermost = np.abs(np.roots(self.poles)).max(initial=0.0)
        if outermost >= 1.0:
            raise ValueError(
                f"filter over {self.poles}: has a pole at radius {outermost:g}, which must be below 1 to be stable"
            )

    def response(self, angle: Array) -> Complex:
        """Return H(e^{j angle}), angle [rad per device tick] of any shape."""
        delay = np.exp(-1j * np.asarray(angle, dtype=float))
        above = np.polynomial.polynomial.polyval(delay, self.taps)
        below = np.polynomial.polynomial.polyval(delay, self.poles)
        return np.asarray(above / below, dtype=np.complex128)


def lowpass_pole(lowpass_rad_s: float, rates: Rates) -> float:
    """Return the pole of the first-order lowpass, P eq. 32, discretised exactly."""
    return exp(-lowpass_rad_s * rates.tick_s)


def filter_of(kind: str, rates: Rates, lowpass_rad_s: float) -> Filter:
    """Return the filter of a decimator's `kind`. Raises KeyError for an unknown one."""
    pole = lowpass_pole(lowpass_rad_s, rates)
    M = rates.ticks_per_frame
    filters = {"boxcar": Filter((1.0 / M,) * M), "lowpass": Filter((1.0 - pole,), (1.0, -pole)), "none": Filter((1.0,))}
    return filters[kind]


def aliased_gain(which: Filter, ticks_per_frame: int, angle: Array) -> Array:
    """Return S(w) at w = `angle` [rad per frame], any shape. Raises ValueError for M below 1."""
    gains: Array = (np.abs(_aliases(which, ticks_per_frame, angle)) ** 2).sum(axis=-1)
    return gains


def largest_gain(which: Filter, ticks_per_frame: int) -> tuple[float, float]:
    """Return max S and the w in [0, pi] where it is reached, to rounding. Raises ValueError for M below 1."""
    low, high, found = 0.0, pi, (0.0, 0.0)
    for _ in range(_ZOOMS):  # S is even and smooth: each round keeps the two steps beside its largest value
        angles = np.linspace(low, high, _SCAN)
        gains = aliased_gain(which, ticks_per_frame, angles)
        near = int(gains.argmax())
        found = float(gains[near]), float(angles[near])
        low, high = angles[max(near - 1, 0)], angles[min(near + 1, _SCAN - 1)]
    return found


def worst_input(which: Filter, ticks_per_frame: int, frames: int) -> Array:
    """Return the real signal of unit peak that comes nearest to max S, shape (frames * M,)."""
    M = ticks_per_frame
    _, w = largest_gain(which, M)
    weights = np.conj(_aliases(which, M, np.array(w)))
    angles = (w + 2.0 * pi * np.arange(M)) / M
    ticks = np.arange(frames * M)[:, None] - (M - 1)  # a frame's last tick is the one that is kept
    signal: Array = (weights * np.exp(1j * angles * ticks)).sum(axis=1).real
    unit: Array = signal / np.abs(signal).max()
    return unit


def swept_sine(rates: Rates, seconds: float, from_hz: float = 1.0) -> Array:
    """Return a sine of unit peak whose frequency grows exponentially from `from_hz` to half the device rate."""
    from scipy.signal import chirp  # type: ignore[import-untyped]  # half a second, for this signal only

    time = np.arange(round(seconds * rates.device_hz)) * rates.tick_s
    signal: Array = chirp(time, from_hz, seconds, 0.5 * rates.device_hz, method="logarithmic", phi=-90.0)
    return signal


@dataclass(frozen=True, slots=True)
class EnergyRun:
    """The energies of a run [J]: of all fast waves, of all slow ones, and their difference after each frame, (frames,)."""

    fast_j: float
    slow_j: float
    margin_j: Array

    @property
    def gain(self) -> float:
        """Slow energy over fast: at most max S."""
        return self.slow_j / self.fast_j if self.fast_j else 0.0


def run_energy(decimator: Decimator, signal: Array, rates: Rates) -> EnergyRun:
    """Pass a signal [sqrt(W)] of whole frames, tick by tick, through a decimator of one axis as the client does.

    Raises ValueError for a signal that is no whole number of frames.
    """
    M = rates.ticks_per_frame
    if not len(signal) or len(signal) % M:
        raise ValueError(f"signal of {len(signal)} ticks: give a whole number of frames of {M}, at least one")
    slow = []
    for frame in signal.reshape(-1, M).tolist():
        for wave in frame:
            decimator.push((wave,))
        slow.append(decimator.take()[0])
    fast_j = np.cumsum((signal.reshape(-1, M) ** 2).sum(axis=1)) * 0.5 * rates.tick_s
    slow_j = np.cumsum(np.square(slow)) * 0.5 * rates.frame_s
    return EnergyRun(float(fast_j[-1]), float(slow_j[-1]), fast_j - slow_j)


def _aliases(which: Filter, ticks_per_frame: int, angle: Array) -> Complex:
    """Return H at the M aliases of each slow angle, (..., M)."""
    M = ticks_per_frame
    if M < 1:
        raise ValueError(f"ticks_per_frame = {M} must be at least 1")
    return which.response((np.asarray(angle)[..., None] + 2.0 * pi * np.arange(M)) / M)
