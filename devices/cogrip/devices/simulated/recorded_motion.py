"""A person's motion out of a recording: positions, velocities and forces on the grid of the device ticks."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from cogrip.devices.device import Capability, DeviceError
from cogrip.devices.simulated.recorded_hand import MOST_S
from cogrip.protocol.recording.folder import find_client
from cogrip.protocol.recording.reader import Recording, RecordingError
from cogrip.protocol.recording.records import Row, Tick, kind_of

Array: TypeAlias = NDArray[np.float64]


HandleSample: TypeAlias = tuple[int, tuple[float, ...] | None, float | None]
NO_HANDLE: HandleSample = (0, None, None)


@dataclass(frozen=True, slots=True)
class Motion:
    """Tick by tick from the first sample on, ticks without one filled in on a straight line.

    position_m, velocity_mps, force_n  shape (n, axes)
    handles                            buttons, orientation and grip at each tick; () of a device that has none of them
    """

    rate_hz: int
    position_m: Array
    velocity_mps: Array
    force_n: Array
    handles: Sequence[HandleSample] = ()

    def at(self, ticks: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and force at these fractional ticks (k,), held outside; each (k, axes)."""
        grid = np.arange(len(self.position_m))
        columns = [
            np.stack([np.interp(ticks, grid, axis) for axis in values.T], axis=1)
            for values in (self.position_m, self.velocity_mps, self.force_n)
        ]
        return columns[0], columns[1], columns[2]


def split_user(text: str) -> tuple[str, str]:
    """`RUN#user=1` as run and user; without one the user is 0."""
    path, _, user = text.partition("#user=")
    return path, user or "0"


def find(path: str, user: str) -> Recording:
    """The recording. Raises DeviceError."""
    try:
        return find_client(Path(path), user)
    except RecordingError as error:
        raise DeviceError(f"replay: {error}") from None


def capability_of(recording: Recording) -> Capability:
    """The record of the device that was recorded, on the axes that were. Raises DeviceError."""
    try:
        record = Capability.recorded(json.loads(recording.header.start)["capability"])
        return record.first(axes_of(recording))
    except (KeyError, ValueError) as error:
        raise DeviceError(f"replay: {recording.path} does not say what device was recorded: {error}") from None


def _ticks(recording: Recording) -> Iterator[Tick]:
    """A client's ticks. Raises DeviceError where the file cannot be read."""
    topic = next(number for number, name in enumerate(recording.topics) if kind_of(name) == "tick")
    decode = msgspec.json.Decoder(Tick).decode
    try:
        for message in recording.messages():
            if message.topic == topic:
                yield decode(message.payload)
    except (OSError, msgspec.MsgspecError) as error:
        raise DeviceError(f"replay: {recording.path} cannot be read: {error}") from None


def axes_of(recording: Recording) -> int:
    """Return the number of recorded axes: the room's, where the device had more. Raises DeviceError."""
    for tick in _ticks(recording):
        return len(tick.force_n)
    raise DeviceError(f"replay: {recording.path} holds no ticks")


def read_motion(recording: Recording) -> Motion:
    """Read a client's ticks. Raises DeviceError where fewer than two samples are there."""
    numbers: list[int] = []
    rows: list[tuple[Row, Row, Row]] = []
    read: list[HandleSample] = []
    for tick in _ticks(recording):
        if tick.position_m is not None:
            numbers.append(tick.tick)
            rows.append((tick.position_m, tick.velocity_mps, tick.force_n))
            read.append((tick.buttons, _known(tick.orientation), tick.grip_m))
    if len(rows) < 2:
        raise DeviceError(f"replay: {recording.path} holds {len(rows)} samples; a motion needs at least 2")
    most = round(MOST_S * recording.header.rate_hz)
    if numbers[-1] - numbers[0] > most or any(later <= tick for tick, later in pairwise(numbers)):
        raise DeviceError(
            f"replay: {recording.path}: its ticks go from {numbers[0]} to {numbers[-1]}; they have to rise, by {most} at most "
            f"({MOST_S:g} s)"
        )
    table = np.array(rows, dtype=float)  # (n, 3, axes)
    known = np.array(numbers) - numbers[0]
    grid = np.arange(known[-1] + 1)
    whole = np.stack(
        [np.stack([np.interp(grid, known, axis) for axis in table[:, part].T], axis=1) for part in range(3)]
    )
    handles = [read[row] for row in np.searchsorted(known, grid, side="right") - 1] if set(read) != {NO_HANDLE} else ()
    return Motion(recording.header.rate_hz, whole[0], whole[1], whole[2], handles)


def _known(turned: Row | None) -> tuple[float, ...] | None:
    """Return an orientation whose numbers are all there."""
    return None if turned is None or None in turned else turned  # type: ignore[return-value]
