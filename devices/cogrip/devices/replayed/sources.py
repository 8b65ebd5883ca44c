"""Sources of replayed motions: recorded runs and tables."""

from collections.abc import Sequence

import msgspec
import numpy as np

from cogrip.devices.device import IDEAL_DAMPING_NSPM, IDEAL_SPEED_MPS, IDEAL_STIFFNESS_NPM, SLEW_NPS, Capability
from cogrip.devices.replayed.replayed_device import PlaySettings
from cogrip.devices.settings import keys_of
from cogrip.devices.simulated.hands import ImpedanceSettings
from cogrip.devices.simulated.recorded_hand import read_recording
from cogrip.devices.simulated.recorded_motion import Array, HandleSample, capability_of, find, read_motion
from cogrip.devices.simulated.recorded_settings import RecordedSettings


class RunSettings(PlaySettings, frozen=True, kw_only=True):
    """Query keys of a recorded run. user: name, or number of the seat."""

    user: str = "0"


_OTHERS = (*keys_of(ImpedanceSettings), *keys_of(PlaySettings))
_COLUMNS = tuple(field for field in msgspec.structs.fields(RecordedSettings) if field.name not in _OTHERS)
"""Keys of the hand `csv` that say where the motion stands in the file: neither of the hand's own nor of when it plays."""

TableSettings = msgspec.defstruct(
    "TableSettings",
    [(field.name, field.type, field.default) for field in _COLUMNS],
    bases=(PlaySettings,),
    module=__name__,
    frozen=True,
    kw_only=True,
)
"""Query keys of a CSV file: those of every replay, then `_COLUMNS`. Made, not written: two records cannot both be bases."""


class RunSource:
    """A person of a recorded run."""

    def __init__(self, path: str, user: str) -> None:
        self._path, self._user = path, user
        self.handles: Sequence[HandleSample] = ()

    def capability(self, axes: int) -> Capability:
        return capability_of(find(self._path, self._user))

    def motion(self, axes: int, rate_hz: int) -> tuple[int, Array, Array]:
        motion = read_motion(find(self._path, self._user))
        self.handles = motion.handles
        return motion.rate_hz, motion.position_m, motion.velocity_mps


class TableSource:
    """A CSV file: no device is known, so its record is that of a machine that anything can be tried on."""

    handles: Sequence[HandleSample] = ()

    def __init__(self, path: str, settings: PlaySettings) -> None:
        """`settings` is a TableSettings."""
        self._path = path
        self._settings = RecordedSettings(**{field.name: getattr(settings, field.name) for field in _COLUMNS})

    def capability(self, axes: int) -> Capability:
        _, position, _ = self.motion(axes, 1024)
        room = float(np.abs(position).max()) + 0.5
        return Capability(
            family="replay", model="csv", axes=axes, workspace_m=((-room, room),) * axes, peak_force_n=50.0,
            continuous_force_n=50.0, stiffness_npm=IDEAL_STIFFNESS_NPM, damping_nspm=IDEAL_DAMPING_NSPM, slew_nps=SLEW_NPS,
            speed_mps=IDEAL_SPEED_MPS, resolution_m=0.0, apparent_mass_kg=0.1, rate_hz=8192, gives_velocity=True,
        )  # fmt: skip

    def motion(self, axes: int, rate_hz: int) -> tuple[int, Array, Array]:
        recording = read_recording(self._path, self._settings, axes)
        position, velocity = recording.at(np.arange(int(np.ceil(recording.time_s[-1] * rate_hz - 1e-9)) + 1) / rate_hz)
        if self._settings.origin == "start":
            position = position - position[0]
        return rate_hz, position, velocity
