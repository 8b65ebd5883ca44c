"""A recorded person's own effort behind an impedance: `hand=recording:RUN#user=1`.

What the hand must have exerted is known from the record, up to the inertia of the arm: with the impedance K_h, B_h it
was driven by K_h x + B_h v + F, where x, v and the device's force F are the recorded ones. The same drive meets
another force now, and the hand gives way as its impedance lets it. In the same world it moves as it did.
"""

from __future__ import annotations

from collections.abc import Sequence

from cogrip.devices.device import DeviceError
from cogrip.devices.recorded_motion import find, read_motion, split_user
from cogrip.devices.simulated.hands import ImpedanceSettings, Vector


class RelivedHand:
    """See `Hand`. Before the recording and after it the hand rests."""

    def __init__(self, settings: ImpedanceSettings, axes: int, run: str) -> None:
        self.stiffness_npm = settings.hand_stiffness_npm
        self.damping_nspm = settings.hand_damping_nspm
        self._axes = axes
        self._run = run

    def open(self, rate_hz: int, home_m: Vector | None) -> Vector:
        """See `Hand.open`; the start is the recorded one. Raises DeviceError."""
        path, user = split_user(self._run)
        motion = read_motion(find(path, user))
        if motion.position_m.shape[1] < self._axes:
            recorded = motion.position_m.shape[1]
            raise DeviceError(f"hand=recording:{self._run} was recorded on {recorded} axes, {self._axes} are asked for")
        if motion.rate_hz != rate_hz:
            raise DeviceError(
                f"hand=recording:{self._run} was recorded at {motion.rate_hz} Hz; set rates.device_hz to that, not {rate_hz}"
            )
        self._position, self._velocity = motion.position_m[:, : self._axes], motion.velocity_mps[:, : self._axes]
        force = motion.force_n[:, : self._axes]
        self._drive = self.stiffness_npm * self._position + self.damping_nspm * self._velocity + force
        self._drive[-1] = self.stiffness_npm * self._position[-1]
        self._last = len(self._drive) - 1
        return tuple(self._position[0].tolist())

    def intended(self, tick: int) -> tuple[Vector, Vector]:
        """See `Hand.intended`: the recorded motion."""
        row = min(tick, self._last)
        return tuple(self._position[row].tolist()), tuple(self._velocity[row].tolist())

    def drive(self, tick: int) -> Sequence[float]:
        """See `Hand.drive`."""
        drive: list[float] = self._drive[min(tick, self._last)].tolist()
        return drive


def make_relived(settings: ImpedanceSettings, axes: int, run: str) -> RelivedHand:
    """The hand of a recorded person; the recording is read when the device is opened."""
    return RelivedHand(settings, axes, run)
