"""Writer of recordings: MCAP with zstd chunks of 64 KiB, each readable once it is on the disk.

The file equals that of the `mcap` library's writer at the same level of compression, byte for byte. That one keeps an object
for every chunk until the end, 800 bytes of memory each and ten of them a second; this one keeps none (`summary.py`).

    message: channel u16, sequence u32, log_time u64, publish_time u64, JSON text
    chunk: first_time u64, last_time u64, size u64, crc u32, compression (u32 and text), u64 bytes of packed records
    message index: channel u16, u32 bytes of entries; an entry: log_time u64, place in the chunk's records u64
"""

import zlib
from pathlib import Path
from struct import Struct, pack
from typing import IO

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, DataEnd, Metadata, MetadataIndex, Schema
from mcap.records import Header as FileHeader

from cogrip.protocol.recording.derived import DERIVED, Pictures
from cogrip.protocol.recording.header import CUT, NAME, Header
from cogrip.protocol.recording.reader import MAGIC
from cogrip.protocol.recording.records import KINDS, kind_of
from cogrip.protocol.recording.scene_messages import SCHEMAS
from cogrip.protocol.recording.schema import json_schema
from cogrip.protocol.recording.summary import Summary, record_bytes

CHUNK_BYTES = 64 * 1024
LIBRARY = "cogrip"
COMPRESSION = "zstd"
LEVEL = 1  # level of the compression: records get 2 % smaller than with the library's 3, in two thirds of its time
# Numbers, since members of an enumeration are slow to come by.
_OPCODE, _CHUNK_OPCODE, _INDEX_OPCODE = int(Opcode.MESSAGE), int(Opcode.CHUNK), int(Opcode.MESSAGE_INDEX)
_CHUNK = Struct(f"<BQQQQII{len(COMPRESSION)}sQ")
_RECORD_BYTES = 9  # bytes of a record before its contents: opcode and length
_MESSAGE = Struct("<BQHIQQ")
_MESSAGE_BYTES = 22  # bytes of a message's record before the text
_INDEX = Struct("<BQHI")
_INDEX_BYTES = 6  # bytes of an index record before the entries


class RecordingWriter:
    """Writes to `stream`; OSError is the caller's. Topics are numbered as they stand in the header."""

    def __init__(self, stream: IO[bytes], header: Header, folder: Path | None = None) -> None:
        """folder: of the nameless file that holds the chunk index meanwhile; None: the system's folder of temporary files."""
        self._stream = stream
        self._at = stream.tell()
        self._epoch_ns = header.epoch_ns
        self._compress = zstandard.ZstdCompressor(LEVEL).compress
        self._write(MAGIC + record_bytes(FileHeader("", LIBRARY)))
        self._summary = Summary(folder)
        self._write_metadata(NAME, header.metadata())
        self._records = bytearray()  # of the chunk that is being filled
        self._entries: dict[int, list[int]] = {}  # of it, by channel, in the order in which the channels came
        self._channels = list(range(1, len(header.topics) + 1))
        self._register(header.topics)
        self._pictures = Pictures(header)

    def _register(self, topics: tuple[str, ...]) -> None:
        """Add schemas and channels to the first chunk, before its messages."""
        schemas: dict[str, int] = {}
        for number, topic in zip(self._channels, topics, strict=True):
            name, text = _schema_of(kind_of(topic))
            if name not in schemas:
                schemas[name] = len(schemas) + 1
                schema = Schema(schemas[name], text, "jsonschema", name)
                self._records += self._summary.add(schema)
            self._records += self._summary.add(Channel(number, topic, "json", {}, schemas[name]))

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Add a message of the topic with this number, at `time_ns` of the recording's own clock, and what derives from it."""
        log_time, channel, records = time_ns + self._epoch_ns, self._channels[topic], self._records
        try:
            entries = self._entries[channel]
        except KeyError:
            entries = self._entries[channel] = []
        entries += (log_time, len(records))
        records += _MESSAGE.pack(_OPCODE, _MESSAGE_BYTES + len(payload), channel, 0, log_time, log_time)
        records += payload
        if len(records) > CHUNK_BYTES:
            self._end_chunk()
        if topic in self._pictures.topics:
            for number, made in self._pictures.of(topic, log_time, payload):
                self.put(number, time_ns, made)

    def _end_chunk(self) -> None:
        """Write the chunk that is being filled, and its messages' index. Without a message it waits for one."""
        if not self._entries:
            return
        size, crc = len(self._records), zlib.crc32(self._records)
        packed = self._compress(self._records)
        times_ns = [entries[::2] for entries in self._entries.values()]
        first_ns, last_ns = min(map(min, times_ns)), max(0, *map(max, times_ns))
        chunk_bytes = _CHUNK.size + len(packed)
        begin = self._at
        self._write(_CHUNK.pack(
            _CHUNK_OPCODE, chunk_bytes - _RECORD_BYTES, first_ns, last_ns, size, crc,
            len(COMPRESSION), COMPRESSION.encode(), len(packed),
        ))  # fmt: skip
        self._write(packed)
        indexes, places = self._at, {}
        for channel, entries in self._entries.items():
            places[channel] = self._at
            size_of = 8 * len(entries)
            index = _INDEX.pack(_INDEX_OPCODE, _INDEX_BYTES + size_of, channel, size_of)
            self._write(index + pack(f"<{len(entries)}Q", *entries))
        self._summary.add_chunk(
            ChunkIndex(
                chunk_bytes, begin, COMPRESSION, len(packed), last_ns, self._at - indexes, places, first_ns, size
            ),
            {channel: len(entries) // 2 for channel, entries in self._entries.items()},
        )  # fmt: skip
        self._records.clear()
        self._entries.clear()

    def flush(self) -> None:
        """End the chunk and hand everything to the system."""
        self._end_chunk()
        self._stream.flush()

    def finish(self, cut: bool = False) -> None:
        """Write the index. The stream stays open.

        cut: messages may be missing at the end; the file says so.
        """
        self._end_chunk()
        if cut:
            self._write_metadata(CUT, {})
        self._write(record_bytes(DataEnd(0)))
        for piece in self._summary.pieces(self._at):
            self._write(piece)
        self._write(MAGIC)
        self._summary.close()

    def _write_metadata(self, name: str, texts: dict[str, str]) -> None:
        record = record_bytes(Metadata(name, texts))
        self._summary.add_metadata(MetadataIndex(self._at, len(record), name))
        self._write(record)

    def _write(self, data: bytes | bytearray) -> None:
        self._stream.write(data)
        self._at += len(data)


def _schema_of(kind: str) -> tuple[str, bytes]:
    """Return name and text of the schema of topics of this kind."""
    if kind in DERIVED:
        return DERIVED[kind], SCHEMAS[DERIVED[kind]]
    return f"cogrip.{KINDS[kind].__name__}", json_schema(KINDS[kind])
