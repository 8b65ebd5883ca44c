"""Defects of a run of anna and ben: one tick altered, a file cut or damaged."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import msgspec
from mcap.reader import make_reader

from cogrip.protocol.recording.reader import RecordedMessage
from cogrip.protocol.recording.records import Tick
from cogrip.protocol.recording.sink import encode

from tests.recording_files import Alter, rewrite

SERVER, ANNA, BEN = "server.mcap", "client-anna.mcap", "client-ben.mcap"
FILES = (ANNA, BEN, SERVER)
TORN = b"\x06\x00\x10\x00\x00\x00\x00\x00\x00 the writer came no further"  # a chunk of 4096 bytes begins


def until(last_ns: int) -> Alter:
    """Leave out what came later."""
    return lambda kind, message: message.payload if message.time_ns <= last_ns else None


def tick(number: int, change: Callable[[Tick], Tick]) -> Alter:
    """Change one tick."""

    def alter(kind: str, message: RecordedMessage) -> bytes | None:
        if kind == "tick":
            record = msgspec.json.decode(message.payload, type=Tick)
            if record.tick == number:
                return encode(change(record))
        return message.payload

    return alter


def cut(path: Path) -> None:
    """End a file within its last chunk, after a tick."""
    rewrite(path, until(300_000_000), closed=False)
    with path.open("ab") as file:
        file.write(TORN)


def damage(path: Path) -> None:
    """Spoil a chunk in the middle."""
    data = bytearray(path.read_bytes())
    summary = make_reader(BytesIO(bytes(data))).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[len(summary.chunk_indexes) // 2]
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    data[middle : middle + 100] = bytes(100)
    path.write_bytes(data)


def ticks(file: str) -> int:
    return 64 if file == SERVER else 512
