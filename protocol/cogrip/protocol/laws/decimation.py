"""Decimation of M fast waves to one slow wave: anti-aliasing filter and downsampler (theory section 3.2).

A decimator gets one wave a device tick and gives one a frame. `boxcar` cannot create energy for any signal
(Cauchy-Schwarz: M mean^2 <= sum of squares) and keeps the integral; `lowpass` is P eq. 32, discretised exactly;
`none` keeps the last sample, the counter-example that aliasing creates energy.
"""

from collections.abc import Callable, Sequence
from math import exp, expm1

from cogrip.protocol.axes import PLACES, POSE_AXES

Wave = Sequence[float]
NOTHING = (0.0,) * POSE_AXES


class Decimator:
    """Base of all decimators."""

    __slots__ = ()

    def push(self, wave: Wave) -> None:
        """Add the forward wave of one tick, shape (axes,)."""
        raise NotImplementedError

    def take(self) -> tuple[float, ...]:
        """Return the wave of the frame that ends, shape (axes,)."""
        raise NotImplementedError


class Boxcar(Decimator):
    """Mean of the M fast waves of a frame."""

    __slots__ = ("_axes", "_scale", "_sum")

    def __init__(self, axes: int, ticks_per_frame: int) -> None:
        self._axes = axes
        self._sum = list(NOTHING)
        self._scale = 1.0 / ticks_per_frame

    def push(self, wave: Wave) -> None:
        total = self._sum
        if self._axes == PLACES:  # as below, without a loop
            x, y, z = wave
            total[0] += x
            total[1] += y
            total[2] += z
        else:
            for axis in range(self._axes):
                total[axis] += wave[axis]

    def take(self) -> tuple[float, ...]:
        scale, total = self._scale, self._sum
        mean = tuple([total[axis] * scale for axis in range(self._axes)])
        self._sum = list(NOTHING)
        return mean


class Lowpass(Decimator):
    """xf' = -w xf + u, y = w xf (P eq. 32), with the input held over a tick; the last sample is sent."""

    __slots__ = ("_gain", "_pole", "_state")

    def __init__(self, axes: int, cutoff_rad_s: float, tick_s: float) -> None:
        self._state = [0.0] * axes
        self._pole = exp(-cutoff_rad_s * tick_s)
        self._gain = 1.0 - self._pole

    def push(self, wave: Wave) -> None:
        state, pole, gain = self._state, self._pole, self._gain
        for axis, value in enumerate(wave):
            state[axis] = pole * state[axis] + gain * value

    def take(self) -> tuple[float, ...]:
        return tuple(self._state)


class LastSample(Decimator):
    """No filter: keep one wave of M."""

    __slots__ = ("_last",)

    def __init__(self, axes: int) -> None:
        self._last: tuple[float, ...] = (0.0,) * axes

    def push(self, wave: Wave) -> None:
        self._last = tuple(wave)

    def take(self) -> tuple[float, ...]:
        return self._last


_MAKERS: dict[str, Callable[[int, int, float, float], Decimator]] = {
    "boxcar": lambda axes, ticks, tick_s, cutoff: Boxcar(axes, ticks),
    "lowpass": lambda axes, ticks, tick_s, cutoff: Lowpass(axes, cutoff, tick_s),
    "none": lambda axes, ticks, tick_s, cutoff: LastSample(axes),
}
KINDS = tuple(_MAKERS)


def make_decimator(kind: str, axes: int, ticks_per_frame: int, tick_s: float, lowpass_rad_s: float) -> Decimator:
    """Return the decimator called `kind`. Raises KeyError for a kind that is not in KINDS (settings refuse it before)."""
    return _MAKERS[kind](axes, ticks_per_frame, tick_s, lowpass_rad_s)


def lag_s(kind: str, frame_s: float, lowpass_rad_s: float) -> float:
    """Return the time that the loop loses at rest to hold, decimator and frame [s]: the term T_n of theory section 4.

    For boxcar and no filter one frame; for the lowpass T_n / (1 - exp(-w T_n)), the sum of the step response's
    shortfall at the frame's end (24.160 ms at 50 rad/s and 128 Hz).
    """
    if kind == "lowpass":
        return frame_s / -expm1(-lowpass_rad_s * frame_s)
    return frame_s
