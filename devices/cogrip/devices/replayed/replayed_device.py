"""A device that plays a motion, whatever the force.

The motion is a function of the tick, so it keeps the loop's absolute deadlines: it can neither drift nor run late.
"""

from collections.abc import Sequence
from math import inf, isfinite
from typing import Annotated, Any, Protocol

import msgspec
import numpy as np
from msgspec import Meta

from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.settings import NotNegative
from cogrip.devices.simulated.recorded_hand import minimum_jerk
from cogrip.devices.simulated.recorded_motion import NO_HANDLE, Array, HandleSample

MOST_SPEED = 10.0


class PlaySettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys of every replay.

    speed    of play-back
    start_s  where in the recording to begin
    stop_s   where to end; the hand then rests there, and `cogrip join` leaves
    loop     0: end there; 1: go back to the start in a second and play again
    """

    speed: Annotated[float, Meta(ge=0.01, le=MOST_SPEED)] = 1.0
    start_s: NotNegative = 0.0
    stop_s: Annotated[float, Meta(ge=0.0)] = inf
    loop: bool = False


class Source(Protocol):
    """Source of a recorded motion. Both methods raise DeviceError. handles: of its motion, once that was read."""

    @property
    def handles(self) -> Sequence[HandleSample]: ...

    def capability(self, axes: int) -> Capability:
        """The record of the device that moved so."""

    def motion(self, axes: int, rate_hz: int) -> tuple[int, Array, Array]:
        """(rate [Hz], position [m], velocity [m/s]), each (n, axes) or more; `rate_hz` is the rate that would suit best."""


class ReplayedDevice(Driver):
    """See `Device`. The recording is looked into when its capability is asked for, and read when it is opened."""

    def __init__(self, address: str, axes: int, source: Source, play: PlaySettings) -> None:
        super().__init__(address, axes)
        self._source = source
        self._play = play
        self._capability: Capability | None = None
        self._last = inf  # tick of the last sample
        self.force_n: tuple[float, ...] = self._zero

    @property
    def capability(self) -> Capability:
        """That of the device that was recorded. Raises DeviceError."""
        if self._capability is None:
            record = self._source.capability(self._axes)
            if record.axes < self._axes:
                raise DeviceError(f"{self._where!r} was recorded on {record.axes} axes, {self._axes} are asked for")
            self._capability = record.first(self._axes)
        return self._capability

    def open(self, rate_hz: int) -> None:
        self._check_open(rate_hz, self.capability)
        self._position, self._velocity = self._course(rate_hz)
        self._tick, self._open = 0, True
        self._last = inf if self._play.loop else len(self._position) - 1

    def _course(self, rate_hz: int) -> tuple[Array, Array]:
        """Position and velocity of every tick to come, shape (n, axes)."""
        play = self._play
        recorded_hz, position, velocity = self._source.motion(self._axes, rate_hz)
        first = play.start_s * recorded_hz
        last = min(float(len(position) - 1), play.stop_s * recorded_hz)
        if first >= last:
            raise self._error(
                f"from {play.start_s:g} s to {min(play.stop_s, len(position) / recorded_hz):g} s there is "
                f"nothing to play; the recording is {len(position) / recorded_hz:.3f} s long"
            )
        ticks = np.arange(first, last + 1e-9, play.speed * recorded_hz / rate_hz)
        grid = np.arange(len(position))
        handles = self._source.handles
        self._handles = [handles[int(tick)] for tick in ticks] if handles else []
        course = np.stack([np.interp(ticks, grid, axis) for axis in position[:, : self._axes].T], axis=1)
        speeds = np.stack([np.interp(ticks, grid, axis) for axis in velocity[:, : self._axes].T], axis=1) * play.speed
        if play.loop:
            back = minimum_jerk(course[-1], course[0], rate_hz)
            return np.vstack((course, back[0])), np.vstack((speeds, back[1]))
        return np.vstack((course, course[-1])), np.vstack((speeds, np.zeros((1, self._axes))))  # and rests there

    @property
    def played_out(self) -> bool:
        """Return whether the last sample was read: nothing but rest follows."""
        return self._tick >= self._last

    def read(self, tick: int) -> Sample:
        self._check_read(tick)
        rows = len(self._position)
        row = tick % rows if self._play.loop else min(tick, rows - 1)
        velocity = tuple(self._velocity[row].tolist()) if self.capability.gives_velocity else None
        handle: Any = self._handles[row] if row < len(self._handles) else NO_HANDLE
        return Sample(tuple(self._position[row].tolist()), velocity, 0, *handle)

    def write(self, force_n: Sequence[float]) -> None:
        self._need_open("write")
        if len(force_n) != self._axes or not all(isfinite(force) for force in force_n):
            raise self._wrong_force(force_n)
        self.force_n = tuple(force_n)

    def close(self) -> None:
        self.force_n = self._zero
        self._open = False
