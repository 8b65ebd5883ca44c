"""The checks of `mcap doctor` on a file, by the `mcap` library's own records: CRCs, order, indexes and statistics.

The `mcap` program itself is on no registry of packages for Python, Node or Debian.
"""

import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from struct import unpack_from
from typing import Any

from mcap.reader import make_reader
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Message, MessageIndex, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream

MAGIC_BYTES, HEAD_BYTES = 8, 9
FOOTER_CRC_BYTES = 4


def diagnose(path: Path, checksums: bool = True) -> list[str]:
    """Return all that is wrong with a file. Raises what the library raises for a file that it cannot read.

    checksums: each chunk and the summary have one, which the format leaves open.
    """
    return [*Doctor(path, checksums).findings()]


class Doctor:
    """One file, read once from its beginning and once by its index."""

    def __init__(self, path: Path, checksums: bool) -> None:
        self._path, self._data, self._checksums = path, path.read_bytes(), checksums
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._times: list[int] = []
        self._chunks: dict[int, tuple[Chunk, int, set[int]]] = {}  # by offset: the chunk, its length, its channels
        self._in_summary = False
        self._told: dict[type, list[Any]] = {Schema: [], Channel: [], ChunkIndex: [], Statistics: []}

    def findings(self) -> Iterator[str]:
        offset = MAGIC_BYTES
        with self._path.open("rb") as file:
            for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
                (length,) = unpack_from("<Q", self._data, offset + 1)
                if isinstance(record, Chunk):
                    yield from self._chunk(record, offset, HEAD_BYTES + length)
                elif isinstance(record, MessageIndex):
                    yield from self._index(record)
                elif isinstance(record, Message):
                    yield "a message stands outside of all chunks"
                elif isinstance(record, DataEnd):
                    self._in_summary = True
                elif isinstance(record, Footer):
                    yield from self._footer(record)
                elif type(record) in self._told and self._in_summary:
                    self._told[type(record)].append(record)
                offset += HEAD_BYTES + length
        yield from self._summary()
        yield from self._indexed()

    def _chunk(self, chunk: Chunk, offset: int, length: int) -> Iterator[str]:
        times, channels = [], set()
        if chunk.uncompressed_crc == 0 and self._checksums:
            yield f"the chunk at {offset} has no checksum"
        for record in breakup_chunk(chunk, validate_crc=True):
            if isinstance(record, Schema):
                if record.id == 0 or self._schemas.setdefault(record.id, record) != record:
                    yield f"schema {record.id} is 0 or another one than before"
            elif isinstance(record, Channel):
                if record.schema_id not in self._schemas or self._channels.setdefault(record.id, record) != record:
                    yield f"channel {record.topic} has an unknown schema, or is another one than before"
            elif isinstance(record, Message):
                if record.channel_id not in self._channels:
                    yield f"a message of channel {record.channel_id} comes before the channel"
                times.append(record.log_time)
                channels.add(record.channel_id)
                self._counts[record.channel_id] += 1
            else:
                yield f"a {type(record).__name__} stands in a chunk"
        if times and (min(times), max(times)) != (chunk.message_start_time, chunk.message_end_time):
            yield f"the chunk at {offset} says other times than its messages have"
        self._times += times
        self._chunks[offset] = chunk, length, channels
        self._last = chunk

    def _index(self, index: MessageIndex) -> Iterator[str]:
        """Look each entry up in the chunk before it."""
        stream, length = get_chunk_data_stream(self._last)
        records = stream.read(length)
        for time_ns, place in index.records:
            opcode, _, channel, _, log_time = unpack_from("<BQHIQ", records, place)
            if (opcode, channel, log_time) != (5, index.channel_id, time_ns):
                yield f"an entry of the message index of channel {index.channel_id} leads to no message of it"

    def _footer(self, footer: Footer) -> Iterator[str]:
        if footer.summary_crc:
            end = len(self._data) - MAGIC_BYTES - FOOTER_CRC_BYTES
            if zlib.crc32(self._data[footer.summary_start : end]) != footer.summary_crc:
                yield "the checksum of the summary is wrong"
        elif self._checksums:
            yield "the summary has no checksum"

    def _summary(self) -> Iterator[str]:
        if [*self._told[Schema]] != [*self._schemas.values()] or self._told[Channel] != [*self._channels.values()]:
            yield "the summary has other schemas or channels than the data"
        indexed = {index.chunk_start_offset: index for index in self._told[ChunkIndex]}
        if indexed.keys() != self._chunks.keys() or len(indexed) != len(self._told[ChunkIndex]):
            yield "the summary has other chunks than the data"
        for offset, (chunk, length, channels) in self._chunks.items():
            index = indexed.get(offset)
            if index is None:
                continue
            said = (
                index.chunk_length, index.message_start_time, index.message_end_time, index.compression,
                index.compressed_size, index.uncompressed_size, {*index.message_index_offsets},
            )  # fmt: skip
            there = (
                length, chunk.message_start_time, chunk.message_end_time, chunk.compression, len(chunk.data),
                chunk.uncompressed_size, channels,
            )  # fmt: skip
            if said != there:
                yield f"the index of the chunk at {offset} says {said}, there is {there}"
        if len(self._told[Statistics]) != 1:
            yield "there is not one statistics record"
        for told in self._told[Statistics]:
            counts = {channel: count for channel, count in told.channel_message_counts.items() if count}
            if (told.message_count, counts) != (len(self._times), dict(self._counts)):
                yield f"statistics say {told.message_count} messages, there are {len(self._times)}"
            if self._times and (told.message_start_time, told.message_end_time) != (min(self._times), max(self._times)):
                yield "statistics say other times than the messages have"
            if (told.chunk_count, told.schema_count, told.channel_count) != (
                len(self._chunks), len(self._schemas), len(self._channels),
            ):  # fmt: skip
                yield "statistics say other numbers of chunks, schemas or channels"

    def _indexed(self) -> Iterator[str]:
        """Read by the index alone, as viewers do that seek, and count."""
        last_ns, count = 0, 0
        with self._path.open("rb") as file:
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=True):
                if message.log_time < last_ns:
                    yield "messages by the index are not in the order of their times"
                last_ns, count = message.log_time, count + 1
        if count != len(self._times):
            yield f"by the index there are {count} messages, in the data {len(self._times)}"
