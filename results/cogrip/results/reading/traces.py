"""A run folder read for its report: traces as numpy columns, summary, settings, and notes on what is missing.

A recording is read once, into a temporary file for each column; a column is read when it is asked for. So half an hour
of many people stays on the disk.
"""

import json
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers
from cogrip.protocol.drawing import Shape
from cogrip.protocol.recording.reader import Damage, RecordingError
from cogrip.protocol.texts import all_shown, shown
from cogrip.results.reading.folder import (
    SERVER_RECORDING,
    SETTINGS,
    SUMMARY,
    WARNINGS,
    client_log,
    client_recording,
    told_in_log,
)
from cogrip.results.reading.records import End, RunRecords, open_run
from cogrip.server.recorder import scene_topics, step_topic

Array = NDArray[np.float64]
MOST_PEOPLE = 16  # most people that a plot shows: more are not told apart
_LIVE = "live"  # state of a client's safety that lets force through


class Columns(Mapping[str, Array]):
    """Field name to its values, oldest first, shape (rows,) or (rows, axes), a copy. Each look-up reads the disk."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="cogrip-columns-"))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._shapes: dict[str, tuple[int, ...]] = {}  # of one row

    def extend(self, columns: Mapping[str, Array]) -> None:
        """Append rows, of the same columns every time."""
        for number, (name, values) in enumerate(columns.items()):
            self._shapes.setdefault(name, values.shape[1:])
            with self._file(number).open("ab") as file:
                values.astype(np.float64).tofile(file)

    def _file(self, number: int) -> Path:
        return self._folder / f"{number}.f64"

    def __getitem__(self, name: str) -> Array:
        shape = self._shapes[name]
        return np.fromfile(self._file(list(self._shapes).index(name)), dtype=np.float64).reshape(-1, *shape)

    def __iter__(self) -> Iterator[str]:
        return iter(self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)


@dataclass
class EndTrace:
    """One end of a run; `columns` are those of its ticks or steps (`End.columns`)."""

    who: str
    rate_hz: int
    columns: Columns
    rows: int

    @cached_property
    def time_s(self) -> Array:
        """Seconds on the run's clock."""
        return self.columns["time_s"]


def trace_of(end: End, topic: str) -> EndTrace:
    """Read the ticks or steps of one topic; fields of a seat begin with its number (`0.proxy_m`), `live` stands for `state`."""
    columns, rows = Columns(), 0
    for part in end.parts(topic, numbered=True):
        rows += len(part["time_s"])
        if "state" in part:
            part["live"] = part.pop("state") == _LIVE
        columns.extend({name: values for name, values in part.items() if values.dtype.kind != "U"})
    return EndTrace(end.who, end.rate_hz, columns, rows)


@dataclass(frozen=True)
class TracedRun:
    """One run folder. Seat n of the room is names[n]; `clients` has those whose recording is there; `notes` say what is not.

    versions: of the software that ran it, as its recordings have them; several with whose they are.
    bodies: poses of a scene's bodies that move, as `poses`, seven numbers a body; shapes: what they are drawn of.
    markers: time [s] and text of each, changes in the session among them.
    """

    folder: Path
    summary: dict[str, Any]
    settings: dict[str, Any]
    names: tuple[str, ...]
    clients: dict[str, EndTrace]
    room: EndTrace | None
    notes: tuple[str, ...]
    versions: tuple[str, ...] = ()
    bodies: EndTrace | None = None
    shapes: tuple[Shape, ...] = ()
    markers: tuple[tuple[float, str], ...] = ()


def load_run(folder: Path) -> TracedRun:
    """Read everything that can be read. FileNotFoundError if the folder holds nothing of a run."""
    notes: list[str] = []
    summary, settings = (_read_json(folder / name, notes) for name in (SUMMARY, SETTINGS))
    clients: dict[str, EndTrace] = {}
    room: EndTrace | None = None
    versions: tuple[str, ...] = ()
    bodies: tuple[EndTrace | None, tuple[Shape, ...]] = None, ()
    markers: tuple[tuple[float, str], ...] = ()
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
            trace = _try(records, end, notes)
            if trace is not None:
                clients[name] = trace
        room = _try(records, records.server, notes) if records.server else None
        if room is not None and records.server:
            bodies = _bodies(records.server, records.room())
        markers = _markers(records)
    names = _names(summary, settings, clients.values())
    if room is None and not (folder / SERVER_RECORDING).exists():
        notes.append(f"{SERVER_RECORDING} is not here: no proxies, and no line up, in the plots.")
    notes += [
        f"{client_recording(name)} is not here: the plots do not show the hand of {name}."
        for name in names
        if name not in clients and not (folder / client_recording(name)).exists()
    ]
    notes += told_in_log(folder / WARNINGS)
    notes += [
        f"{name}: {line.removeprefix(f'{name}: ')}" for name in names for line in told_in_log(folder / client_log(name))
    ]
    return TracedRun(folder, summary, settings, names, clients, room, tuple(notes), versions, *bodies, markers)


