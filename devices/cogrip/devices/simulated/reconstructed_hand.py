"""A recorded person's own effort behind an impedance: `hand=recording:RUN#user=1`.

What the hand must have exerted is known from the record: with the impedance K_h, B_h it was driven by
m x'' + B_h x' + K_h x + F, where the motion x, the device's mass m and its force F are the recorded ones.
The same drive meets another force now, and the hand gives way as its impedance lets it. In the same world it moves as it
did. The acceleration is that of a cubic through SMOOTH_S of positions (Savitzky and Golay 1964): encoders have none.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.devices.device import DeviceError
from cogrip.devices.simulated.hands import ImpedanceSettings
from cogrip.devices.simulated.recorded_motion import Array, capability_of, find, read_motion, split_user
from cogrip.machine.rows import Row

SMOOTH_S = 0.03


class ReconstructedHand:
    """See `Hand`. Before the recording and after it the hand rests."""

    def __init__(self, settings: ImpedanceSettings, axes: int, run: str) -> None:
        self.stiffness_npm = settings.hand_stiffness_npm
        self.damping_nspm = settings.hand_damping_nspm
        self._axes = axes
        self._run = run

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`; the start is the recorded one. Raises DeviceError."""
        path, user = split_user(self._run)
        recording = find(path, user)
        motion = read_motion(recording)
        if motion.position_m.shape[1] < self._axes:
            recorded = motion.position_m.shape[1]
            raise DeviceError(f"hand=recording:{self._run} was recorded on {recorded} axes, {self._axes} are asked for")
        if motion.rate_hz != rate_hz:
            raise DeviceError(
                f"hand=recording:{self._run} was recorded at {motion.rate_hz} Hz; set rates.device_hz to that, not {rate_hz}"
            )
        self._position, self._velocity = motion.position_m[:, : self._axes], motion.velocity_mps[:, : self._axes]
        force = motion.force_n[:, : self._axes]
        inertia = capability_of(recording).apparent_mass_kg * _acceleration(self._position, rate_hz)
        drive = self.stiffness_npm * self._position + self.damping_nspm * self._velocity + force + inertia
        self._drive = np.vstack((drive, self.stiffness_npm * self._position[-1]))
        self._last = len(self._drive) - 1
        return tuple(self._position[0].tolist())

    def intended(self, tick: int) -> tuple[Row, Row]:
        """See `Hand.intended`: the recorded motion."""
        row = min(tick, self._last - 1)
        return tuple(self._position[row].tolist()), tuple(self._velocity[row].tolist())

    def drive(self, tick: int) -> Sequence[float]:
        drive: list[float] = self._drive[min(tick, self._last)].tolist()
        return drive


def _acceleration(position_m: Array, rate_hz: int) -> Array:
    """x'' [m/s^2], shape as `position_m`; 0 for a motion shorter than the window."""
    window = 2 * round(SMOOTH_S * rate_hz / 2) + 1
    if len(position_m) < window:
        return np.zeros_like(position_m)
    from scipy.signal import savgol_filter  # type: ignore[import-untyped]  # half a second, for these hands only

    smooth: Array = savgol_filter(position_m, window, 3, deriv=2, delta=1.0 / rate_hz, axis=0)
    return smooth
