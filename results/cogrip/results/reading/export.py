"""Recordings as plain tables: a CSV or Parquet file for each end and kind of message (`columns`).

`time_s` stands first, on the run's clock. A table is written chunk by chunk, so half an hour needs no more memory than a
minute.
"""

import csv
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple, Protocol

import msgspec

from cogrip.protocol.recording.folder import RECOVERED
from cogrip.protocol.recording.reader import RecordedMessage
from cogrip.protocol.recording.records import KINDS, Datagram, Geoms, Poses, Sensors, Step, kind_of
from cogrip.results.reading.columns import Column, TopicLayout, layout_of
from cogrip.results.reading.records import End, RunRecords, decoder
from cogrip.server.recorder import step_topic

Format = Literal["csv", "parquet"]
PARTIAL = "partial"  # part of the names of tables of a run that still goes on
ROWS_HELD = 16_384  # most rows of one Parquet table that are held in memory


class ExportError(Exception):
    """Raised where a run cannot be exported; the text says why, and the cure."""


class Exported(NamedTuple):
    path: Path
    rows: int


class ExportTable(Protocol):
    """Rows on their way into a file."""

    def write(self, columns: Sequence[Sequence[Any]]) -> None: ...

    def close(self) -> None:
        """Write what is left; the file is closed too."""


Make = Callable[[IO[bytes], Sequence[Column]], ExportTable]