def _try(records: RunRecords, end: End, notes: list[str]) -> EndTrace | None:
    """Return the trace of an end; notes say what of it cannot be read."""
    try:
        trace = trace_of(end, step_topic(records.room()) if end is records.server else "tick")
        notes += losses(end)
    except (RecordingError, KeyError, ValueError, IndexError) as error:
        notes.append(f"{end.path.name} is not readable as a run: {error}.")
        return None
    if not trace.rows:
        notes.append(f"{end.path.name} holds no ticks.")
        return None
    return trace


def _bodies(server: End, room: str) -> tuple[EndTrace | None, tuple[Shape, ...]]:
    """Return poses and shapes of the bodies of a room's scene; None and () where there is none."""
    geoms, poses = scene_topics(room)
    if poses not in server.recording.topics:
        return None, ()
    try:
        shapes = next((each.record.shapes for each in server.records(geoms)), ())
        trace = trace_of(server, poses)
    except (RecordingError, KeyError, ValueError, IndexError):  # of another version: the other plots are drawn
        return None, ()
    return trace if trace.rows else None, shapes


def _markers(records: RunRecords) -> tuple[tuple[float, str], ...]:
    try:
        return tuple([(time_s, shown(text)) for time_s, text in records.markers()])
    except (RecordingError, KeyError, ValueError, IndexError):  # of another version, or damaged there
        return ()


def _versions(records: RunRecords) -> tuple[str, ...]:
    """Return the versions that ran each end; who ran it is named where that is not the same for all."""
    ends = {"server": records.server, **records.clients}
    found: dict[str, list[str]] = {}
    for who, end in ends.items():
        if end is not None:
            reported = end.recording.header.versions.in_words
            found.setdefault(reported, []).append(who)
    return tuple(found) if len(found) < 2 else tuple(f"{', '.join(who)}: {reported}" for reported, who in found.items())


def _read_json(path: Path, notes: list[str]) -> dict[str, Any]:
    try:
        value = all_shown(json.loads(path.read_bytes()))
    except FileNotFoundError:
        notes.append(f"{path.name} is not here: the other end writes it, or the run was cut short.")
        return {}
    except (ValueError, RecursionError) as error:
        notes.append(f"{path.name} is not readable ({error}); it is left out.")
        return {}
    if isinstance(value, dict):
        return value
    notes.append(f"{path.name} holds no table; it is left out.")
    return {}


def losses(end: End) -> list[str]:
    """Return notes on what is missing in a recording that has been read to its end."""
    notes = [f"{end.path.name}: {describe(each, end.offset_s)}." for each in end.damage]
    missing = add_integers(timed.record.messages for timed in end.records("gap"))
    if missing:
        notes.append(f"{end.path.name}: {missing} messages were not recorded, the writer was too slow.")
    if end.recording.cut:
        notes.append(f"{end.path.name}: its process was killed; all that it had recorded until then is here.")
    elif not end.recording.complete and not end.damage:
        notes.append(f"{end.path.name} was not closed: its run was cut short; all that was written is here.")
    return notes


def describe(damage: Damage, offset_s: float) -> str:
    """Return a damage in words, on the run's clock."""
    size = f"{damage.length} bytes at {damage.offset}"
    if damage.from_ns is None or damage.to_ns is None:
        return f"{damage.reason} ({size})"
    span = f"from {damage.from_ns * 1e-9 + offset_s:.3f} s to {damage.to_ns * 1e-9 + offset_s:.3f} s"
    return f"{damage.reason}, {span} ({size})"


def _names(summary: dict[str, Any], settings: dict[str, Any], traces: Iterable[EndTrace]) -> tuple[str, ...]:
    """Return everybody who is mentioned anywhere, in the order of the seats as far as the settings tell."""
    names: dict[str, None] = {}
    for table in (settings, summary):
        users = table.get("users")
        for user in users if isinstance(users, list) else ():
            if isinstance(user, dict) and user.get("name"):
                names[str(user["name"])] = None
    names.update(dict.fromkeys(trace.who for trace in traces))
    return tuple(names)
