"""What a run folder holds, as numpy columns in time order: recordings, summary, settings, and what is missing of them.

A recording is read once, into a temporary file for each column; a column is read when it is asked for. So half an hour
of many people stays on the disk.
"""

import json
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogrip.client.safety import STATES
from cogrip.protocol.messages import all_shown
from cogrip.protocol.recording.reader import Damage, RecordingError
from cogrip.server.recorder import step_topic
from cogrip.sim.runs.folder import SERVER_RECORDING, SETTINGS, SUMMARY, client_recording
from cogrip.sim.runs.records import End, RunRecords, open_run

Array = NDArray[np.float64]
MOST_PEOPLE = 16  # that a plot shows: more are not told apart
_STATE_NUMBER = {state: float(number) for number, state in enumerate(STATES)}
_TICK_SCALARS = ("tick", "late_us", "work_us", "skipped", "rtt_ms", "up_ms", "down_ms", "lost", "work_j", "port_j")
_TICK_VECTORS = ("position_m", "velocity_mps", "force_n", "wave_up", "wave_down", "object_m")
_STEP_SCALARS = ("step", "late_us", "work_us", "skipped")
_SEAT_SCALARS = ("seated", "up_margin_j", "line_margin_j", "up_used_j", "down_made_j", "lost")
_SEAT_RESERVES = ("up_reserve_j", "line_reserve_j")
_SEAT_VECTORS = ("proxy_m", "force_n")


class Columns(Mapping[str, Array]):
    """Column name to its values, oldest first, shape (rows,), a copy. Each look-up reads the disk."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="cogrip-columns-"))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._files: dict[str, Path] = {}

    def extend(self, columns: Mapping[str, Sequence[float] | Array]) -> None:
        """More rows, the same columns every time."""
        for name, values in columns.items():
            path = self._files.setdefault(name, self._folder / f"{len(self._files)}.f64")
            with path.open("ab") as file:
                np.asarray(values, dtype=np.float64).tofile(file)

    def __getitem__(self, name: str) -> Array:
        return np.fromfile(self._files[name], dtype=np.float64)

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


@dataclass
class Trace:
    """One end of a run."""

    who: str
    rate_hz: int
    columns: Columns
    rows: int

    def vector(self, name: str) -> Array:
        """`position_m.0`, `position_m.1` ... side by side, shape (rows, axes). KeyError without the first."""
        parts = [self.columns[f"{name}.0"]]
        while f"{name}.{len(parts)}" in self.columns:
            parts.append(self.columns[f"{name}.{len(parts)}"])
        return np.stack(parts, axis=1)

    @cached_property
    def time_s(self) -> Array:
        """Seconds on the run's clock."""
        return self.columns["time_s"]


def tick_trace(end: End) -> Trace:
    """A client's ticks."""
    columns, rows = Columns(), 0
    for times, ticks in end.chunks("tick"):
        rows += len(ticks)
        axes = len(ticks[0].force_n)
        table: dict[str, Any] = {"time_s": times, "state": [_STATE_NUMBER[tick.state] for tick in ticks]}
        for name in _TICK_SCALARS:
            table[name] = [getattr(tick, name) for tick in ticks]
        table["leak_j"] = np.array(table["work_j"], dtype=float) - np.array(table["port_j"], dtype=float)
        table["down_margin_j"] = [tick.margin_j or 0.0 for tick in ticks]
        table["down_reserve_j"] = [tick.reserve_j for tick in ticks]  # not a number in recordings of older versions
        table["device_reserve_j"] = [tick.device_reserve_j for tick in ticks]
        for name in _TICK_VECTORS:
            _spread(table, name, [getattr(tick, name) for tick in ticks], axes)
        columns.extend(table)
    return Trace(end.who, end.rate_hz, columns, rows)


def step_trace(end: End, room: str) -> Trace:
    """A room's steps; columns of a seat begin with its number (`0.proxy_m.0`)."""
    columns, rows = Columns(), 0
    for times, steps in end.chunks(step_topic(room)):
        rows += len(steps)
        axes = len(steps[0].object_m)
        table: dict[str, Any] = {"time_s": times}
        for name in _STEP_SCALARS:
            table[name] = [getattr(step, name) for step in steps]
        for name in ("object_m", "object_mps"):
            _spread(table, name, [getattr(step, name) for step in steps], axes)
        for number in range(len(steps[0].seats)):
            seats = [step.seats[number] for step in steps]
            for name in _SEAT_SCALARS:
                table[f"{number}.{name}"] = [getattr(seat, name) or 0.0 for seat in seats]
            for name in _SEAT_RESERVES:
                table[f"{number}.{name}"] = [getattr(seat, name) for seat in seats]
            for name in _SEAT_VECTORS:
                _spread(table, f"{number}.{name}", [getattr(seat, name) for seat in seats], axes)
        columns.extend(table)
    return Trace(room, end.rate_hz, columns, rows)


def _spread(table: dict[str, Any], name: str, rows: Sequence[Sequence[float | None] | None], axes: int) -> None:
    missing = (np.nan,) * axes
    values = np.array([missing if row is None else row for row in rows], dtype=float)
    for axis in range(axes):
        table[f"{name}.{axis}"] = values[:, axis]


