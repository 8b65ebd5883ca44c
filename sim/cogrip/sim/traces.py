"""What a run folder holds, as numpy columns in time order: traces, summary, settings, and what is missing of them.

A column is read from the file when it is asked for, so that half an hour of many people stays on the disk.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.io.trace import HEADER_BYTES, TraceReader
from cogrip.sim.run_folder import ROOM_TRACE, SETTINGS, SUMMARY, client_trace

Array = NDArray[np.float64]
MOST_PEOPLE = 12  # that a plot shows: more are not told apart


class Columns(Mapping[str, Array]):
    """Column name to its values, oldest first, shape (rows,), a copy. Each look-up reads the file.

    The file is mapped: it must not lose these rows meanwhile. A writer that closes gives back only what it never wrote.
    """

    def __init__(self, names: tuple[str, ...], rows: Array, oldest: int) -> None:
        self._index = {name: index for index, name in enumerate(names)}
        self._rows = rows
        self._oldest = oldest

    def __getitem__(self, name: str) -> Array:
        column = self._rows[:, self._index[name]]
        return np.concatenate((column[self._oldest :], column[: self._oldest]))

    def __iter__(self) -> Iterator[str]:
        return iter(self._index)

    def __len__(self) -> int:
        return len(self._index)


@dataclass
class Trace:
    """One file. `overwritten` rows were too old for the ring, `cut` rows were promised by the header and are not there."""

    who: str
    rate_hz: int
    start_ns: int
    columns: Columns
    rows: int
    overwritten: int
    cut: int

    def vector(self, name: str) -> Array:
        """`position_m.0`, `position_m.1` ... side by side, shape (rows, axes). KeyError without the first."""
        parts = [self.columns[f"{name}.0"]]
        while f"{name}.{len(parts)}" in self.columns:
            parts.append(self.columns[f"{name}.{len(parts)}"])
        return np.stack(parts, axis=1)

    @cached_property
    def time_s(self) -> Array:
        """Seconds on the run's clock (the file's own before `align`)."""
        return self.columns["time_s"]

    def shift(self, seconds: float) -> None:
        self.time_s = self.time_s + seconds


def read_trace(path: Path) -> Trace:
    """Whatever rows are whole, of a trace that is finished, being written, or cut short. ValueError if it is not one."""
    try:
        reader = TraceReader(path)
    except (KeyError, TypeError, ValueError) as error:  # the header or its JSON is damaged, or the file is empty
        raise ValueError(f"{path.name} is not a readable trace: {error}") from None
    width, capacity, count = len(reader.columns), reader.capacity, reader.count
    reader.close()
    if not width or capacity < 1 or "time_s" not in reader.columns:
        raise ValueError(f"{path.name} is not a readable trace: its header names no rows with a time_s")
    promised = min(count, capacity)
    rows = min(promised, (path.stat().st_size - HEADER_BYTES) // (8 * width))
    body: Array
    if rows:
        body = np.memmap(path, dtype="<f8", mode="r", offset=HEADER_BYTES, shape=(rows, width))
    else:
        body = np.empty((0, width))
    overwritten = max(0, count - capacity)
    oldest = min(count % capacity, rows) if overwritten else 0
    columns = Columns(reader.columns, body, oldest)
    return Trace(reader.who, reader.rate_hz, reader.start_ns, columns, rows, overwritten, promised - rows)


def align(clients: Iterable[Trace], room: Trace | None) -> bool:
    """Put traces of one clock on one axis that begins with the first client; False, and nothing done, if they are not.

    A server may have run for hours before anybody came. Machines have clocks of their own: then the files hardly overlap.
    """
    people = list(clients)
    traces = [*people, room] if room else people
    if not traces:
        return True
    spans = [(trace.start_ns * 1e-9 + trace.time_s[0], trace.start_ns * 1e-9 + trace.time_s[-1]) for trace in traces]
    longest = max(spans, key=lambda span: span[1] - span[0])
    if any(start > longest[1] or end < longest[0] for start, end in spans):
        return False
    first_ns = min(trace.start_ns for trace in people or traces)
    for trace in traces:
        trace.shift((trace.start_ns - first_ns) * 1e-9)
    return True


@dataclass(frozen=True)
class Run:
    """One run folder. Seat n of the room is names[n]; `clients` has those whose trace is there; `notes` say what is not."""

    folder: Path
    summary: dict[str, Any]
    settings: dict[str, Any]
    names: tuple[str, ...]
    clients: dict[str, Trace]
    room: Trace | None
    notes: tuple[str, ...]


def load_run(folder: Path) -> Run:
    """Everything that can be read. FileNotFoundError if the folder holds nothing of a run."""
    notes: list[str] = []
    summary, settings = (_read_json(folder / name, notes) for name in (SUMMARY, SETTINGS))
    found: dict[str, Trace] = {}
    for path in sorted(folder.glob("*.trace")):
        try:
            trace = read_trace(path)
        except ValueError as error:
            notes.append(f"{error}; it is left out.")
            continue
        found[path.name] = trace
        notes += _losses(path.name, trace)
    if not (summary or settings or found):
        raise FileNotFoundError(f"{folder} holds no {SUMMARY}, no {SETTINGS} and no trace; name the folder of a run")
    room = found.pop(ROOM_TRACE, None)
    names = _names(summary, settings, found.values())
    clients = {trace.who: trace for trace in found.values() if trace.rows}
    if room is None:  # one that has no rows has its note already
        notes.append(f"{ROOM_TRACE} is not here: no proxies, and no line up, in the plots.")
    notes += [
        f"{client_trace(name)} is not here: the plots do not show the hand of {name}."
        for name in names
        if name not in clients
    ]
    room = room if room and room.rows else None
    if not align(clients.values(), room):
        notes.append("The traces come from machines whose clocks are not one: each is drawn from its own start.")
    return Run(folder, summary, settings, names, clients, room, tuple(notes))


def _read_json(path: Path, notes: list[str]) -> dict[str, Any]:
    try:
        value = json.loads(path.read_bytes())
    except FileNotFoundError:
        notes.append(f"{path.name} is not here: the run was cut short, or this end never wrote it.")
        return {}
    except ValueError as error:
        notes.append(f"{path.name} is not readable ({error}); it is left out.")
        return {}
    if isinstance(value, dict):
        return value
    notes.append(f"{path.name} holds no table; it is left out.")
    return {}


def _losses(name: str, trace: Trace) -> list[str]:
    notes = []
    if trace.overwritten:
        notes.append(f"{name}: the first {trace.overwritten} rows were overwritten by later ones (the file is a ring).")
    if trace.cut:
        notes.append(f"{name}: the last {trace.cut} rows are cut off.")
    if not trace.rows:
        notes.append(f"{name} has no rows.")
    return notes


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
