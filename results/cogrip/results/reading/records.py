"""Recordings read from Python: typed records one by one, or columns as numpy arrays.

    from cogrip.results.reading.records import open_run

    run = open_run("runs/20260101-120000-demo")
    for time_s, tick in run.clients["anna"].records("tick"):
        print(time_s, tick.position_m)
    columns = run.clients["anna"].columns("tick", "position_m", "force_n")

Times are seconds from the run's start on one clock for all ends. A file is read anew by every call, chunk by chunk, so
half an hour of many people needs no more memory than what is asked for.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from cogrip.protocol.recording.folder import RECOVERED, recordings_of
from cogrip.protocol.recording.reader import Damage, Recording, RecordingError, open_recording
from cogrip.protocol.recording.records import KINDS, kind_of
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.columns import Array, TopicLayout, layout_of
from cogrip.results.reading.folder import CLOCKS
from cogrip.server.recorder import WHO, step_topic
from cogrip.server.recorder import start_of as server_start

_PART_ROWS = 4096  # least rows of a part: an array of a chunk's few dozen rows costs more to make than they do


@cache
def decoder(kind: str) -> Callable[[bytes], Any]:
    """Return what decodes the messages of topics of this kind."""
    return msgspec.json.Decoder(KINDS[kind]).decode


class Timed(NamedTuple):
    time_s: float
    record: Any


@dataclass
class End:
    """One recording of a run: a person's client, or the server.

    offset_s  what is added to its own clock to give the run's time
    """

    recording: Recording
    offset_s: float = 0.0

    @property
    def who(self) -> str:
        return self.recording.header.who

    @property
    def path(self) -> Path:
        return self.recording.path

    @property
    def rate_hz(self) -> int:
        """Rate of its loop [Hz]."""
        return self.recording.header.rate_hz

    @property
    def damage(self) -> list[Damage]:
        """The damaged parts, once something was read to its end."""
        return self.recording.damage

    def topic(self, kind: str) -> int:
        """Number of the topic called `kind` (its last part, or the whole). Raises KeyError with what there is."""
        found = [
            number for number, topic in enumerate(self.recording.topics) if kind in (topic, kind_of(topic))
        ]  # fmt: skip
        if not found:
            there = ", ".join(kind_of(topic) for topic in self.recording.topics)
            raise KeyError(f"{self.path.name} has no topic {kind!r}; there is: {there}")
        return found[0]

    def chunks(self, kind: str) -> Iterator[tuple[list[float], list[Any]]]:
        """Yield (times [s], records) of one topic, a chunk of the file at a time."""
        wanted = self.topic(kind)
        decode = decoder(kind_of(self.recording.topics[wanted]))
        for chunk in self.recording.chunks():
            mine = [message for message in chunk if message.topic == wanted]
            if mine:
                try:
                    records = [decode(message.payload) for message in mine]
                except msgspec.MsgspecError as error:
                    by = self.recording.header.versions.cogrip
                    raise RecordingError(
                        f"{self.path} was written by cogrip {by}, which this one does not read: {error}"
                    ) from None
                yield [message.time_ns * 1e-9 + self.offset_s for message in mine], records

    def records(self, kind: str) -> Iterator[Timed]:
        """Typed records of one topic (`cogrip.protocol.recording.records`), oldest first."""
        for times, records in self.chunks(kind):
            yield from map(Timed, times, records)

    def parts(self, kind: str, *names: str, numbered: bool = False) -> Iterator[dict[str, Array]]:
        """`columns` of one topic, `_PART_ROWS` rows or a chunk more at a time. numbered: seats stand under their number."""
        layout: TopicLayout | None = None
        chunks = self.chunks(kind)
        for times, records in chunks:
            layout = layout or layout_of(records[0], self.recording.header.start, numbered=numbered)
            while len(times) < _PART_ROWS and (following := next(chunks, None)):
                times += following[0]
                records += following[1]
            yield layout.arrays(times, records, names)

    def columns(self, kind: str, *names: str) -> dict[str, Array]:
        """Return fields of one topic as arrays, shape (n,) or (n, axes), with `time_s`; all fields if none is named.

        Fields are as in an exported table (`columns.layout_of`); null is nan. Raises KeyError for an unknown field.
        """
        parts = list(self.parts(kind, *names))
        if not parts:
            return {name: np.empty(0) for name in ("time_s", *(names or KINDS[kind_of(kind)].__struct_fields__))}
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@dataclass
class RunRecords:
    """The recordings of one run. `notes` say what is damaged or not there; of `unreadable` files nothing can be read."""

    folder: Path
    clients: dict[str, End]
    server: End | None
    notes: list[str]
    unreadable: list[Path] = field(default_factory=list)

    def end(self, who: str | int) -> End:
        """A client by name or seat number, or the server. Raises KeyError with who there is."""
        if who == WHO and self.server:
            return self.server
        if isinstance(who, int) or who.isdecimal():
            names = self.names()
            who = names[int(who)] if int(who) < len(names) else str(who)
        if who not in self.clients:
            there = ", ".join(self.clients) or "nobody"
            raise KeyError(f"{self.folder}: there is no recording of user {who!r}; there is: {there}")
        return self.clients[who]

    def names(self) -> list[str]:
        """People in the order of their seats, as far as the server's part tells; then by file."""
        seats = [user.name for user in settings.users] if (settings := self.settings()) else []
        return [*seats, *(name for name in self.clients if name not in seats)]

    def settings(self) -> Settings | None:
        """Return the room's settings, None without the server's part. Raises RecordingError where that does not say them."""
        if self.server is None:
            return None
        try:
            rooms, _ = server_start(self.server.recording.header.start)
        except (KeyError, ValueError) as error:
            raise RecordingError(f"{self.server.path} does not say its settings: {error}") from None
        names = {end.recording.header.room for end in self.clients.values()} or {self.folder.name}
        return next((room for room in rooms if room.name in names), rooms[0])

    def room(self) -> str:
        """Return the name of the room, "" where the server's part is not here. Raises RecordingError as `settings`."""
        settings = self.settings()
        return settings.name if settings else ""

    @property
    def virtual(self) -> bool:
        """True for a run of the laboratory."""
        return any(end.recording.header.virtual for end in (*self.clients.values(), self.server) if end)

    def markers(self) -> list[tuple[float, str]]:
        """Return time [s] and text of every marker, oldest first; who set it, where a person did, stands before the text.

        As the server has them; without its part, as whoever was told of most.
        """
        if self.server is None:
            return max((_marked(end, "", []) for end in self.clients.values()), key=len, default=[])
        return _marked(self.server, f"{self.room()}: ", self.names())

    def triggers(self) -> list[tuple[float, int, str]]:
        """Return time [s] of every write to the trigger line, its code and the words of its marker, oldest first."""
        found = []
        for time_s, given in self.server.records("input") if self.server else ():
            value = msgspec.json.decode(given.value)
            if value["kind"] == "trigger_written":
                found.append((time_s - 1e-9 * value["ago_ns"], int(value["code"]), str(value["marker"])))
        return found

    def steps(self) -> Iterator[Timed]:
        """Steps of the room, typed `Step`; none where the server's part is not here."""
        if self.server is not None:
            yield from self.server.records(step_topic(self.room()))