@dataclass(frozen=True)
class Run:
    """One run folder. Seat n of the room is names[n]; `clients` has those whose recording is there; `notes` say what is not.

    versions: of the software that ran it, as its recordings have them; several with whose they are.
    """

    folder: Path
    summary: dict[str, Any]
    settings: dict[str, Any]
    names: tuple[str, ...]
    clients: dict[str, Trace]
    room: Trace | None
    notes: tuple[str, ...]
    versions: tuple[str, ...] = ()


def load_run(folder: Path) -> Run:
    """Everything that can be read. FileNotFoundError if the folder holds nothing of a run."""
    notes: list[str] = []
    summary, settings = (_read_json(folder / name, notes) for name in (SUMMARY, SETTINGS))
    clients: dict[str, Trace] = {}
    room: Trace | None = None
    versions: tuple[str, ...] = ()
    try:
        records = open_run(folder)
    except (FileNotFoundError, RecordingError) as error:
        if not (summary or settings):
            raise FileNotFoundError(
                f"{folder} holds no {SUMMARY}, no {SETTINGS} and no recording; name the folder of a run"
            ) from None
        notes.append(f"{error}.")
    else:
        notes += records.notes
        versions = _versions(records)
        for name, end in records.clients.items():
            trace = _try(tick_trace, end, notes)
            if trace is not None:
                clients[name] = trace
        if records.server is not None:
            room = _try(lambda end: step_trace(end, _room(records)), records.server, notes)
    names = _names(summary, settings, clients.values())
    if room is None and not (folder / SERVER_RECORDING).exists():
        notes.append(f"{SERVER_RECORDING} is not here: no proxies, and no line up, in the plots.")
    notes += [
        f"{client_recording(name)} is not here: the plots do not show the hand of {name}."
        for name in names
        if name not in clients and not (folder / client_recording(name)).exists()
    ]
    return Run(folder, summary, settings, names, clients, room, tuple(notes), versions)


def _try(read: Callable[[End], Trace], end: End, notes: list[str]) -> Trace | None:
    """An end's trace; what of it cannot be read is noted."""
    try:
        trace = read(end)
        notes += losses(end)
    except (RecordingError, KeyError, ValueError, IndexError) as error:
        notes.append(f"{end.path.name} is not readable as a run: {error}.")
        return None
    if not trace.rows:
        notes.append(f"{end.path.name} holds no ticks.")
        return None
    return trace


def _versions(records: RunRecords) -> tuple[str, ...]:
    """Versions that ran each end; who ran it is named where that is not the same for all."""
    ends = {"server": records.server, **records.clients}
    found: dict[str, list[str]] = {}
    for who, end in ends.items():
        if end is not None:
            told = end.recording.header.versions.told
            found.setdefault(told, []).append(who)
    return tuple(found) if len(found) < 2 else tuple(f"{', '.join(who)}: {told}" for told, who in found.items())


def _room(records: RunRecords) -> str:
    settings = records.settings()
    return settings.name if settings else ""


def _read_json(path: Path, notes: list[str]) -> dict[str, Any]:
    try:
        value = all_shown(json.loads(path.read_bytes()))
    except FileNotFoundError:
        notes.append(f"{path.name} is not here: the run was cut short, or this end never wrote it.")
        return {}
    except (ValueError, RecursionError) as error:
        notes.append(f"{path.name} is not readable ({error}); it is left out.")
        return {}
    if isinstance(value, dict):
        return value
    notes.append(f"{path.name} holds no table; it is left out.")
    return {}


def losses(end: End) -> list[str]:
    """What is not in a recording that has been read to its end."""
    notes = [f"{end.path.name}: {describe(each, end.offset_s)}." for each in end.damage]
    missing = sum(timed.record.messages for timed in end.records("gap"))
    if missing:
        notes.append(f"{end.path.name}: {missing} messages were not recorded, the writer was too slow.")
    if not end.recording.complete and not end.damage:
        notes.append(f"{end.path.name} was not closed: its run was cut short; all that was written is here.")
    return notes


def describe(damage: Damage, offset_s: float) -> str:
    """A damage in words, on the run's clock."""
    size = f"{damage.length} bytes at {damage.offset}"
    if damage.from_ns is None or damage.to_ns is None:
        return f"{damage.reason} ({size})"
    span = f"from {damage.from_ns * 1e-9 + offset_s:.3f} s to {damage.to_ns * 1e-9 + offset_s:.3f} s"
    return f"{damage.reason}, {span} ({size})"


def _names(summary: dict[str, Any], settings: dict[str, Any], traces: Iterable[Trace]) -> tuple[str, ...]:
    """Everybody who is mentioned anywhere, in the order of the seats as far as the settings tell."""
    names: dict[str, None] = {}
    for table in (settings, summary):
        users = table.get("users")
        for user in users if isinstance(users, list) else ():
            if isinstance(user, dict) and user.get("name"):
                names[str(user["name"])] = None
    names.update(dict.fromkeys(trace.who for trace in traces))
    return tuple(names)
