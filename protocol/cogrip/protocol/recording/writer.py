"""A recording being written: MCAP with zstd chunks of 64 KiB, each readable once it is on the disk."""

from typing import IO

from mcap.writer import CompressionType, Writer

from cogrip.protocol.recording.header import NAME, Header
from cogrip.protocol.recording.records import KINDS, kind_of
from cogrip.protocol.recording.schema import json_schema

CHUNK_BYTES = 64 * 1024
LIBRARY = "cogrip"


class RecordingWriter:
    """Writes to `stream`; OSError is the caller's. Topics are numbered as they stand in the header."""

    def __init__(self, stream: IO[bytes], header: Header) -> None:
        self._epoch_ns = header.epoch_ns
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(NAME, header.metadata())
        schemas: dict[str, int] = {}
        self._channels = []
        for topic in header.topics:
            record = KINDS[kind_of(topic)]
            if record.__name__ not in schemas:
                name = record.__name__
                schemas[name] = self._writer.register_schema(f"cogrip.{name}", "jsonschema", json_schema(record))
            self._channels.append(self._writer.register_channel(topic, "json", schemas[record.__name__]))

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        log_time = time_ns + self._epoch_ns
        self._writer.add_message(self._channels[topic], log_time, payload, log_time)

    def flush(self) -> None:
        """Everything so far is in whole chunks, and with the system."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the index. The stream stays open."""
        self._writer.finish()