def _marked(end: End, before: str, names: Sequence[str]) -> list[tuple[float, str]]:
    """Return the markers of one recording. before: what its events begin with; names: who may stand before the word."""
    found = []
    for time_s, event in end.records("event"):
        text = event.text.removeprefix(before)
        who = next((name for name in names if text.startswith(f"{name} marker: ")), "")
        if text.startswith("marker: ") or who:
            found.append((time_s, f"{who} {text.partition('marker: ')[2]}".strip()))
    return found


def open_run(path: str | Path) -> RunRecords:
    """The recordings of a run folder, or of one file. Raises FileNotFoundError; RecordingError if none can be read."""
    folder = Path(path)
    notes: list[str] = []
    clients: dict[str, End] = {}
    server: End | None = None
    unreadable: list[Path] = []
    found = recordings_of(folder)
    for file in found:
        try:
            end = End(open_recording(file))
        except RecordingError as error:
            if len(found) == 1:
                raise
            notes.append(f"{error}.")
            unreadable.append(file)
            continue
        if end.recording.header.role == "server":
            server = end
        else:
            clients[end.who] = end
    if not clients and server is None:
        raise RecordingError(f"{folder} holds no recording that can be read; name a run folder or a .mcap file")
    folder = folder if folder.is_dir() else folder.parent
    _align([*clients.values(), *([server] if server else [])], folder, notes)
    return RunRecords(folder, clients, server, notes, unreadable)


def _align(ends: list[End], folder: Path, notes: list[str]) -> None:
    """Put all ends on one clock that begins with the first tick of any client (of the server where there is none)."""
    clocks = read_clocks(folder)
    spans: list[tuple[float, float]] = []
    for end in ends:
        end.offset_s = clocks.get(end.path.name.replace(RECOVERED, ".mcap"), 0) * 1e-9
        spans.append(_span(end))
    longest = max(spans, key=lambda span: span[1] - span[0])
    if any(first > longest[1] or last < longest[0] for first, last in spans):
        notes.append(
            "The recordings come from machines whose clocks are not one: each begins at its own start; "
            "`cogrip merge` brings them together."
        )
        for end, (first_s, _) in zip(ends, spans, strict=True):
            end.offset_s -= first_s
        return
    people = [first_s for end, (first_s, _) in zip(ends, spans, strict=True) if end.recording.header.role == "client"]
    for end in ends:
        end.offset_s -= min(people or [first_s for first_s, _ in spans])


def _span(end: End) -> tuple[float, float]:
    """Return the times [s] of the first tick (where there is none, of the first message) and of the last message."""
    ticks = [number for number, topic in enumerate(end.recording.topics) if kind_of(topic) == "tick"]
    began_ns, first_ns = None, None
    for message in end.recording.messages():
        if began_ns is None:
            began_ns = message.time_ns
        if message.topic in ticks or not ticks:
            first_ns = message.time_ns
            break
    start_ns = first_ns if first_ns is not None else began_ns or 0
    return start_ns * 1e-9 + end.offset_s, max(start_ns, end.recording.last_ns()) * 1e-9 + end.offset_s


def read_clocks(folder: Path) -> Mapping[str, int]:
    """Return the clocks by `cogrip merge`: by file name, nanoseconds to add to have the server's."""
    try:
        table = json.loads((folder / CLOCKS).read_text())
    except (OSError, ValueError):
        return {}
    return {name: int(each["add_ns"]) for name, each in table.items()}