class CsvTable:
    """A CSV file; floats are written by `repr`, the shortest text that reads back as the same bits."""

    def __init__(self, file: IO[bytes], columns: Sequence[Column]) -> None:
        self._file = TextIOWrapper(file, encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(column.name for column in columns)

    def write(self, columns: Sequence[Sequence[Any]]) -> None:
        self._writer.writerows(zip(*columns, strict=True))

    def close(self) -> None:
        self._file.close()


class ParquetTable:
    """A Parquet file in row groups of about ROWS_HELD rows; fields carry their unit."""

    def __init__(self, file: IO[bytes], columns: Sequence[Column]) -> None:
        self._arrow, parquet = _pyarrow()
        self._schema = self._arrow.schema([
            self._arrow.field(name, getattr(self._arrow, kind)(), metadata={"unit": unit} if unit else None)
            for name, kind, unit in columns
        ])  # fmt: skip
        self._file = file
        self._writer = parquet.ParquetWriter(file, self._schema, compression="zstd")
        self._held: list[list[Any]] = [[] for _ in columns]

    def write(self, columns: Sequence[Sequence[Any]]) -> None:
        for held, values in zip(self._held, columns, strict=True):
            held += values
        if len(self._held[0]) >= ROWS_HELD:
            self._flush()

    def _flush(self) -> None:
        arrays = [
            self._arrow.array(values, type=field.type) for values, field in zip(self._held, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))
        self._held = [[] for _ in arrays]

    def close(self) -> None:
        try:
            if self._held[0]:
                self._flush()
            self._writer.close()
        finally:
            self._file.close()


_TABLES: dict[Format, Make] = {"csv": CsvTable, "parquet": ParquetTable}


def open_table(to: Format, file: IO[bytes], columns: Sequence[Column]) -> ExportTable:
    """Return a table that is written into `file`. Raises ExportError where `to` cannot be had."""
    return _TABLES[to](file, columns)


def _pyarrow() -> tuple[Any, Any]:
    """Return pyarrow and its parquet. Raises ExportError where it is not installed."""
    try:
        import pyarrow  # type: ignore[import-untyped]
        import pyarrow.parquet  # type: ignore[import-untyped]
    except ImportError:
        raise ExportError(
            "--to parquet needs pyarrow, which is not installed: pip install 'cogrip[parquet]', or export --to csv"
        ) from None
    return pyarrow, pyarrow.parquet


def export(run: RunRecords, to: Format, out: Path, *, datagrams: bool = False, partial: bool = False) -> list[Exported]:
    """Write the tables of a run into the folder `out`; a topic without messages has none.

    datagrams: those that came and went as well, which are much of a recording.
    partial: the run still goes on. Its tables have names of their own (client-anna.tick.partial.csv) and replace those of an
    earlier export; one of the whole run removes them.
    Raises ExportError, before anything is written, where a file is in the way or `to` cannot be had, and OSError where it
    cannot be written; what it had begun is then removed.
    """
    if to == "parquet":
        _pyarrow()
    ends = [*run.clients.values(), *([run.server] if run.server else [])]
    called = {run.folder.name, *(end.recording.header.room for end in run.clients.values())}
    plans = [(end, _paths(end, called, to, out, datagrams)) for end in ends]
    earlier = [_partial(path) for _, paths in plans for path in paths.values()]
    if partial:
        plans = [(end, {number: _partial(path) for number, path in paths.items()}) for end, paths in plans]
    for _, paths in plans:
        for path in paths.values():
            if path.exists() and not partial:
                raise ExportError(f"{path} exists, and nothing is overwritten; remove it, or name another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ExportError(f"{out}: no folder can be made there: {error.strerror}; name another") from None
    begun: list[Path] = []
    for path in earlier if partial else ():
        path.unlink(missing_ok=True)
    try:
        tables = [table for end, paths in plans for table in _export_end(end, paths, _TABLES[to], begun)]
    except BaseException:
        for path in begun:
            path.unlink(missing_ok=True)
        raise
    for path in () if partial else earlier:
        path.unlink(missing_ok=True)
    return tables


def _partial(path: Path) -> Path:
    """Return the name of a table of a run that still goes on."""
    return path.with_name(f"{path.stem}.{PARTIAL}{path.suffix}")


def _paths(end: End, called: Collection[str], to: Format, out: Path, datagrams: bool) -> dict[int, Path]:
    """Return the file of each topic by its number; of a server's rooms those that are `called` so, or all where none is."""
    topics = end.recording.topics
    rooms = [topic for topic in topics if KINDS.get(kind_of(topic)) is Step]
    rooms = [topic for topic in rooms if topic in map(step_topic, called)] or rooms
    stem = end.path.name.removesuffix(RECOVERED).removesuffix(".mcap")
    found = {}
    for number, topic in enumerate(topics):
        kind = kind_of(topic)
        if (
            kind not in KINDS
            or (KINDS[kind] is Datagram and not datagrams)
            or KINDS[kind] is Geoms
            or (KINDS[kind] in (Step, Poses, Sensors) and step_topic(_room_of(topic)) not in rooms)
        ):
            continue
        if KINDS[kind] in (Step, Poses, Sensors) and len(rooms) > 1:
            room_name = re.sub(r"[^\w.-]", "+", _room_of(topic))
            kind = f"{room_name}.{kind}"
        found[number] = out / f"{stem}.{kind}.{to}"
    return found


def _room_of(topic: str) -> str:
    return topic.removeprefix("/room/").rpartition("/")[0]


class _Topic:
    """The messages of one topic on their way into a table, which is made with the first of them."""

    def __init__(self, kind: str, start: str, path: Path, make: Make, begun: list[Path]) -> None:
        self._decode = decoder(kind)
        self._start, self._make, self._begun = start, make, begun
        self._layout: TopicLayout | None = None
        self._table: ExportTable | None = None
        self.path = path
        self.rows = 0

    def write(self, messages: list[RecordedMessage], offset_s: float) -> None:
        try:
            records = [self._decode(message.payload) for message in messages]
            layout = self._layout = self._layout or layout_of(records[0], self._start)
            columns = layout.table([message.time_ns * 1e-9 + offset_s for message in messages], records)
        except (msgspec.MsgspecError, ValueError, LookupError, TypeError) as error:
            raise ExportError(f"{self.path.name}: a message is not what its topic says: {error}") from None
        if self._table is None:
            file = self.path.open("xb")
            self._begun.append(self.path)
            self._table = self._make(file, layout.columns)
        self._table.write(columns)
        self.rows += len(columns[0])

    def close(self) -> None:
        if self._table is not None:
            self._table.close()


def _export_end(end: End, paths: dict[int, Path], make: Make, begun: list[Path]) -> Iterator[Exported]:
    """Write all tables of one recording in one pass over it."""
    topics = {
        number: _Topic(kind_of(end.recording.topics[number]), end.recording.header.start, path, make, begun)
        for number, path in paths.items()
    }
    try:
        for chunk in end.recording.chunks():
            of_topic: defaultdict[int, list[RecordedMessage]] = defaultdict(list)
            for message in chunk:
                of_topic[message.topic].append(message)
            for number, messages in of_topic.items():
                if number in topics:
                    topics[number].write(messages, end.offset_s)
        for topic in topics.values():
            topic.close()
    except BaseException:
        for topic in topics.values():
            with suppress(OSError, ValueError):  # it is the first problem that counts
                topic.close()
        raise
    return (Exported(topic.path, topic.rows) for topic in topics.values() if topic.rows)
