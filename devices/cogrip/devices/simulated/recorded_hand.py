"""A recorded hand as the intended motion: `hand=csv:FILE&time=t_s&x=theta_m_rad&scale=0.075&where=run:spring`.

Between samples the motion is the monotone cubic through them (PCHIP, Fritsch and Carlson 1980): it passes through
every sample and overshoots none, whatever the gaps. Positions, velocities and the drive are computed for every tick at
`open`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cogrip.devices.device import DeviceError
from cogrip.devices.settings import unknown
from cogrip.devices.simulated.csv_table import METRES, SECONDS, CsvRows, read_table
from cogrip.devices.simulated.recorded_settings import RecordedSettings
from cogrip.machine.rows import Row

Array: TypeAlias = NDArray[np.float64]

RETURN_S = 1.0
"""With loop=1: the time from the last position back to the first, by minimum jerk, so that no seam kicks."""

MOST_S = 14_400.0  # longest recorded motion: every tick of it is worked out before it begins


@dataclass(frozen=True, slots=True)
class HandRecording:
    """time_s [s], shape (n,), from 0, strictly rising; position_m [m], shape (n, axes), as recorded."""

    time_s: Array
    position_m: Array

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] at `time_s` (k,), each (k, axes); held, at rest, outside the recording."""
        from scipy.interpolate import PchipInterpolator  # type: ignore[import-untyped]  # half a second, for these hands only

        curve: Any = PchipInterpolator(self.time_s, self.position_m, axis=0)
        inside = np.clip(time_s, 0.0, self.time_s[-1])
        velocity = np.where((inside == time_s)[:, None], curve(inside, 1), 0.0)
        return curve(inside), velocity


