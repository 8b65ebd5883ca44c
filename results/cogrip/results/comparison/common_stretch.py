"""Runs of different lengths side by side: the stretch that all of them have, and the numbers of a run over it.

Totals and extremes grow with a run's length, so those of a run that was cut short say nothing beside those of a whole one.
Over a part of a run its recordings tell the path, the largest force, the margins and the frames lost; the rest of a
summary is of the whole run and is left out.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES
from cogrip.results.reading.summary_values import Summary, dig, is_number
from cogrip.results.reading.traces import Columns, EndTrace, TracedRun

SAME_LENGTH = 0.01
"""Relative difference of two lengths below which they are the same: it moves a total by no more than that."""


def common_stretch_s(runs: Sequence[TracedRun]) -> float | None:
    """Return the length of the shortest run [s]; None where all are as long as each other, or a length is not known."""
    known = [length for run in runs if (length := length_s(run)) is not None]
    if len(known) < len(runs) or max(known) - min(known) <= SAME_LENGTH * max(known):
        return None
    return min(known)


def length_s(run: TracedRun) -> float | None:
    """Return the time from the first tick of any client to the end of the last one [s]; without ticks, that of the summary."""
    traces = list(run.clients.values()) or ([run.room] if run.room else [])
    if traces:
        end_s = max(float(trace.time_s[-1]) + 1.0 / trace.rate_hz for trace in traces)
        return end_s - _start_s(run)
    seconds = dig(run.summary, "seconds")
    return float(seconds) if is_number(seconds) else None


def _start_s(run: TracedRun) -> float:
    return min(float(trace.time_s[0]) for trace in run.clients.values() or ([run.room] if run.room else []))


def summary_of_first(run: TracedRun, seconds: float) -> Summary:
    """Return what the recordings tell of the first `seconds` of a run, in a summary's keys; `seconds` is its length."""
    until_s = _start_s(run) + seconds if run.clients or run.room else 0.0
    room, rows = run.room, slice(0)
    if room is not None:
        rows = slice(int(np.searchsorted(room.time_s, until_s)))
    return {
        "seconds": length_s(run),
        "object": {"travel_m": _path_m(room.columns["object_m"][rows]) if room else None},
        "users": [_person(run, seat, name, until_s, rows) for seat, name in enumerate(run.names)],
    }


def _person(run: TracedRun, seat: int, name: str, until_s: float, rows: slice) -> dict[str, Any]:
    trace, room = run.clients.get(name), run.room
    found: dict[str, Any] = {"name": name}
    energy: dict[str, float | None] = {}
    lost: list[float | None] = [None, None]
    if trace is not None:
        ticks = slice(int(np.searchsorted(trace.time_s, until_s)))
        forces = np.linalg.norm(trace.columns["force_n"][ticks, :PLACES], axis=1)
        found["peak_force_n"] = float(forces.max()) if len(forces) else None
        found["travel_m"] = _path_m(trace.columns["position_m"][ticks][:: _ticks_per_frame(run, trace)])
        energy["down_margin_j"] = _least(trace.columns, "margin_j", ticks)
        lost[0] = _last(trace.columns, "lost", ticks)
    if room is not None:
        energy |= {key: _least(room.columns, f"{seat}.{key}", rows) for key in ("up_margin_j", "line_margin_j")}
        lost[1] = _last(room.columns, f"{seat}.lost", rows)
    both = [each for each in lost if each is not None]
    return {**found, "energy": energy, "link": {"lost": add_floats(both) if len(both) == len(lost) else None}}


def _ticks_per_frame(run: TracedRun, trace: EndTrace) -> int:
    """Return M: a client's account sums its path from frame to frame."""
    network_hz = run.room.rate_hz if run.room else dig(run.settings, "rates", "network_hz")
    return max(1, round(trace.rate_hz / network_hz)) if is_number(network_hz) and network_hz > 0 else 1


def _path_m(places_m: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(places_m[:, :PLACES], axis=0), axis=1).sum())


def _least(columns: Columns, name: str, rows: slice) -> float | None:
    values = columns[name][rows] if name in columns else np.empty(0)
    known = values[np.isfinite(values)]
    return float(known.min()) if len(known) else None


def _last(columns: Columns, name: str, rows: slice) -> float | None:
    values = columns[name][rows] if name in columns else np.empty(0)
    return float(values[-1]) if len(values) and np.isfinite(values[-1]) else None
