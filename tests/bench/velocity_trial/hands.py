"""Recorded hands as smooth motions on the grid of the device's ticks, with the velocity that an estimator should have found.

Each axis of each stretch of a recording is a motion by itself. It is put on its own mean rate by a monotone cubic, rid of what
is faster than hands by a zero-phase filter (Butterworth, order 4, forwards and back, at CUT_HZ or 0.3 of the rate), and read
off at the ticks with its derivative by a cubic spline: position and velocity belong together exactly.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator  # type: ignore[import-untyped]
from scipy.signal import butter, sosfiltfilt  # type: ignore[import-untyped]

from cogrip.analysis.linear.state_space import Array

CUT_HZ = 50.0
LEVER_M = 0.075  # of the TU Eindhoven pair: tip over angle
LONGEST_GAP_S = 0.1
SHORTEST_S = 1.0


class NoHandsError(FileNotFoundError):
    """There are no recorded hands where they were looked for."""


@dataclass(frozen=True, slots=True)
class Motion:
    """One axis of a recorded hand: position [m] and velocity [m/s] at each tick, shape (n,)."""

    name: str
    position_m: Array
    velocity_mps: Array


Columns = dict[str, list[str]]
Stretch = tuple[str, Array, Array]
"""Name, time [s] (n,), positions [m] (n, axes)."""


def _lever(columns: Columns) -> Iterator[Stretch]:
    runs = np.array(columns["run"])
    for run in dict.fromkeys(columns["run"]):
        rows = runs == run
        yield run, _numbers(columns, "t_s")[rows], LEVER_M * _numbers(columns, "theta_m_rad")[rows, None]


def _touch(columns: Columns) -> Iterator[Stretch]:
    place = 1e-3 * np.stack([_numbers(columns, f"p{axis}_mm") for axis in "xyz"], axis=1)
    yield "free", _numbers(columns, "t_s"), place


def _panda(columns: Columns) -> Iterator[Stretch]:
    """Samples are counted, not timed, and ticks are missing: while it moves, a step over the speed tells how long it took."""
    recordings = np.array(columns["rec"])
    place = np.stack([_numbers(columns, f"p{axis}_m") for axis in "xyz"], axis=1)
    speed = np.stack([_numbers(columns, f"v{axis}_m_s") for axis in "xyz"], axis=1)
    for name in dict.fromkeys(columns["rec"]):
        p, v = place[recordings == name], speed[recordings == name]
        v = 0.5 * (v[1:] + v[:-1])
        square = (v**2).sum(axis=1)
        moving = square > 0.03**2
        ticks = np.ones(len(v))
        ticks[moving] = np.clip(np.round((np.diff(p, axis=0) * v).sum(axis=1)[moving] / square[moving] * 1e3), 1, 20)
        yield f"recording {name}", np.concatenate(([0.0], np.cumsum(ticks) * 1e-3)), p


def _pen(columns: Columns) -> Iterator[Stretch]:
    """Yield the strokes: above the tablet the pen's position jumps."""
    down = _numbers(columns, "pen_down") > 0.0
    yield (
        "writing",
        _numbers(columns, "t_s")[down],
        1e-3 * np.stack([_numbers(columns, f"{axis}_mm") for axis in "xy"], axis=1)[down],
    )


FILES: dict[str, Callable[[Columns], Iterator[Stretch]]] = {
    "tue_1dof_PP_kp8.csv": _lever,
    "tue_1dof_PF_kp15.csv": _lever,
    "touch_freehand_wpi_100hz.csv": _touch,
    "panda_handguided_symbol17_rec0_2_4.csv": _panda,
    "pen_wacom_bdalab_133hz.csv": _pen,
}


def recorded_hands(folder: Path, rate_hz: int, names: Sequence[str] = tuple(FILES)) -> list[Motion]:
    """The motions of the files `names` in `folder`. Raises NoHandsError with the name of the first that is missing."""
    found = []
    for name in names:
        path = folder / name
        if not path.is_file():
            raise NoHandsError(f"{path} is not here; give the folder that holds {', '.join(names)}")
        with path.open(newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            table = list(rows)
        columns = {key: [row[key] for row in table] for key in table[0]}
        for what, time, place in FILES[name](columns):
            for cut in _without_gaps(time):
                found += [
                    resampled(f"{path.stem} {what} {axis}", time[cut], place[cut, axis], rate_hz)
                    for axis in range(place.shape[1])
                ]
    return found


def _numbers(columns: Columns, name: str) -> Array:
    return np.array(columns[name], dtype=float)


def _without_gaps(time: Array) -> Iterator[slice]:
    """Stretches without a gap, long enough to be of use."""
    ends = [0, *(np.flatnonzero(np.diff(time) > LONGEST_GAP_S) + 1).tolist(), len(time)]
    for begin, end in pairwise(ends):
        if end - begin > 1 and time[end - 1] - time[begin] >= SHORTEST_S:
            yield slice(begin, end)


def resampled(name: str, time_s: Array, position_m: Array, rate_hz: int) -> Motion:
    """A motion at `rate_hz`. time_s: shape (n,), rising; position_m: (n,)."""
    length = float(time_s[-1] - time_s[0])
    rate = (len(time_s) - 1) / length
    even = time_s[0] + np.arange(len(time_s)) / rate
    even[-1] = time_s[-1]
    curve: Any = PchipInterpolator(time_s, position_m)
    sections = butter(4, min(CUT_HZ, 0.3 * rate), fs=rate, output="sos")
    smooth: Any = CubicSpline(even, sosfiltfilt(sections, curve(even)))
    ticks = time_s[0] + np.arange(int(length * rate_hz)) / rate_hz
    return Motion(name, np.asarray(smooth(ticks), dtype=float), np.asarray(smooth(ticks, 1), dtype=float))
