"""Summary at the end of a recording, for readers that seek: schemas, channels, statistics and an index of the chunks.

A day of recording has a million chunks. The records of their indexes are made at once and kept as bytes in a `Spool`, so that
neither the session nor its end needs more memory as it grows longer.
"""

import tempfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from struct import Struct
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, McapRecord, MetadataIndex, Schema, Statistics, SummaryOffset

from cogrip.machine.addition import add_integers

_FOOTER_HEAD = Struct("<BQQQ")  # part of the footer that the summary's checksum covers: all before the checksum itself
_FOOTER_BYTES = 20
HELD_BYTES = 64 * 1024  # bytes of a spool that are held in memory


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as the bytes of a file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


class Spool:
    """Bytes kept to the end of a recording: the last in memory, the others in a file without a name.

    Short recordings make no file; a killed process leaves none behind.
    """

    def __init__(self, folder: Path | None) -> None:
        """The file lies in `folder` where it can, else where the system keeps such files."""
        self._folder = folder
        self._held = bytearray()
        self._file: IO[bytes] | None = None
        self._flush_above = HELD_BYTES
        self.length = 0  # bytes, of all that was appended

    @property
    def held_bytes(self) -> int:
        """Bytes in memory: at most HELD_BYTES, but for what could not be written to the file."""
        return len(self._held)

    def append(self, data: bytes) -> None:
        """Append bytes. Where the file cannot be made or is full, all stay in memory until another try HELD_BYTES later.

        Raises OSError only where half a write cannot be taken back: a broken disk.
        """
        self._held += data
        self.length += len(data)
        if len(self._held) > self._flush_above:
            self._flush_above = HELD_BYTES if self._flush() else len(self._held) + HELD_BYTES

    def _flush(self) -> bool:
        """Move all from memory to the file; return False, with both unchanged, where that fails."""
        try:
            if self._file is None:
                self._file = _file_in(self._folder)
        except OSError:
            return False
        at = self.length - len(self._held)
        self._file.seek(at)
        rest = memoryview(bytes(self._held))
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:  # a full disk takes a part first
            self._file.truncate(at)
            return False
        self._held.clear()
        return True

    def pieces(self) -> Iterator[bytes]:
        """Yield all bytes, in pieces of HELD_BYTES at most, at least one piece. Raises OSError."""
        if self._file is not None:
            self._file.seek(0)
            while piece := self._file.read(HELD_BYTES):
                yield piece
        yield bytes(self._held[:HELD_BYTES])
        for begin in range(HELD_BYTES, len(self._held), HELD_BYTES):
            yield bytes(self._held[begin : begin + HELD_BYTES])

    def close(self) -> None:
        """Drop everything."""
        self._held.clear()
        if self._file is not None:
            self._file.close()


def _file_in(folder: Path | None) -> IO[bytes]:
    try:
        return tempfile.TemporaryFile("w+b", buffering=0, dir=folder)
    except OSError:  # the folder may have been removed: it comes back only when the recording is flushed
        return tempfile.TemporaryFile("w+b", buffering=0)


class Summary:
    """Summary of one file, gathered while it is written."""

    def __init__(self, folder: Path | None) -> None:
        """`folder`: see `Spool`."""
        self._schemas = bytearray()
        self._channels = bytearray()
        self._chunks = Spool(folder)
        self._metadata = bytearray()
        self._statistics = Statistics(
            attachment_count=0, channel_count=0, channel_message_counts=Counter(), chunk_count=0, message_count=0,
            message_end_time=0, message_start_time=0, metadata_count=0, schema_count=0,
        )  # fmt: skip

    def add(self, described: Schema | Channel) -> bytes:
        """Add a schema or a channel and return its record's bytes."""
        record = record_bytes(described)
        if isinstance(described, Schema):
            self._schemas += record
            self._statistics.schema_count += 1
        else:
            self._channels += record
            self._statistics.channel_count += 1
        return record

    def add_metadata(self, index: MetadataIndex) -> None:
        """Add a metadata record that is written."""
        self._metadata += record_bytes(index)
        self._statistics.metadata_count += 1

    def add_chunk(self, index: ChunkIndex, messages: dict[int, int]) -> None:
        """Add a chunk that was written. messages: their number by channel. Raises OSError."""
        statistics = self._statistics
        first_ns = index.message_start_time
        if statistics.chunk_count:
            first_ns = min(first_ns, statistics.message_start_time)
        statistics.message_start_time = first_ns
        statistics.message_end_time = max(index.message_end_time, statistics.message_end_time)
        statistics.chunk_count += 1
        statistics.channel_message_counts.update(messages)
        statistics.message_count += add_integers(messages.values())
        self._chunks.append(record_bytes(index))

    def pieces(self, start: int) -> Iterator[bytes]:
        """Yield summary and footer of a file whose summary begins at byte `start`. Raises OSError."""
        groups: tuple[tuple[Opcode, Iterable[bytes]], ...] = (
            (Opcode.SCHEMA, (bytes(self._schemas),)),
            (Opcode.CHANNEL, (bytes(self._channels),)),
            (Opcode.STATISTICS, (record_bytes(self._statistics),)),
            (Opcode.CHUNK_INDEX, self._chunks.pieces()),
            (Opcode.ATTACHMENT_INDEX, ()),
            (Opcode.METADATA_INDEX, (bytes(self._metadata),)),
        )
        at, crc, offsets = start, 0, b""
        for opcode, records in groups:
            begin = at
            for piece in records:
                at += len(piece)
                crc = zlib.crc32(piece, crc)
                yield piece
            offsets += record_bytes(SummaryOffset(opcode, begin, at - begin))
        yield offsets
        crc = zlib.crc32(_FOOTER_HEAD.pack(Opcode.FOOTER, _FOOTER_BYTES, start, at), zlib.crc32(offsets, crc))
        yield record_bytes(Footer(start, at, crc))

    def close(self) -> None:
        """Drop everything."""
        self._chunks.close()