class RecordedHand:
    """An impedance whose intended motion is a recording."""

    def __init__(self, settings: RecordedSettings, axes: int, path: str) -> None:
        """Raises DeviceError when a column is given for an axis that the device has not."""
        self.stiffness_npm = settings.hand_stiffness_npm
        self.damping_nspm = settings.hand_damping_nspm
        self._settings = settings
        self._path = path
        self._axes = axes
        for axis, column in enumerate((settings.x, settings.y, settings.z)):
            if column is not None and axis >= axes:
                raise DeviceError(f"csv hand: {'xyz'[axis]}={column!r} needs {axis + 1} axes, the device has {axes}")

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`. Reads the file; raises DeviceError as `read_recording`."""
        s = self._settings
        recording = read_recording(self._path, s, self._axes)
        ticks = int(np.ceil(recording.time_s[-1] * rate_hz - 1e-9)) + 1
        position, velocity = recording.at(np.arange(ticks) / rate_hz)
        velocity[-1] = 0.0
        if s.origin == "start":
            position += np.asarray(home_m or (0.0,) * self._axes) - position[0]
        if s.loop:
            back = minimum_jerk(position[-1], position[0], rate_hz)
            position, velocity = np.vstack((position, back[0])), np.vstack((velocity, back[1]))
        self._position, self._velocity = position, velocity
        self._drive = self.stiffness_npm * position + self.damping_nspm * velocity
        self._rest = self.stiffness_npm * position[0]
        self._start = round(s.start_s * rate_hz)
        self._last = len(position) - 1
        return home_m or tuple(position[0].tolist())

    def intended(self, tick: int) -> tuple[Row, Row]:
        row = self._row(tick)
        velocity = self._velocity[row] if tick >= self._start else np.zeros(self._axes)
        return tuple(self._position[row].tolist()), tuple(velocity.tolist())

    def drive(self, tick: int) -> Sequence[float]:
        drive: list[float] = (self._drive[self._row(tick)] if tick >= self._start else self._rest).tolist()
        return drive

    def _row(self, tick: int) -> int:
        k = tick - self._start
        if k < 0:
            return 0
        if k <= self._last:
            return k
        return k % (self._last + 1) if self._settings.loop else self._last


def read_recording(path: str, settings: RecordedSettings, axes: int) -> HandRecording:
    """Read the columns `settings` names; rows are counted as lines of the file. Of rows with one time and one place one counts.

    Raises DeviceError: file cannot be read, column missing (with the nearest name and the list), unit unknown, cell not a
    finite number, time not rising, no row left by `where`, fewer than two rows.
    """
    table = read_table(path, (settings.time, settings.x))
    time_scale, lines, times, columns = _read_rows(table, settings)
    again = [
        times[row] == times[row - 1] and all(column[row] == column[row - 1] for _, column in columns.values())
        for row in range(1, len(lines))
    ]
    kept = [0, *(row for row, repeated in enumerate(again, 1) if not repeated)] if lines else []
    lines, times = [lines[row] for row in kept], [times[row] for row in kept]
    columns = {axis: (scale, [column[row] for row in kept]) for axis, (scale, column) in columns.items()}
    if len(lines) < 2:
        raise DeviceError(f"csv hand: {path!r} has {len(lines)} usable row; a motion needs at least 2")
    time = np.asarray(times)
    falls = np.flatnonzero(np.diff(time) <= 0.0)
    if falls.size:
        k = int(falls[0])
        at = f"csv hand: {path!r} line {lines[k + 1]}: {settings.time}={times[k + 1]!r}"
        if times[k + 1] == times[k]:
            raise DeviceError(
                f"{at} stands in line {lines[k]} too, with another place; if the recorder's clock is coarse, keep one row of"
                " each time, or their mean"
            )
        raise DeviceError(
            f"{at} is not after {times[k]!r}; if the file holds several recordings, keep one by a row filter,"
            " where=column:value"
        )
    length_s = time_scale * (float(time[-1]) - float(time[0]))
    if not length_s <= MOST_S:
        raise DeviceError(
            f"csv hand: {path!r} is {length_s:g} s long, and {MOST_S:g} s is the most; if its times are in other units than s, "
            "say so by time_scale"
        )
    position = np.zeros((len(time), axes))
    for axis, (scale, column) in columns.items():
        position[:, axis] = scale * np.asarray(column)
    return HandRecording(time_scale * (time - time[0]), position)


def _read_rows(
    table: CsvRows, settings: RecordedSettings
) -> tuple[float, list[int], list[float], dict[int, tuple[float, list[float]]]]:
    """Seconds per unit of time, line numbers, times and axis -> (metres per unit, positions), as they stand in the file."""
    wanted = {axis: name for axis, name in enumerate((settings.x, settings.y, settings.z)) if name is not None}
    time = table.find(settings.time, "time")
    found = {axis: table.find(name, "xyz"[axis]) for axis, name in wanted.items()}
    time_scale = table.scale(time, SECONDS, settings.time_scale, "time_scale")
    scales = {axis: table.scale(at, METRES, settings.scale, "scale") for axis, at in found.items()}
    lines, chosen = _choose(table, settings.where)
    positions = {axis: (scales[axis], table.numbers(chosen, lines, at)) for axis, at in found.items()}
    return time_scale, lines, table.numbers(chosen, lines, time), positions


def _choose(table: CsvRows, where: str | None) -> tuple[list[int], list[list[str]]]:
    """Line numbers and rows that `where` keeps."""
    kept = table.rows
    if where is not None:
        column, colon, value = where.partition(":")
        if not colon:
            raise DeviceError(f"csv hand: where={where!r} is not column:value")
        at = table.find(column, "where")
        kept = [(line, row) for line, row in table.rows if len(row) > at and row[at].strip() == value]
        if not kept:
            there = sorted({row[at].strip() for _, row in table.rows if len(row) > at})
            raise unknown(
                f"value of column {column!r}",
                value,
                there[:20],
                f"csv hand: {table.path!r}: where={where} keeps no row",
            )
    return [line for line, _ in kept], [row for _, row in kept]


def minimum_jerk(start: Array, end: Array, rate_hz: int) -> tuple[Array, Array]:
    """Positions and velocities of the ticks strictly between `start` and `end`, RETURN_S apart."""
    ticks = max(1, round(RETURN_S * rate_hz))
    z = (np.arange(1, ticks) / ticks)[:, None]
    position = start + (end - start) * z**3 * (10.0 - 15.0 * z + 6.0 * z * z)
    velocity = (end - start) * (30.0 * rate_hz / ticks) * z * z * (1.0 - z) ** 2
    return position, velocity
