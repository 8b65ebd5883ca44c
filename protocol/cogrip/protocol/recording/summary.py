"""Summary at the end of a recording, for readers that seek: schemas, channels, statistics and an index of the chunks.

A day of recording has a million chunks. The records of their indexes are made at once and kept as bytes in a `Spool`, so that
neither the session nor its end needs more memory as it grows longer.
"""

import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from struct import Struct

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, McapRecord, MetadataIndex, Schema, Statistics, SummaryOffset

from cogrip.protocol.recording.spool import Spool

_FOOTER_HEAD = Struct("<BQQQ")  # what the summary's checksum covers of the footer: all before the checksum itself
_FOOTER_BYTES = 20


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as the bytes of a file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


class Summary:
    """Summary of one file, gathered while it is written."""

    def __init__(self, metadata: MetadataIndex, folder: Path | None) -> None:
        """`metadata` is the file's only one; for `folder` see `Spool`."""
        self._schemas = bytearray()
        self._channels = bytearray()
        self._chunks = Spool(folder)
        self._metadata = record_bytes(metadata)
        self._statistics = Statistics(
            attachment_count=0,
            channel_count=0,
            channel_message_counts={},
            chunk_count=0,
            message_count=0,
            message_end_time=0,
            message_start_time=0,
            metadata_count=1,
            schema_count=0,
        )

    def add_schema(self, schema: Schema) -> bytes:
        """Add a record and return its bytes."""
        record = record_bytes(schema)
        self._schemas += record
        self._statistics.schema_count += 1
        return record

    def add_channel(self, channel: Channel) -> bytes:
        """Add a record and return its bytes."""
        record = record_bytes(channel)
        self._channels += record
        self._statistics.channel_count += 1
        return record

    def add_chunk(self, index: ChunkIndex, messages: dict[int, int]) -> None:
        """Add a chunk that was written. messages: their number by channel. Raises OSError."""
        statistics = self._statistics
        first_ns = index.message_start_time
        if statistics.chunk_count:
            first_ns = min(first_ns, statistics.message_start_time)
        statistics.message_start_time = first_ns
        statistics.message_end_time = max(index.message_end_time, statistics.message_end_time)
        statistics.chunk_count += 1
        counts = statistics.channel_message_counts
        for channel, count in messages.items():
            counts[channel] = counts.get(channel, 0) + count
            statistics.message_count += count
        self._chunks.append(record_bytes(index))

    def pieces(self, start: int) -> Iterator[bytes]:
        """Yield summary and footer of a file whose summary begins at byte `start`. Raises OSError."""
        groups: tuple[tuple[Opcode, Iterable[bytes]], ...] = (
            (Opcode.SCHEMA, (bytes(self._schemas),)),
            (Opcode.CHANNEL, (bytes(self._channels),)),
            (Opcode.STATISTICS, (record_bytes(self._statistics),)),
            (Opcode.CHUNK_INDEX, self._chunks.pieces()),
            (Opcode.ATTACHMENT_INDEX, ()),
            (Opcode.METADATA_INDEX, (self._metadata,)),
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
