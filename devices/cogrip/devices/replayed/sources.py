"""Where replayed motions come from: recorded runs and tables."""

from __future__ import annotations

from math import inf
from typing import Literal

import msgspec
import numpy as np

from cogrip.devices.device import Capability
from cogrip.devices.recorded_motion import Array, capability_of, find, read_motion
from cogrip.devices.replayed.device import PlaySettings
from cogrip.devices.settings import Finite, Positive, keys_of
from cogrip.devices.simulated.recorded_hand import RecordedSettings, read_recording


class RunSettings(PlaySettings, frozen=True, kw_only=True):
    """Query keys of a recorded run. user: name, or number of the seat."""

    user: str = "0"


class TableSettings(PlaySettings, frozen=True, kw_only=True):
    """Query keys of a CSV file: as those of the hand `csv`."""

    time: str
    x: str
    y: str | None = None
    z: str | None = None
    scale: Finite = 1.0
    time_scale: Positive = 1.0
    where: str | None = None
    origin: Literal["start", "keep"] = "start"


class RunSource:
    """A person of a recorded run."""

    def __init__(self, path: str, user: str) -> None:
        self._path, self._user = path, user

    def capability(self, axes: int) -> Capability:
        return capability_of(find(self._path, self._user))

    def motion(self, axes: int, rate_hz: int) -> tuple[int, Array, Array]:
        motion = read_motion(find(self._path, self._user))
        return motion.rate_hz, motion.position_m, motion.velocity_mps


class TableSource:
    """A CSV file: no device is known, so its record has no limits of its own."""

    def __init__(self, path: str, settings: TableSettings) -> None:
        self._path = path
        own = {
            key: value for key, value in msgspec.structs.asdict(settings).items() if key in keys_of(RecordedSettings)
        }
        self._settings = RecordedSettings(**{key: own[key] for key in own if key not in keys_of(PlaySettings)})

    def capability(self, axes: int) -> Capability:
        _, position, _ = self.motion(axes, 1024)
        room = float(np.abs(position).max()) + 0.5
        return Capability(
            family="replay", model="csv", axes=axes, workspace_m=((-room, room),) * axes, peak_force_n=50.0,
            continuous_force_n=50.0, stiffness_npm=inf, damping_nspm=inf, slew_nps=inf, speed_mps=inf, resolution_m=0.0,
            apparent_mass_kg=0.1, rate_hz=8192, gives_velocity=True,
        )  # fmt: skip

    def motion(self, axes: int, rate_hz: int) -> tuple[int, Array, Array]:
        recording = read_recording(self._path, self._settings, axes)
        position, velocity = recording.at(np.arange(int(np.ceil(recording.time_s[-1] * rate_hz - 1e-9)) + 1) / rate_hz)
        if self._settings.origin == "start":
            position = position - position[0]
        return rate_hz, position, velocity
